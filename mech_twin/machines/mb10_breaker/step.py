# SPDX-License-Identifier: Apache-2.0
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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.errors import MotionError
from mech_twin.engine.events import FALLING, NONE, Step, first_event
from mech_twin.engine.integration import Workspace, start_step, take_step
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.bearing_events import (
    apply_bearing_event,
    is_bearing_event,
    log_bearings,
    starting,
    watch_bearings,
)
from mech_twin.machines.mb10_breaker.bearing_friction import BearingTorques, rubs
from mech_twin.machines.mb10_breaker.contact import apply_event
from mech_twin.machines.mb10_breaker.dynamics import (
    BLOCKED,
    FLIGHT,
    HELD,
    MOVING,
    PUSHED,
    REST,
    TURN,
    Breaker,
    Senses,
    crank_torque,
    energies,
)
from mech_twin.machines.mb10_breaker.event_rows import log_knot
from mech_twin.machines.mb10_breaker.gear_events import log_gear, project_gear, until_torque_turns, watch_gear
from mech_twin.machines.mb10_breaker.motion import (
    COLLAR,
    CRANK_MOTION,
    DEAD_CENTRE,
    GAP,
    GEAR_GRIP,
    GEAR_TURNS,
    LIFT,
    PUSHING_SUBSTEP_S,
    THRUST,
    TOOL_MOTION,
    WALL,
    Motion,
    between_knots,
    going_on,
    may_stand,
    substep,
    tool_gap,
    torques_now,
    workspace_of_motion,
)
from mech_twin.machines.mb10_breaker.state import STATES, named
from mech_twin.machines.mb10_breaker.tool_contact import project_contact

Array = NDArray[np.float64]
PARTED = 1e-9  # m and m/s
IN_TOOL_M = 1e-10  # what rounding leaves of a gap that is closed
MOST_HALVINGS = 40
SUBSTEP_BUDGET = 20000  # of one coupling step
MOST_REVERSALS = 16  # of the gear in one coupling step that are landed on; a gear on the edge of sticking has no end


@kernel
def total_energy(b: Breaker, state: Any) -> float:
    """Return kinetic and potential energy of machine and tool (J)."""
    kinetic, potential, _ = energies(b, state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s)
    return float(kinetic + potential + 0.5 * b.tool_mass_kg * state.tool_m_per_s * state.tool_m_per_s)


@kernel
def total_momentum(b: Breaker, state: Any) -> float:
    """Return the angular momentum M12 u + M22 p (N m s)."""
    return float(energies(b, state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s)[2])


@kernel
def take_body(b: Breaker, state: Any, record: Any, regime: int, phi: float, p: float, rests: bool) -> int:
    """Put the body's own angle and rate in the state, book what that changes, and return the regime."""
    memory, before = record[0], total_energy(b, state)
    memory.parameter_work_j += before - memory.energy_j
    if regime == HELD:
        return regime
    momentum, carried = total_momentum(b, state), b.frame_drive > 0.0 and may_stand(b, state, regime != FLIGHT, REST)
    state.body_rad = 0.0 if rests or (phi < 0.0 <= p) else phi
    state.body_rad_per_s = 0.0 if rests else p
    if carried and not rests:
        state.crank_rad_per_s = p  # the gear's shaft stood, and goes on standing
    project_contact(b, state, int(memory.tool_regime), rests)
    memory.coupling_defect_j += total_energy(b, state) - before
    memory.coupling_defect_nms += total_momentum(b, state) - momentum
    return REST if rests else FLIGHT


@kernel
def torque_line(
    b: Breaker, state: Any, memory: Any, torque: float, step_s: float, order: int, stands: bool
) -> tuple[float, float]:
    """Return slope of the motor torque (N m/s) and the crank torque (N m) that makes good the step before."""
    if order == 0 or memory.torque_history < 0.0:
        return 0.0, 0.0
    missed = crank_torque(b, torque, state.crank_rad_per_s, state.body_rad_per_s) - memory.line_crank_torque_nm
    if stands:
        missed = 0.0  # a gear that stands passes on what holds it
    slope = (torque - memory.previous_torque_nm) / step_s if memory.torque_history > 0.0 else 0.0
    return slope, missed * memory.torque_lag_s / step_s


