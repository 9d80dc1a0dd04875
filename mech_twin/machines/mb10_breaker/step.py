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

from mech_twin.engine.hybrid.declared import declared, entry_of
from mech_twin.engine.hybrid.laws import HOLD, LOW, OPEN, Indices
from mech_twin.engine.hybrid.loop import (
    LOG_FULL,
    MOST_PIECES,
    TOO_LONG,
    TOO_MANY,
    advance,
    room_for,
    room_in,
    room_sizes,
)
from mech_twin.engine.tableaus import DORMAND_PRINCE_8
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.mb10_breaker.dynamics import (
    BLOCKED,
    FLIGHT,
    HELD,
    MOVING,
    PUSHED,
    REST,
    STANDING,
    TURN,
    Breaker,
    crank_torque,
    energies,
    striker,
)
from mech_twin.machines.mb10_breaker.joint_laws import Torques, join_laws, project_contact, senses
from mech_twin.machines.mb10_breaker.motion import (
    JUMPS,
    JUMPS_LEFT,
    KEPT,
    OWN_SIGNALS,
    SIDE,
    TORQUE_SENSE,
    BreakerMotion,
    torques_at,
)
from mech_twin.machines.mb10_breaker.state import (
    COLLAR_LAW,
    CRANK_RATE,
    FREEDOMS,
    LAWS,
    MEMORY,
    STATES,
    TOOL_LAW,
    TOOL_REGIME,
    WALL_LAW,
    BreakerMemory,
    named,
)

Array = NDArray[np.float64]
ERROR = 1e-13  # of a step, over the size of what it integrates
FAILURES = (
    f"mb10_breaker: more than {MOST_PIECES} pieces of motion in one step; shorten coupling.step_s",
    "mb10_breaker: no step of the motion is short enough; shorten coupling.step_s",
    "mb10_breaker: contacts contradict each other; shorten coupling.step_s",
)


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
def gear_stands(b: Breaker, state: Any, rests: bool, tool: int) -> bool:
    """Return whether the gear's loss holds its shaft, u = p (drive on the frame) or u = 0, while the body flies."""
    free = not rests and tool != BLOCKED and (b.frame_drive > 0.0 or b.crank_coulomb_nm == 0.0)
    return free and b.efficiency < 1.0 and state.crank_rad_per_s - b.frame_drive * state.body_rad_per_s == 0.0


@kernel
def take_body(b: Breaker, y: Array, record: Any, regime: int, phi: float, p: float, rests: bool) -> int:
    """Put the body's own angle and rate in the state, book what that changes, and return the regime."""
    memory, state = record[0], named(y)
    before = total_energy(b, state)
    memory.parameter_work_j += before - memory.energy_j
    if regime == HELD:
        return regime
    momentum, carried = (
        total_momentum(b, state),
        b.frame_drive > 0.0 and gear_stands(b, state, regime != FLIGHT, STANDING),
    )
    state.body_rad = 0.0 if rests or (phi < 0.0 <= p) else phi
    state.body_rad_per_s = 0.0 if rests else p
    if carried and not rests:
        state.crank_rad_per_s = p  # the gear's shaft stood, and goes on standing
    regimes = np.zeros(LAWS, dtype=np.int64)
    fill_regimes(REST if rests else FLIGHT, int(memory.tool_regime), regimes)
    if regimes[TOOL_LAW] == HOLD:
        project_contact(b, y, regimes)
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
def remember_torque_line(
    motion: BreakerMotion, state: Any, memory: Any, step_s: float, left: float, weighed: float
) -> None:
    """Keep what the next step needs to make good what this extrapolation misses."""
    b = motion.breaker
    final = motion.torque_nm + motion.slope_nm_per_s * step_s
    memory.previous_torque_nm = motion.torque_nm
    memory.line_crank_torque_nm = crank_torque(b, final, state.crank_rad_per_s, state.body_rad_per_s)
    memory.torque_lag_s = left / weighed if weighed > 0.0 else 0.5 * step_s
    memory.torque_history = 0.0 if weighed > 0.0 else 1.0


class Before(NamedTuple):
    """Energy and momentum a step begins with, and the sums of losses and impulses up to it."""

    energy_j: float
    momentum_nms: float
    blow_loss_j: float
    collar_loss_j: float
    reseating_loss_j: float
    impact_impulse_nms: float


@kernel
def begin_step(b: Breaker, state: Any, memory: Any, now: Torques) -> Before:
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


