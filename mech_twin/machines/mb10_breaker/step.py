# SPDX-License-Identifier: Apache-2.0
"""The breaker's linkage as a row of numbers, and one coupling step of it: from t_n to t_n+1 through all events."""

import math
from typing import Any, NamedTuple

from mech_twin.engine.addresses import record_at
from mech_twin.engine.compiled_steps import LOG_FULL, Work, copy_numbers, linkage_step, step_of, work_room
from mech_twin.engine.hybrid.laws import HOLD, LOW, OPEN, Indices
from mech_twin.engine.hybrid.loop import MOST_PIECES, TOO_LONG, TOO_MANY, advance, room_in, room_sizes
from mech_twin.engine.hybrid.type_erasure import declared
from mech_twin.engine.integration import DORMAND_PRINCE_8
from mech_twin.engine.sample_vectors import (
    BODY_JOINTS,
    COMMAND,
    LINKAGE_JOINTS,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    REGIME,
    Array,
)
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
    energies,
    spring_moment,
)
from mech_twin.machines.mb10_breaker.joint_laws import join_laws, project_contact, senses
from mech_twin.machines.mb10_breaker.motion import KEPT, OWN_SIGNALS, BreakerMotion, rotor_speed, torques_at
from mech_twin.machines.mb10_breaker.state import (
    CRANK_RATE,
    FREEDOMS,
    LAW,
    LAWS,
    MEMORY,
    STATES,
    BreakerMemory,
    named,
)
from mech_twin.parts.four_bar import closure_error, coefficients, link_angles, position
from mech_twin.parts.induction_motor import MotorConstants, motor_in_step

ERROR = 1e-13  # of a step, over the size of what it integrates
LEAST_RATE_RAD_PER_S = 1e-4  # momentum is balanced over that of parts so fast: 1e-9 of it is what a step may miss
FAILURES = (
    f"mb10_breaker: more than {MOST_PIECES} pieces of motion in one step; shorten coupling.step_s",
    "mb10_breaker: no step of the motion is short enough; shorten coupling.step_s",
    "mb10_breaker: contacts contradict each other; shorten coupling.step_s",
)
JOINTS = ("crank", "coupler", "rocker", "body")
# places in a row
CRANK_AT, COUPLER_AT, ROCKER_AT, BODY_AT = range(LINKAGE_JOINTS, LINKAGE_JOINTS + 12, 3)
MEMORY_AT = LINKAGE_JOINTS + 12
RESIDUALS_AT = MEMORY_AT + len(BreakerMemory._fields)


class LedBreaker(NamedTuple):
    """Constants of the linkage role: breaker, the motor's curve, and coupling step (s)."""

    breaker: Breaker
    curve: MotorConstants
    step_s: float


@borrowing_kernel
def memory_of(row: Array) -> Any:
    """Return the memory of a linkage row as a record that shares its numbers."""
    return record_at(row, MEMORY_AT, MEMORY)


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
def fill_row(
    b: Breaker, y: Array, regime: int, total: Total, drive: float, command: float, defect_j: float, step_s: float,
    out: Array,
) -> None:  # fmt: skip
    """Fill a linkage row whose memory is in place: joints, regime, command and residuals.

    Parameters
    ----------
    y : (10,) array
        As `state.BreakerState` names it.
    total : Total
        Energy and momentum in this state.
    drive : float
        Torque on the crank at the end of the step (N m).
    defect_j : float
        Jump of energy (J) at the start of the step by an externally simulated body.
    step_s : float
        Coupling step (s).  The momentum error is scaled by at least the springs' angular impulse in a step: the
        impulses of spring and collar are summed with its rounding.
    """
    memory, state = memory_of(out), named(y)
    q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    at = position(b.bar, q)
    by = coefficients(at)
    coupler, rocker = link_angles(at)
    out[REGIME], out[COMMAND] = regime, command
    out[CRANK_AT], out[CRANK_AT + 1], out[CRANK_AT + 2] = q, u, drive
    out[COUPLER_AT], out[COUPLER_AT + 1], out[COUPLER_AT + 2] = coupler, by.g2 * u, 0.0
    out[ROCKER_AT], out[ROCKER_AT + 1], out[ROCKER_AT + 2] = rocker, by.g3 * u, 0.0
    out[BODY_AT], out[BODY_AT + 1], out[BODY_AT + 2] = phi, p, -spring_moment(b, phi)
    turned = b.body_inertia_kg_m2 + b.crank.inertia_kg_m2 + abs(b.rotor_12_kg_m2)
    missed = turned * LEAST_RATE_RAD_PER_S
    held = max(total.size_j, 1.0)
    turning = max(abs(total.momentum_nms), abs(spring_moment(b, phi)) * step_s, missed, 1.0)
    out[RESIDUALS_AT] = closure_error(b.bar, at)
    out[RESIDUALS_AT + 1] = abs(memory.energy_error_j) / held
    out[RESIDUALS_AT + 2] = 0.0 if b.held else abs(memory.momentum_error_nms) / turning
    out[RESIDUALS_AT + 3] = abs(defect_j) / held


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
    if regimes[LAW.tool] == HOLD:
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
    regimes[LAW.collar] = HOLD if regime == REST else OPEN
    regimes[LAW.wall] = LOW if tool in (MOVING, PUSHED) else HOLD
    regimes[LAW.tool] = HOLD if tool in (PUSHED, BLOCKED) else OPEN