@kernel
def remember_torque_line(motion: Motion, state: Any, memory: Any, step_s: float, left: float, weighed: float) -> None:
    """Keep what the next step needs to make good what this extrapolation misses."""
    b = motion.breaker
    final = motion.torque_nm + motion.slope_nm_per_s * step_s
    memory.previous_torque_nm = motion.torque_nm
    memory.line_crank_torque_nm = crank_torque(b, final, state.crank_rad_per_s, state.body_rad_per_s)
    memory.torque_lag_s = left / weighed if weighed > 0.0 else 0.5 * step_s
    memory.torque_history = 0.0 if weighed > 0.0 else 1.0


@kernel
def to_dead_centre(b: Breaker, q: float) -> float:
    """Return how far the crank has to turn to the rocker's next extreme, above 0 (rad)."""
    striking, retreating = (b.striking_crank_rad - q) % TURN, (b.retreating_crank_rad - q) % TURN
    striking = striking if striking > 1e-12 else TURN
    retreating = retreating if retreating > 1e-12 else TURN
    return min(striking, retreating)


@kernel
def leaves_tool(motion: Motion, state: Any, last: int) -> bool:
    """Return whether the event that began this substep let the striker part from the tool, which rounding may hide."""
    gap, opening = tool_gap(motion.breaker, state)
    turned_back = last == TOOL_MOTION and abs(gap) < PARTED and abs(opening) < PARTED
    return last == THRUST or turned_back


@kernel
def watched(motion: Motion, state: Any, end: Any, regime: int, last: int, watches: NDArray[np.int64]) -> int:
    """Fill the rows of ``watches`` with what can happen within a substep; return their number.

    ``last`` is the signal whose event began this substep, `NONE` without: it may start at its root.
    """
    count, tool = 0, motion.tool
    watches[:, 1] = FALLING
    watches[:, 2] = 0
    if tool in (PUSHED, BLOCKED):
        watches[0, 0], watches[1, 0], count = THRUST, CRANK_MOTION, 2
        if state.crank_rad_per_s <= 0.0:
            count = 1
        if tool == BLOCKED:
            watches[count, 0] = WALL
            count += 1
    elif not leaves_tool(motion, state, last):
        watches[0, 0], count = GAP, 1
        watches[0, 2] = 1 if last == GAP else 0
    if tool in (MOVING, PUSHED) and (state.tool_m_per_s > 0.0 or last != WALL):
        watches[count, 0] = TOOL_MOTION
        watches[count, 2] = 1 if state.tool_m_per_s == 0.0 else 0
        count += 1
    if end.crank_rad >= motion.dead_centre_rad:
        watches[count, 0] = DEAD_CENTRE
        count += 1
    if regime == FLIGHT:
        watches[count, 0] = LIFT
        watches[count, 2] = 1 if state.body_rad == 0.0 else 0
        count += 1
    elif regime == REST:
        watches[count, 0] = COLLAR
        count += 1
    return watch_bearings(motion, state, last, watches, count) if rubs(motion.breaker) else count


class Before(NamedTuple):
    """Energy and momentum a step begins with, and the sums of losses and impulses up to it."""

    energy_j: float
    momentum_nms: float
    blow_loss_j: float
    collar_loss_j: float
    reseating_loss_j: float
    impact_impulse_nms: float


@kernel
def begin_step(b: Breaker, state: Any, memory: Any, now: BearingTorques) -> Before:
    """Remember the state the step begins with, and set the sums its events add to to zero: they keep their digits."""
    memory.begin_crank_rad, memory.begin_crank_rad_per_s = state.crank_rad, state.crank_rad_per_s
    memory.begin_body_rad, memory.begin_body_rad_per_s = state.body_rad, state.body_rad_per_s
    memory.begin_drive_torque_nm, memory.begin_tool_force_n = now.drive_nm, now.tool_force_n
    memory.begin_crank_friction_nm, memory.begin_body_friction_nm = now.crank_nm, now.body_nm
    before = Before(
        total_energy(b, state),
        total_momentum(b, state),
        memory.blow_loss_j,
        memory.collar_loss_j,
        memory.reseating_loss_j,
        memory.impact_impulse_nms,
    )
    memory.blow_loss_j = memory.collar_loss_j = memory.reseating_loss_j = memory.impact_impulse_nms = 0.0
    return before


