"""One coupling step of the breaker's linkage: the motion led from t_n to t_n+1 through every event on the way.

Motor torque inside the step: linear from the last two motor samples, restarted (held) after a step with an impact,
since the two samples then lie on different sides of a jump in speed.  At t_n the torque of the step before is known at
both ends, so the impulse which its extrapolation missed is known too; it is made good in the step that begins, as a
constant.  It is counted in torque on the crank, behind the gear, whose losses change sides when the motor generates.
Without a jump it is (Q_n - line_n) h/2; with jumps, Q_n - line_n times the time that was left after them, each jump
weighted with the rotor's change of speed.  An impulse of order h delivered h late leaves an
error of order h^2, so the scheme keeps second order across impacts.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.events import FALLING, NONE, Step, first_event
from mech_twin.engine.integration import start_step, take_step
from mech_twin.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import (
    EXTRA,
    FLIGHT,
    HELD,
    JAMMED,
    PHI,
    REST,
    STATES,
    TURNED,
    WORK,
    Breaker,
    P,
    Q,
    U,
    accelerations,
    blow,
    crank_torque,
    energies,
    gap,
    masses_at,
    touchdown,
)
from mech_twin.machines.mb10_breaker.motion import COLLAR, EXTREME, GAP, LIFT, Motion, substep, workspace_of_motion

Array = NDArray[np.float64]
TURN = 2.0 * math.pi
SETTLED_WITHIN_S = 1e-10  # the rest of a chatter series that is cut off as one plastic impact
EVENT_ROWS = 512

BLOW, MISSED, TOUCHDOWN, SETTLED, LIFT_OFF, JAM, UNSEATED = 0, 1, 2, 3, 4, 5, 6
KINDS = ("blow", "missed", "touchdown", "settled", "lift_off", "jammed", "unseated")
# a row of the event log: time into the step, kind, speeds, impulse, cycle; q, u, phi, p and torque Q before and after
TIME, KIND, BEFORE, AFTER, IMPULSE, CYCLE_OF, PRE, POST, ROW = 0, 1, 2, 3, 4, 5, 6, 11, 16

MEMORY = (
    "turns",
    "cycle",
    "pass_done",
    "drive_work_j",
    "damping_loss_j",
    "angular_impulse_nms",
    "blow_loss_j",
    "tool_energy_j",
    "collar_loss_j",
    "jam_loss_j",
    "takeover_energy_j",
    "impact_impulse_nms",
    "takeover_momentum_nms",
    "previous_torque_nm",
    "line_crank_torque_nm",
    "torque_lag_s",
    "torque_history",
    "begin_crank_rad",  # crank, body and torque on the crank as this step began with them
    "begin_crank_rad_per_s",
    "begin_body_rad",
    "begin_body_rad_per_s",
    "begin_drive_torque_nm",
)
TURNS, CYCLE, PASS_DONE, BOOKS = 0, 1, 2, 3
BLOW_LOSS, TOOL_ENERGY, COLLAR_LOSS, JAM_LOSS, TAKEOVER, IMPACTS, TAKEOVER_MOMENTUM = 6, 7, 8, 9, 10, 11, 12
PREVIOUS, LINE, LAG, HISTORY, BEGIN = 13, 14, 15, 16, 17


@kernel
def taken_over(b: Breaker, state: Array, memory: Array, regime: int, phi: float, p: float, rests: bool) -> int:
    """Put the body's own angle and rate in the state, book what that changes, and return the regime."""
    if regime in (HELD, JAMMED):
        return regime
    kinetic, potential, momentum = energies(b, state[Q], state[U], state[PHI], state[P])
    state[PHI] = 0.0 if rests or (phi < 0.0 <= p) else phi
    state[P] = 0.0 if rests else p
    kinetic_2, potential_2, momentum_2 = energies(b, state[Q], state[U], state[PHI], state[P])
    memory[TAKEOVER] += kinetic_2 + potential_2 - kinetic - potential
    memory[TAKEOVER_MOMENTUM] += momentum_2 - momentum
    return REST if rests else FLIGHT


@kernel
def torque_line(
    b: Breaker, state: Array, memory: Array, torque: float, step_s: float, order: int
) -> tuple[float, float]:
    """Return slope of the motor torque (N m/s) and the crank torque (N m) that makes good the step before."""
    if order == 0 or memory[HISTORY] < 0.0:
        return 0.0, 0.0
    missed = (crank_torque(b, torque, state[U], state[P]) - memory[LINE]) * memory[LAG] / step_s
    slope = (torque - memory[PREVIOUS]) / step_s if memory[HISTORY] > 0.0 else 0.0
    return slope, missed


