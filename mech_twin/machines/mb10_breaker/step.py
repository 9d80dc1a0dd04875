# SPDX-License-Identifier: Apache-2.0
"""One coupling step of the breaker's linkage: the motion integrated from t_n to t_n+1 through all events."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.addresses import record_at
from mech_twin.engine.compiled_steps import LOG_FULL
from mech_twin.engine.hybrid.declared import declared
from mech_twin.engine.hybrid.laws import HOLD, LOW, OPEN, Indices
from mech_twin.engine.hybrid.loop import MOST_PIECES, TOO_LONG, TOO_MANY, advance, room_in, room_sizes
from mech_twin.engine.integration import DORMAND_PRINCE_8
from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel, kernel
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
    energies,
)
from mech_twin.machines.mb10_breaker.joint_laws import join_laws, project_contact, senses
from mech_twin.machines.mb10_breaker.motion import KEPT, OWN_SIGNALS, BreakerMotion, torques_at
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
    named,
)
from mech_twin.parts.induction_motor import MotorInStep

Array = NDArray[np.float64]
ERROR = 1e-13  # of a step, over the size of what it integrates
FAILURES = (
    f"mb10_breaker: more than {MOST_PIECES} pieces of motion in one step; shorten coupling.step_s",
    "mb10_breaker: no step of the motion is short enough; shorten coupling.step_s",
    "mb10_breaker: contacts contradict each other; shorten coupling.step_s",
)


class Total(NamedTuple):
    """Kinetic and potential energy of machine and tool (J), and the angular momentum M12 u + M22 p (N m s).

    ``size_j`` is the sum of the machine's kinetic and the amount of its potential energy.
    """

    energy_j: float
    momentum_nms: float
    size_j: float


@kernel
def total_of(b: Breaker, state: Any) -> Total:
    """Return energy and angular momentum of a state."""
    kinetic, potential, momentum = energies(
        b, state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    )
    tool = 0.5 * b.tool_mass_kg * state.tool_m_per_s * state.tool_m_per_s
    return Total(kinetic + potential + tool, momentum, kinetic + abs(potential))


@kernel
def take_body(
    b: Breaker, y: Array, memory: Any, regime: int, before: Total, phi: float, p: float, rests: bool, regimes: Indices
) -> tuple[int, Total]:
    """Set angle and rate of an externally simulated body, add the jumps of energy and momentum.

    Return regime and totals.  The breaker's own body returns the linkage's values: nothing changes.
    ``regimes`` (6,) are work.
    """
    state = named(y)
    if regime == HELD or (phi == state.body_rad and p == state.body_rad_per_s and rests == (regime == REST)):
        return regime, before
    carried = b.frame_drive > 0.0 and b.efficiency < 1.0 and regime == FLIGHT  # the gear's loss may hold its shaft
    carried = carried and state.crank_rad_per_s - b.frame_drive * state.body_rad_per_s == 0.0
    state.body_rad = 0.0 if rests or (phi < 0.0 <= p) else phi
    state.body_rad_per_s = 0.0 if rests else p
    if carried and not rests:
        state.crank_rad_per_s = p  # the gear's shaft stays at rest
    fill_regimes(REST if rests else FLIGHT, int(memory.tool_regime), regimes)
    if regimes[TOOL_LAW] == HOLD:
        project_contact(b, y, regimes)
    for law in range(LAWS):
        regimes[law] = OPEN
    after = total_of(b, state)
    memory.coupling_defect_j += after.energy_j - before.energy_j
    memory.coupling_defect_nms += after.momentum_nms - before.momentum_nms
    return REST if rests else FLIGHT, after


@kernel
def close_balances(
    b: Breaker, state: Any, memory: Any, before: Total, sums: tuple[float, float, float, float]
) -> Total:
    """Add the step's works and impulses to the sums before it, and its errors to the balances; return the totals."""
    lost = (
        memory.blow_loss_j + memory.collar_loss_j + memory.reseating_loss_j + state.wall_work_j + state.damping_loss_j
    )
    total, turned = total_of(b, state), state.angular_impulse_nms + memory.impact_impulse_nms
    memory.energy_j = total.energy_j
    memory.energy_error_j += total.energy_j - before.energy_j - state.drive_work_j + lost
    memory.momentum_error_nms += total.momentum_nms - before.momentum_nms - turned
    memory.blow_loss_j += sums[0]
    memory.collar_loss_j += sums[1]
    memory.reseating_loss_j += sums[2]
    memory.impact_impulse_nms += sums[3]
    memory.wall_work_j += state.wall_work_j
    memory.drive_work_j += state.drive_work_j
    memory.damping_loss_j += state.damping_loss_j
    memory.angular_impulse_nms += state.angular_impulse_nms
    memory.tool_travel_m, memory.tool_speed_m_per_s = state.tool_m, state.tool_m_per_s
    state.drive_work_j = state.damping_loss_j = state.angular_impulse_nms = state.wall_work_j = 0.0
    full = math.floor(state.crank_rad / TURN)
    memory.turns += full
    state.crank_rad -= full * TURN
    return total