@kernel
def close_balances(b: Breaker, state: Any, memory: Any, before: Before) -> None:
    """Book the step's works and impulses, and what the balances of energy and momentum leave open."""
    lost = (
        memory.blow_loss_j + memory.collar_loss_j + memory.reseating_loss_j + state.wall_work_j + state.damping_loss_j
    )
    memory.energy_j = total_energy(b, state)
    memory.energy_error_j += memory.energy_j - before.energy_j - state.drive_work_j + lost
    turned = state.angular_impulse_nms + memory.impact_impulse_nms
    memory.momentum_error_nms += total_momentum(b, state) - before.momentum_nms - turned
    memory.blow_loss_j += before.blow_loss_j
    memory.collar_loss_j += before.collar_loss_j
    memory.reseating_loss_j += before.reseating_loss_j
    memory.impact_impulse_nms += before.impact_impulse_nms
    memory.wall_work_j += state.wall_work_j
    memory.drive_work_j += state.drive_work_j
    memory.damping_loss_j += state.damping_loss_j
    memory.angular_impulse_nms += state.angular_impulse_nms
    memory.tool_travel_m, memory.tool_speed_m_per_s = state.tool_m, state.tool_m_per_s
    state.drive_work_j = state.damping_loss_j = state.angular_impulse_nms = state.wall_work_j = 0.0
    full = math.floor(state.crank_rad / TURN)
    memory.turns += full
    state.crank_rad -= full * TURN


@kernel
def next_piece(motion: Motion, time: float, state: Any, memory: Any, regime: int, lands: bool) -> Motion:
    """Return the motion as it goes on from a state, in the regimes kept in the memory.

    ``lands``: the gear keeps its sense through the piece, which ends where that turns, and may stand.
    """
    senses = Senses(memory.crank_sense, memory.body_sense)
    going = going_on(motion, time, state, senses, regime != FLIGHT, int(memory.tool_regime), lands)
    memory.crank_sense, memory.body_sense = going.senses.crank, going.senses.body
    return Motion(
        going.breaker,
        going.torque_nm,
        going.slope_nm_per_s,
        going.compensation_nm,
        going.rests,
        going.tool,
        state.crank_rad + to_dead_centre(motion.breaker, state.crank_rad),
        going.senses,
        going.gear_sense,
        going.gear_stands,
    )


@kernel
def has_knots(motion: Motion) -> bool:
    """Return whether the moment on the body is told at the ends of each piece: the striker pushes, the body flies."""
    return motion.tool in (PUSHED, BLOCKED) and not motion.rests


@kernel
def take_piece(motion: Motion, time: float, y: Array, step_s: float, work: Workspace) -> float:
    """Take the next substep from ``y``, leave its end in ``work`` and return its length (s)."""
    knots, u = has_knots(motion), named(y).crank_rad_per_s
    longest = min(motion.breaker.longest_substep_s, PUSHING_SUBSTEP_S if knots or motion.tool == PUSHED else 1.0)
    span = until_torque_turns(motion, time, u, substep(u, step_s - time, longest))
    start_step(motion, time, y, work)
    take_step(motion, time, y, span, work)
    if knots and between_knots(span, work) < span:
        span = between_knots(span, work)
        take_step(motion, time, y, span, work)
    return span


@kernel
def while_apart(motion: Motion, time: float, y: Array, span: float, work: Workspace) -> float:
    """Return the length (s) of a piece after which the striker is not in the tool, and leave its end in ``work``.

    A piece that begins at the gap's root may not see that it closes again.  Halved until it ends with an open gap, it
    leaves the closing to the next piece; where none does, the gap is closed within rounding, and the piece stays.
    """
    if motion.tool in (PUSHED, BLOCKED) or tool_gap(motion.breaker, named(work.end))[0] >= -IN_TOOL_M:
        return span
    shorter = span
    for _ in range(MOST_HALVINGS):
        shorter *= 0.5
        take_step(motion, time, y, shorter, work)
        if tool_gap(motion.breaker, named(work.end))[0] > 0.0:
            return shorter
    take_step(motion, time, y, span, work)
    return span