@kernel
def ahead(b: Breaker, q: float) -> float:
    """Return how far the crank has to turn to the rocker's striking extreme, 0 to 2 pi (rad)."""
    rest = (b.extreme - q) % TURN
    return rest if rest > 0.0 else TURN


@kernel
def watched(b: Breaker, state: Array, end: Array, memory: Array, regime: int, watches: NDArray[np.int64]) -> int:
    """Fill the rows of ``watches`` with what can happen within a substep; return their number."""
    count = 0
    rest = ahead(b, state[Q])
    if memory[PASS_DONE] == 0.0 and rest <= (b.extreme - b.retreat) % TURN:
        watches[0] = (GAP, FALLING, 0)
        count = 1
        if end[Q] >= state[Q] + rest:
            watches[1] = (EXTREME, FALLING, 0)
            count = 2
    if regime == FLIGHT:
        watches[count] = (LIFT, FALLING, 1 if state[PHI] == 0.0 else 0)
        count += 1
    elif regime == REST:
        watches[count] = (COLLAR, FALLING, 0)
        count += 1
    return count


@kernel
def event_kind(which: int, watches: NDArray[np.int64]) -> int:
    """Return the kind of event a watch saw."""
    if which == NONE:
        return NONE
    seen = watches[which, 0]
    if seen == GAP:
        return BLOW
    if seen == EXTREME:
        return MISSED
    return TOUCHDOWN if seen == LIFT else LIFT_OFF


@kernel
def settles(b: Breaker, state: Array, torque: float) -> bool:
    """Return whether the bounces still to come after this touchdown last too short to be told one by one."""
    u, p, _, _ = touchdown(b, state[Q], state[U], 0.0, state[P], b.restitution)
    m = masses_at(b, state[Q], 0.0)
    _, sink, _ = accelerations(b, m, u, 0.0, p, crank_torque(b, torque, u, p) + state[EXTRA], False)
    return sink < 0.0 and 2.0 * p <= -sink * (1.0 - b.restitution) * SETTLED_WITHIN_S


@kernel
def noted(b: Breaker, row: Array, place: int, state: Array, torque: float) -> None:
    """Write crank and body coordinates and the crank's torque in an event's row."""
    row[place] = state[Q]
    row[place + 1] = state[U]
    row[place + 2] = state[PHI]
    row[place + 3] = state[P]
    row[place + 4] = crank_torque(b, torque, state[U], state[P]) + state[EXTRA]


@kernel
def struck(b: Breaker, state: Array, memory: Array, regime: int, row: Array) -> int:
    """Apply a blow to the state, book it, and return the regime after it."""
    rests = regime != FLIGHT
    _, speed = gap(b, state[Q], state[U], state[PHI], state[P])
    hit = blow(b, state[Q], state[U], state[PHI], state[P], rests)
    row[BEFORE], row[AFTER], row[IMPULSE] = speed, -b.tool_restitution * speed, hit.impulse
    state[U], state[P] = hit.u, hit.p
    memory[BLOW_LOSS] += hit.loss
    memory[TOOL_ENERGY] += hit.tool_energy
    memory[IMPACTS] += b.radius * hit.impulse
    memory[PASS_DONE] = 1.0
    memory[CYCLE] += 1.0
    if hit.tool_energy < b.wall_force * b.overtravel:
        return JAMMED
    return FLIGHT if regime == REST and hit.p > 0.0 else regime


@kernel
def landed(b: Breaker, state: Array, memory: Array, row: Array, torque: float, last: bool) -> int:
    """Apply a touchdown on the collar to the state, book it, and return the regime after it."""
    final = last or settles(b, state, torque)
    before = energies(b, state[Q], state[U], state[PHI], state[P])
    state[PHI] = 0.0
    after = energies(b, state[Q], state[U], 0.0, state[P])
    memory[TAKEOVER] += after[0] + after[1] - before[0] - before[1]
    u, p, impulse, loss = touchdown(b, state[Q], state[U], 0.0, state[P], 0.0 if final else b.restitution)
    row[BEFORE], row[AFTER], row[IMPULSE] = b.radius * state[P], b.radius * p, impulse / b.radius
    state[U], state[P] = u, p
    memory[COLLAR_LOSS] += loss
    memory[IMPACTS] += impulse
    if final:
        row[KIND] = SETTLED
        return REST
    return FLIGHT