@borrowing_kernel
def fill_regimes(regime: int, tool: int, regimes: Indices) -> None:
    """Fill the regimes of collar, wall and striker from those of body and tool in the sample."""
    regimes[COLLAR_LAW] = HOLD if regime == REST else OPEN
    regimes[WALL_LAW] = LOW if tool in (MOVING, PUSHED) else HOLD
    regimes[TOOL_LAW] = HOLD if tool in (PUSHED, BLOCKED) else OPEN


@borrowing_kernel
def reported_tool_regime(regimes: Indices) -> int:
    """Return the regime of the tool for the sample."""
    if regimes[TOOL_LAW] == HOLD:
        return BLOCKED if regimes[WALL_LAW] == HOLD else PUSHED
    return MOVING if regimes[WALL_LAW] == LOW else STANDING


@borrowing_kernel
def fill_tolerance(b: Breaker, y: Array, tolerance: Array) -> None:
    """Fill the error tolerances of an integration step."""
    u = 1.0 + abs(y[CRANK_RATE])
    for i in range(STATES):
        tolerance[i] = ERROR * (1.0 + b.crank.inertia_kg_m2 * u * u) if i >= 2 * FREEDOMS else ERROR
    for i in range(FREEDOMS, 2 * FREEDOMS):
        tolerance[i] = ERROR * (1.0 + abs(y[i]))


@inline_kernel
def breaker_room() -> tuple[int, int]:
    """Return the lengths of the float and integer arrays that `advance_step` needs."""
    size, places = room_sizes(FREEDOMS, LAWS, OWN_SIGNALS, STATES)
    return KEPT + size, LAWS + places


@inline_kernel
def advance_step(
    b: Breaker, motor: MotorInStep, y: Array, row: Array, regime: int, total: Total, begin_s: float, step_s: float,
    log: Array, numbers: Array, marks: Indices,
) -> tuple[int, int, float, Total]:  # fmt: skip
    """Advance state and memory by one coupling step.

    Return regime, number of events, and crank torque and totals at the end.

    Parameters
    ----------
    motor : MotorInStep
        The motor in this step.
    y : (10,) array
        As `state.BreakerState` names it; changed in place.
    row : array
        The memory, as `state.BreakerMemory` names it; changed in place.
    total : Total
        Totals at the start.
    begin_s : float
        Time at the start of the step (s).
    log : array
        Receives one row per event; the number is `LOG_FULL` if it may become too short.
    numbers, marks : array
        Work arrays of the lengths of `breaker_room`, zeros.
    """
    memory, state, tool = record_at(row, 0, MEMORY), named(y), int(row[TOOL_REGIME])
    room = room_in(numbers[KEPT:], marks[LAWS:], FREEDOMS, LAWS, OWN_SIGNALS, STATES, DORMAND_PRINCE_8)
    kept, regimes = numbers[:KEPT], marks[:LAWS]
    fill_regimes(regime, tool, regimes)
    join_laws(b, y, regimes, memory.crank_sense, memory.body_sense)
    memory.crank_sense, memory.body_sense = senses(b, y, regimes)
    fill_tolerance(b, y, room.tolerance)
    motion = BreakerMotion(b, motor, begin_s, step_s, row, kept, room.at)
    sums = (memory.blow_loss_j, memory.collar_loss_j, memory.reseating_loss_j, memory.impact_impulse_nms)
    # from zero, so that small terms keep their digits
    memory.blow_loss_j = memory.collar_loss_j = memory.reseating_loss_j = memory.impact_impulse_nms = 0.0
    system = declared(motion, room.at)
    count = advance(system, 0.0, step_s, y, regimes, room, log, 0)
    if count < 0:
        failure = count if count == LOG_FULL else -1 if count in (TOO_MANY, TOO_LONG) else max(count, -3)
        return regime, failure, 0.0, total
    now = torques_at(motion, step_s, y, regimes, room.at)
    memory.tool_regime = reported_tool_regime(regimes)
    memory.tool_force_n, memory.crank_friction_nm, memory.body_friction_nm = now.tool_force_n, now.crank_nm, now.body_nm
    memory.crank_sense, memory.body_sense = senses(b, y, regimes)
    total = close_balances(b, state, memory, total, sums)
    return HELD if b.held else REST if regimes[COLLAR_LAW] == HOLD else FLIGHT, count, now.drive_nm, total