@kernel
def lead_to_event(step: Step, watches: NDArray[np.int64], count: int, end: Array) -> tuple[int, float]:
    """Lead the state through a piece, to its ``end`` or to the first event in it; return the signal and the time."""
    motion, work = step.system, step.work
    which, span = first_event(step, watches, count, end)
    signal = NONE
    if which == NONE:
        work.end[:] = end
    else:
        signal = watches[which, 0]
        if span == 0.0:
            return signal, span
        take_step(motion, step.start_s, step.state, span, work)
    apart = span if signal == GAP else while_apart(motion, step.start_s, step.state, span, work)
    step.state[:] = work.end
    return (signal if apart == span else NONE), apart


@kernel
def advance_step(
    b: Breaker, y: Array, record: Any, regime: int, torque: float, step_s: float, order: int, log: Any
) -> tuple[int, int, float]:
    """Advance state and memory by one coupling step; return regime, number of events, crank torque at the end.

    Parameters
    ----------
    y : (10,) array
        As `state.BreakerState` names it; changed in place.
    record : (1,) array of `state.MEMORY`
        Changed in place.
    torque : float
        Motor torque at the start of the step (N m).
    log : (EVENT_ROWS,) array of `state.EVENT`
        Receives one row per event.
    """
    memory, state = record[0], named(y)
    stands = may_stand(b, state, regime != FLIGHT, int(memory.tool_regime))
    slope, missed = torque_line(b, state, memory, torque, step_s, order, stands)
    memory.compensation_torque_nm = missed
    work, end, watches = workspace_of_motion(), np.empty(STATES), np.empty((10, 3), dtype=np.int64)
    first = starting(b, state, memory, regime != FLIGHT, int(memory.tool_regime))
    motion = Motion(b, torque, slope, missed, regime != FLIGHT, int(memory.tool_regime), 0.0, first, 0.0, False)
    motion = going_on(motion, 0.0, state, first, motion.rests, motion.tool, True)
    before = begin_step(b, state, memory, torques_now(motion, 0.0, state))
    count, time, left, weighed, last, turns, reversals = 0, 0.0, 0.0, 0.0, NONE, 0, 0
    while step_s - time > 1e-16:
        turns += 1
        if turns > SUBSTEP_BUDGET:
            raise MotionError("mb10_breaker: more than 20000 pieces of motion in one step; shorten coupling.step_s")
        motion = next_piece(motion, time, state, memory, regime, reversals < MOST_REVERSALS)
        span = take_piece(motion, time, y, step_s, work)
        end[:] = work.end
        number = watched(motion, state, named(end), regime, last, watches)
        if reversals < MOST_REVERSALS:
            number = watch_gear(motion, state, named(end), watches, number)
        last, passed = lead_to_event(Step(motion, time, y, span, work), watches, number, end)
        time += passed
        project_gear(motion, state)
        project_contact(b, state, motion.tool, motion.rests)
        if last == NONE:
            count = log_knot(motion, state, memory, regime, time, log, count) if has_knots(motion) else count
            continue
        if last in (GEAR_TURNS, GEAR_GRIP):
            reversals += 1
            count = log_gear(motion, state, memory, regime, last, time, log, count)
            continue
        apply_bearing_event(motion, state, last, regime != FLIGHT)
        u, p = state.crank_rad_per_s, state.body_rad_per_s
        if not is_bearing_event(last):
            regime, count = apply_event(motion, state, memory, regime, last, time, log, count)
        count = log_bearings(motion, state, memory, regime, time, log, count)
        jump = abs(state.crank_rad_per_s - u - b.frame_drive * (state.body_rad_per_s - p))
        left, weighed = left + jump * (step_s - time), weighed + jump
    now = torques_now(next_piece(motion, step_s, state, memory, regime, True), step_s, state)
    memory.tool_force_n, memory.crank_friction_nm, memory.body_friction_nm = now.tool_force_n, now.crank_nm, now.body_nm
    remember_torque_line(motion, state, memory, step_s, left, weighed)
    close_balances(b, state, memory, before)
    return regime, count, now.drive_nm