@kernel
def jammed(b: Breaker, state: Array, memory: Array) -> None:
    """Stop everything where it is; the energy and momentum it had go in the books."""
    kinetic, _, momentum = energies(b, state[Q], state[U], state[PHI], state[P])
    memory[JAM_LOSS] += kinetic
    memory[IMPACTS] -= momentum
    state[U] = state[P] = 0.0


@kernel
def happened(
    b: Breaker, state: Array, memory: Array, regime: int, kind: int, time: float, torque: float, log: Array, count: int
) -> tuple[int, int]:
    """Apply an event to state, memory and log; return the regime after it and the number of events."""
    if count + 3 > len(log) and kind != TOUCHDOWN:
        raise RuntimeError("more events in one coupling step than the log holds")
    row = log[count]
    row[TIME], row[KIND], row[CYCLE_OF] = time, kind, memory[CYCLE]
    row[BEFORE] = row[AFTER] = row[IMPULSE] = 0.0
    noted(b, row, PRE, state, torque)
    noted(b, row, POST, state, torque)
    if kind == BLOW and regime == FLIGHT:  # the body is off its collar: the tool is not pressed on the wall
        log[count + 1] = row
        row[KIND] = UNSEATED
        count += 1
        row = log[count]
    if kind == BLOW:
        regime = struck(b, state, memory, regime, row)
    elif kind == TOUCHDOWN:
        regime = landed(b, state, memory, row, torque, count + 3 > len(log))
    elif kind == LIFT_OFF:
        regime = FLIGHT
    else:
        memory[PASS_DONE] = 1.0
        memory[CYCLE] += 1.0
    noted(b, row, POST, state, torque)
    count += 1
    if regime == JAMMED:
        row = log[count]
        row[TIME], row[KIND], row[CYCLE_OF] = time, JAM, log[count - 1, CYCLE_OF]
        row[BEFORE] = row[AFTER] = row[IMPULSE] = 0.0
        noted(b, row, PRE, state, torque)
        jammed(b, state, memory)
        noted(b, row, POST, state, torque)
        count += 1
    return regime, count


@kernel
def advanced(
    b: Breaker, state: Array, memory: Array, regime: int, torque: float, step_s: float, order: int, log: Array
) -> tuple[int, int, float]:
    """Advance state and memory by one coupling step; return regime, number of events, crank torque at the end.

    Parameters
    ----------
    state : (8,) array
        q, u, phi, p, work of the drive, damping loss, angular impulse, constant torque; changed in place.
    memory : (22,) array
        As `MEMORY` names it; changed in place.
    torque : float
        Motor torque at the start of the step (N m).
    log : (EVENT_ROWS, ROW) array
        Receives one row per event.
    """
    slope, state[EXTRA] = torque_line(b, state, memory, torque, step_s, order)
    work, end, watches = workspace_of_motion(), np.empty(STATES), np.empty((4, 3), dtype=np.int64)
    count, time, left, weighed = 0, 0.0, 0.0, 0.0
    noted(b, memory, BEGIN, state, torque)
    while regime != JAMMED and step_s - time > 1e-16:
        span = substep(state[U], step_s - time)
        if memory[PASS_DONE] != 0.0 and ahead(b, state[Q]) > (b.extreme - b.retreat) % TURN:
            memory[PASS_DONE] = 0.0
        motion = Motion(b, torque, slope, regime != FLIGHT, state[Q] + ahead(b, state[Q]))
        start_step(motion, time, state, work)
        take_step(motion, time, state, span, work)
        end[:] = work.end
        number = watched(b, state, end, memory, regime, watches)
        which, when = first_event(Step(motion, time, state, span, work), watches, number, end)
        kind = event_kind(which, watches)
        if kind == NONE:
            state[:] = end
            time += span
            continue
        if when > 0.0:
            take_step(motion, time, state, when, work)
            state[:] = work.end
            time += when
        u, p = state[U], state[P]
        regime, count = happened(b, state, memory, regime, kind, time, torque + slope * time, log, count)
        jump = abs(state[U] - u - b.frame_drive * (state[P] - p))
        left += jump * (step_s - time)
        weighed += jump
    final = crank_torque(b, torque + slope * step_s, state[U], state[P])
    memory[PREVIOUS], memory[LINE] = torque, final
    memory[LAG] = left / weighed if weighed > 0.0 else 0.5 * step_s
    memory[HISTORY] = 0.0 if weighed > 0.0 else 1.0
    turned = math.floor(state[Q] / TURN)
    memory[TURNS] += turned
    state[Q] -= turned * TURN
    memory[BOOKS : BOOKS + 3] += state[WORK : TURNED + 1]
    state[WORK : TURNED + 1] = 0.0
    return regime, count, final + state[EXTRA]