@borrowing_kernel
def fill_regimes(regime: int, tool: int, regimes: Indices) -> None:
    """Fill the regimes of collar, wall and striker from those that are told."""
    regimes[COLLAR_LAW] = HOLD if regime == REST else OPEN
    regimes[WALL_LAW] = LOW if tool in (MOVING, PUSHED) else HOLD
    regimes[TOOL_LAW] = HOLD if tool in (PUSHED, BLOCKED) else OPEN


@borrowing_kernel
def told_tool(regimes: Indices) -> int:
    """Return what the tool does."""
    if regimes[TOOL_LAW] == HOLD:
        return BLOCKED if regimes[WALL_LAW] == HOLD else PUSHED
    return MOVING if regimes[WALL_LAW] == LOW else STANDING


def breaker_entry(b: Breaker) -> int | None:
    """Return the address of the compiled functions of a breaker."""
    memory, kept = np.zeros(len(BreakerMemory._fields)), np.zeros(KEPT)
    at = room_for(FREEDOMS, LAWS, OWN_SIGNALS, STATES).at
    return entry_of(BreakerMotion(b, 0.0, 0.0, 0.0, 0.0, 0.0, memory, kept, at))


@borrowing_kernel
def fill_tolerance(b: Breaker, y: Array, tolerance: Array) -> None:
    """Fill what one step of the integration may miss."""
    u = 1.0 + abs(y[CRANK_RATE])
    for i in range(STATES):
        tolerance[i] = ERROR * (1.0 + b.crank.inertia_kg_m2 * u * u) if i >= 2 * FREEDOMS else ERROR
    for i in range(FREEDOMS, 2 * FREEDOMS):
        tolerance[i] = ERROR * (1.0 + abs(y[i]))


@kernel
def advance_step(
    entry: int | None, b: Breaker, y: Array, row: Array, regime: int, torque: float, begin_s: float, step_s: float,
    order: int, log: Array,
) -> tuple[int, int, float]:  # fmt: skip
    """Advance state and memory by one coupling step; return regime, number of events, crank torque at the end.

    Parameters
    ----------
    entry : int
        Of `breaker_entry`.
    y : (10,) array
        As `state.BreakerState` names it; changed in place.
    row : array
        The memory, as `state.BreakerMemory` names it; changed in place.
    torque, begin_s : float
        Motor torque at the start of the step (N m), and that time (s).
    log : array
        Receives one row per event; where it may be too short the number is `LOG_FULL`.
    """
    memory, state, tool = row.view(MEMORY)[0], named(y), int(row[TOOL_REGIME])
    slope, missed = torque_line(b, state, memory, torque, step_s, order, gear_stands(b, state, regime != FLIGHT, tool))
    memory.compensation_torque_nm = missed
    size, places = room_sizes(FREEDOMS, LAWS, OWN_SIGNALS, STATES)
    numbers, marks = np.zeros(KEPT + size), np.zeros(LAWS + places, dtype=np.int64)
    room = room_in(numbers[KEPT:], marks[LAWS:], FREEDOMS, LAWS, OWN_SIGNALS, STATES, DORMAND_PRINCE_8)
    kept, regimes = numbers[:KEPT], marks[:LAWS]
    fill_regimes(regime, tool, regimes)
    join_laws(b, y, regimes, memory.crank_sense, memory.body_sense)
    memory.crank_sense, memory.body_sense = senses(b, y, regimes)
    fill_tolerance(b, y, room.tolerance)
    kept[SIDE] = math.copysign(1.0, striker(b, state.crank_rad)[1])
    kept[TORQUE_SENSE] = 1.0 if torque > 0.0 or (torque == 0.0 and slope > 0.0) else -1.0
    motion = BreakerMotion(b, torque, slope, missed, begin_s, step_s, row, kept, room.at)
    before = begin_step(b, state, memory, torques_at(motion, 0.0, y, regimes, room.at))
    system = declared(entry, motion, room.at)
    count = advance(system, 0.0, step_s, y, regimes, room, log, 0)
    if count < 0:
        return regime, count if count == LOG_FULL else -1 if count in (TOO_MANY, TOO_LONG) else max(count, -3), 0.0
    now = torques_at(motion, step_s, y, regimes, room.at)
    memory.tool_regime = told_tool(regimes)
    memory.tool_force_n, memory.crank_friction_nm, memory.body_friction_nm = now.tool_force_n, now.crank_nm, now.body_nm
    memory.crank_sense, memory.body_sense = senses(b, y, regimes)
    remember_torque_line(motion, state, memory, step_s, kept[JUMPS_LEFT], kept[JUMPS])
    close_balances(b, state, memory, before)
    return HELD if b.held else REST if regimes[COLLAR_LAW] == HOLD else FLIGHT, count, now.drive_nm