@borrowing_kernel
def reported_tool_regime(regimes: Indices) -> int:
    """Return the regime of the tool for the sample."""
    if regimes[LAW.tool] == HOLD:
        return BLOCKED if regimes[LAW.wall] == HOLD else PUSHED
    return MOVING if regimes[LAW.wall] == LOW else STANDING


@borrowing_kernel
def fill_tolerance(b: Breaker, y: Array, tolerance: Array) -> None:
    """Fill the error tolerances of an integration step."""
    u = 1.0 + abs(y[CRANK_RATE])
    for i in range(STATES):
        tolerance[i] = ERROR * (1.0 + b.crank.inertia_kg_m2 * u * u) if i >= 2 * FREEDOMS else ERROR
    for i in range(FREEDOMS, 2 * FREEDOMS):
        tolerance[i] = ERROR * (1.0 + abs(y[i]))


@step_of(work_room, LedBreaker, borrowing_kernel)
def room_of_step(model: LedBreaker) -> tuple[int, int]:
    """Return the lengths of the work arrays of `breaker_step`."""
    size, places = room_sizes(FREEDOMS, LAWS, OWN_SIGNALS, STATES)
    return STATES + KEPT + size, LAWS + places


@step_of(linkage_step, LedBreaker, borrowing_kernel)
def breaker_step(
    model: LedBreaker, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> int:
    """Fill ``out`` with the linkage one step later; angle and rate of the body are taken from its own row."""
    copy_numbers(linkage, out)
    b, step_s, regime, row = model.breaker, model.step_s, int(linkage[REGIME]), out[MEMORY_AT:RESIDUALS_AT]
    y, kept, regimes = work.numbers[:STATES], work.numbers[STATES : STATES + KEPT], work.marks[:LAWS]
    state, memory = named(y), memory_of(out)
    state.crank_rad, state.crank_rad_per_s = linkage[CRANK_AT], linkage[CRANK_AT + 1]
    state.body_rad, state.body_rad_per_s = linkage[BODY_AT], linkage[BODY_AT + 1]
    state.tool_m, state.tool_m_per_s = memory.tool_travel_m, memory.tool_speed_m_per_s
    total = total_of(b, state)
    memory.parameter_work_j += total.energy_j - memory.energy_j
    defect = memory.coupling_defect_j
    if len(body) > 0:
        rests = int(body[REGIME]) == REST
        regime, total = take_body(b, y, memory, regime, total, body[BODY_JOINTS], body[BODY_JOINTS + 1], rests, regimes)
    command, rotor = motor[MOTOR_COMMAND], rotor_speed(b, state.crank_rad_per_s, state.body_rad_per_s)
    turning = motor_in_step(model.curve, linkage[COMMAND], rotor, motor[MOTOR_JOINTS + 2], command, step_s)
    numbers, marks = work.numbers[STATES + KEPT :], work.marks[LAWS:]
    room = room_in(numbers, marks, FREEDOMS, LAWS, OWN_SIGNALS, STATES, DORMAND_PRINCE_8)
    fill_regimes(regime, int(memory.tool_regime), regimes)
    join_laws(b, y, regimes, memory.crank_sense, memory.body_sense)
    memory.crank_sense, memory.body_sense = senses(b, y, regimes)
    fill_tolerance(b, y, room.tolerance)
    sums = (memory.blow_loss_j, memory.collar_loss_j, memory.reseating_loss_j, memory.impact_impulse_nms)
    # from zero, so that small terms keep their digits
    memory.blow_loss_j = memory.collar_loss_j = memory.reseating_loss_j = memory.impact_impulse_nms = 0.0
    motion = BreakerMotion(b, turning, step * step_s, step_s, row, kept, room.at)
    system = declared(motion, room.at)
    count = advance(system, 0.0, step_s, y, regimes, room, log, 0)
    if count < 0:
        return count if count == LOG_FULL else -1 if count in (TOO_MANY, TOO_LONG) else max(count, -3)
    now = torques_at(motion, step_s, y, regimes, room.at)
    memory.tool_regime = reported_tool_regime(regimes)
    memory.tool_force_n, memory.crank_friction_nm, memory.body_friction_nm = now.tool_force_n, now.crank_nm, now.body_nm
    memory.crank_sense, memory.body_sense = senses(b, y, regimes)
    total = close_balances(b, state, memory, total, sums)
    regime = HELD if b.held else REST if regimes[LAW.collar] == HOLD else FLIGHT
    fill_row(b, y, regime, total, now.drive_nm, command, memory.coupling_defect_j - defect, step_s, out)
    return count
