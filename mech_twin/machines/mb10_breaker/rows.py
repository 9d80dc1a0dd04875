# SPDX-License-Identifier: Apache-2.0
"""The breaker's linkage and forces as rows of numbers: their layout, and the kernels that fill them.

The kernels are those of a coupling step, of the motor and of the force analysis (pin reactions, loads on the body).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.addresses import record_at
from mech_twin.engine.compiled_steps import Work, force_step, linkage_step, motor_step, step_of, work_room
from mech_twin.engine.sample_vectors import (
    BODY_JOINTS,
    BODY_MOMENT,
    COMMAND,
    CONTACT,
    EVENT_WIDTH,
    IMPULSE,
    KIND,
    LINKAGE_JOINTS,
    LOAD_CONTACT,
    LOAD_IMPULSE,
    LOAD_KIND,
    LOAD_TIME,
    MOMENT_AFTER,
    MOMENT_BEFORE,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    PINS,
    REGIME,
    SIDES,
    TIME,
    Array,
)
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.drives import KlossMotor, fill_motor
from mech_twin.machines.mb10_breaker.dynamics import FLIGHT, HELD, REST, Breaker, spring_moment
from mech_twin.machines.mb10_breaker.forces import QUANTITIES, PinForces, pin_forces, pin_impulses
from mech_twin.machines.mb10_breaker.impacts import gap
from mech_twin.machines.mb10_breaker.motion import rotor_speed
from mech_twin.machines.mb10_breaker.state import (
    BLOW,
    BODY_REVERSED,
    BODY_STARTED,
    BODY_STOPPED,
    CATCH_UP,
    CRANK_REVERSED,
    CRANK_STARTED,
    CRANK_STOPPED,
    GEAR_REVERSED,
    GEAR_STARTED,
    GEAR_STOPPED,
    LAWS,
    LIFT_OFF,
    MEMORY,
    PUSH_BEGINS,
    PUSHING,
    RELEASED,
    SETTLED,
    STATES,
    TOUCHDOWN,
    BreakerMemory,
    named,
)
from mech_twin.machines.mb10_breaker.step import Total, advance_step, breaker_room, take_body, total_of
from mech_twin.parts.four_bar import closure_error, coefficients, link_angles, position
from mech_twin.parts.induction_motor import MotorConstants, motor_in_step

JOINTS = ("crank", "coupler", "rocker", "body")
LEAST_RATE_RAD_PER_S = 1e-4  # momentum is balanced over that of parts so fast: 1e-9 of it is what a step may miss
# places in a row
CRANK_AT, COUPLER_AT, ROCKER_AT, BODY_AT = range(LINKAGE_JOINTS, LINKAGE_JOINTS + 12, 3)
MEMORY_AT = LINKAGE_JOINTS + 12
RESIDUALS_AT = MEMORY_AT + len(BreakerMemory._fields)
STRIKES = (BLOW, CATCH_UP, PUSH_BEGINS)
OF_BEARINGS = (CRANK_STOPPED, CRANK_STARTED, CRANK_REVERSED, BODY_STOPPED, BODY_STARTED, BODY_REVERSED)
OF_GEAR = (GEAR_STOPPED, GEAR_STARTED, GEAR_REVERSED)
LOADING = (*STRIKES, TOUCHDOWN, SETTLED, LIFT_OFF, PUSHING, RELEASED, *OF_BEARINGS, *OF_GEAR)
QUANTITIES_AT = PINS + 12
FORCE_RESIDUALS_AT = QUANTITIES_AT + len(QUANTITIES)
# an event's coordinates on either side: angle (or way), rate, effort of crank, body, tool, crank bearing, body pivot
CRANK_SIDE, BODY_SIDE, TOOL_SIDE, BEARING_SIDE, PIVOT_SIDE, SIDE_WIDTH = 0, 3, 6, 9, 12, 15


class GearedMotor(NamedTuple):
    """Constants of the motor role: the drive; 1 where its housing turns with the body."""

    drive: KlossMotor
    frame_drive: float


class LedBreaker(NamedTuple):
    """Constants of the linkage role: breaker, the motor's curve, and coupling step (s)."""

    breaker: Breaker
    curve: MotorConstants
    step_s: float


@step_of(motor_step, GearedMotor)
def geared_motor(model: GearedMotor, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` with the motor at the gear output's angle and speed relative to it: q - phi on the frame, else q."""
    carried = model.frame_drive
    turned = 2.0 * math.pi * linkage[MEMORY_AT] + linkage[CRANK_AT]
    angle = turned - carried * linkage[BODY_AT]
    fill_motor(
        model.drive, linkage[COMMAND], angle, linkage[CRANK_AT + 1] - carried * linkage[BODY_AT + 1], target, out
    )


@borrowing_kernel
def memory_of(row: Array) -> Any:
    """Return the memory of a linkage row as a record that shares its numbers."""
    return record_at(row, MEMORY_AT, MEMORY)


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
def start_row(b: Breaker, crank_rad: float, command: float, out: Array) -> None:
    """Fill the row of the machine at rest, the body on its collar."""
    y = np.zeros(STATES)
    named(y).crank_rad = crank_rad
    total = total_of(b, named(y))
    out[MEMORY_AT:RESIDUALS_AT] = 0.0
    memory = memory_of(out)
    memory.energy_j = total.energy_j
    fill_row(b, y, HELD if b.held else REST, total, 0.0, command, 0.0, 0.0, out)


@step_of(work_room, LedBreaker, borrowing_kernel)
def room_of_step(model: LedBreaker) -> tuple[int, int]:
    """Return the lengths of the work arrays of `breaker_step`."""
    size, places = breaker_room()
    return STATES + size, places


@step_of(linkage_step, LedBreaker, borrowing_kernel)
def breaker_step(
    model: LedBreaker, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> int:
    """Fill ``out`` with the linkage one step later; angle and rate of the body are taken from its own row."""
    b, y, regime = model.breaker, work.numbers[:STATES], int(linkage[REGIME])
    for i in range(len(out)):
        out[i] = linkage[i]
    state, memory = named(y), memory_of(out)
    state.crank_rad, state.crank_rad_per_s = linkage[CRANK_AT], linkage[CRANK_AT + 1]
    state.body_rad, state.body_rad_per_s = linkage[BODY_AT], linkage[BODY_AT + 1]
    state.tool_m, state.tool_m_per_s = memory.tool_travel_m, memory.tool_speed_m_per_s
    total = total_of(b, state)
    memory.parameter_work_j += total.energy_j - memory.energy_j
    defect = memory.coupling_defect_j
    if len(body) > 0:
        rests = int(body[REGIME]) == REST
        phi, p = body[BODY_JOINTS], body[BODY_JOINTS + 1]
        regime, total = take_body(b, y, memory, regime, total, phi, p, rests, work.marks[:LAWS])
    command = motor[MOTOR_COMMAND]
    rotor = rotor_speed(b, state.crank_rad_per_s, state.body_rad_per_s)
    turning = motor_in_step(model.curve, linkage[COMMAND], rotor, motor[MOTOR_JOINTS + 2], command, model.step_s)
    regime, count, torque, total = advance_step(
        b, turning, y, out[MEMORY_AT:RESIDUALS_AT], regime, total, step * model.step_s, model.step_s, log,
        work.numbers[STATES:], work.marks,
    )  # fmt: skip
    if count >= 0:
        fill_row(b, y, regime, total, torque, command, memory.coupling_defect_j - defect, model.step_s, out)
    return count


class LoadedBreaker(NamedTuple):
    """Constants of the force analysis."""

    breaker: Breaker


class Impulses(NamedTuple):
    """Of the events of a step: moments on the body (N m s), largest at both bearings (N s), largest miss (N m s)."""

    moment: float
    crank_bearing: float
    rocker_bearing: float
    miss: float


@kernel
def across(b: Breaker, event: Array) -> PinForces:
    """Return the impulsive pin reactions of an event."""
    before, after = event[EVENT_WIDTH : EVENT_WIDTH + SIDE_WIDTH], event[EVENT_WIDTH + SIDE_WIDTH :]
    return pin_impulses(
        b,
        before[CRANK_SIDE],
        before[BODY_SIDE],
        after[CRANK_SIDE + 1] - before[CRANK_SIDE + 1],
        after[BODY_SIDE + 1] - before[BODY_SIDE + 1],
        event[IMPULSE] if int(event[KIND]) in STRIKES else 0.0,
    )


@kernel
def collar_impulse(b: Breaker, event: Array, moment: float) -> float:
    """Return the collar's angular impulse (N m s) on a body that stays at rest on it during a blow."""
    before, after = event[EVENT_WIDTH : EVENT_WIDTH + SIDE_WIDTH], event[EVENT_WIDTH + SIDE_WIDTH :]
    rests = before[BODY_SIDE] == 0.0 and before[BODY_SIDE + 1] == 0.0 and after[BODY_SIDE + 1] == 0.0
    return -moment if rests and int(event[KIND]) in STRIKES and not b.held else 0.0


@kernel
def side_moment(b: Breaker, side: Array) -> float:
    """Return the moment on the body (N m) on one side of an event."""
    return pin_forces(
        b,
        side[CRANK_SIDE],
        side[CRANK_SIDE + 1],
        side[BODY_SIDE],
        side[BODY_SIDE + 1],
        side[CRANK_SIDE + 2],
        HELD if b.held else FLIGHT,
        side[TOOL_SIDE + 2],
        side[BEARING_SIDE + 2],
        side[PIVOT_SIDE + 2],
    ).moment


@kernel
def write_load(load: Array, event: Array, before_nm: float, after_nm: float, impulse_nms: float) -> None:
    """Write the load of an event into a row."""
    load[LOAD_TIME], load[LOAD_KIND], load[LOAD_CONTACT] = event[TIME], event[KIND], event[CONTACT]
    load[MOMENT_BEFORE], load[MOMENT_AFTER], load[LOAD_IMPULSE] = before_nm, after_nm, impulse_nms


@kernel
def fill_loads(b: Breaker, log: Array, events: int, moment_nm: float, loads: Array) -> tuple[int, Impulses, float]:
    """Fill the loads on the body at each event; return their number, the sums, and the collar's impulse (N m s).

    ``moment_nm`` is the moment on the body at the end of the step, used for an event without coordinates.
    """
    count, collar, moment, crank, rocker, miss = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(events):
        event = log[i]
        if event[SIDES] == 0.0:
            write_load(loads[count], event, moment_nm, moment_nm, 0.0)
            count += 1
        elif int(event[KIND]) in LOADING:
            jump = across(b, event)
            pressed = collar_impulse(b, event, jump.moment)
            before = side_moment(b, event[EVENT_WIDTH : EVENT_WIDTH + SIDE_WIDTH])
            after = side_moment(b, event[EVENT_WIDTH + SIDE_WIDTH :])
            write_load(loads[count], event, before, after, jump.moment + pressed)
            count += 1
            collar += pressed
            moment += jump.moment
            crank = max(crank, math.hypot(jump.o_x, jump.o_y))
            rocker = max(rocker, math.hypot(jump.c_x, jump.c_y))
            miss = max(miss, abs(jump.drive))
    return count, Impulses(moment, crank, rocker, miss), collar


@kernel
def largest_moment(b: Breaker, found: PinForces) -> float:
    """Return the largest term (N m) of the two routes to the moment: inertia, collar, and pin forces times lengths.

    It is the scale of their difference: with a heavy linkage on a light body the sum is far smaller than its terms.
    Coupler and rocker count with their mass at its farthest from the crank's bearing.
    """
    spin = max(abs(found.crank_acceleration), abs(found.body_acceleration))
    coupler = b.bar.crank_m + math.hypot(b.coupler.along_m, b.coupler.across_m)
    rocker = math.hypot(b.bar.pivot_x_m, b.bar.pivot_y_m) + math.hypot(b.rocker.along_m, b.rocker.across_m)
    return max(
        (b.crank.inertia_kg_m2 + b.rotor_11_kg_m2) * spin,
        b.coupler.mass_kg * coupler * coupler * spin,
        b.rocker.mass_kg * rocker * rocker * spin,
        b.body_inertia_kg_m2 * abs(found.body_acceleration),
        abs(found.collar_moment),
        b.bar.crank_m * math.hypot(found.a_x, found.a_y),
        b.bar.rocker_m * math.hypot(found.b_x, found.b_y),
        math.hypot(b.bar.pivot_x_m, b.bar.pivot_y_m) * math.hypot(found.c_x, found.c_y),
    )


@step_of(force_step, LoadedBreaker, borrowing_kernel)
def breaker_forces(
    model: LoadedBreaker, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with the forces at the step, and the loads on the body at each event of the step."""
    b, memory, regime = model.breaker, memory_of(linkage), int(linkage[REGIME])
    q, u, torque, phi, p = (
        linkage[CRANK_AT],
        linkage[CRANK_AT + 1],
        linkage[CRANK_AT + 2],
        linkage[BODY_AT],
        linkage[BODY_AT + 1],
    )
    found = pin_forces(
        b, q, u, phi, p, torque, regime, memory.tool_force_n, memory.crank_friction_nm, memory.body_friction_nm
    )
    load_count, sums, collar = fill_loads(b, log, count, found.moment, loads)
    opening, closing = gap(b, q, u, phi, p)
    out[BODY_MOMENT] = found.moment
    numbers = (
        found.o_x, found.o_y, 0.0,
        found.a_x, found.a_y, 0.0,
        found.b_x, found.b_y, 0.0,
        found.c_x, found.c_y, 0.0,
        found.drive,
        found.crank_acceleration,
        found.body_acceleration,
        phi,
        p,
        found.collar_moment / b.tool_radius_m,
        b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_m),
        -found.o_x - found.c_x,
        -found.o_y - found.c_y,
        opening,
        closing,
        sums.moment,
        sums.crank_bearing,
        sums.rocker_bearing,
        found.tool_force,
        collar,
    )  # fmt: skip
    for i in range(len(numbers)):
        out[PINS + i] = numbers[i]
    scale = max(abs(found.drive), b.crank.inertia_kg_m2 * u * u, 1.0, largest_moment(b, found))
    out[FORCE_RESIDUALS_AT], out[FORCE_RESIDUALS_AT + 1] = abs(found.drive_error) / scale, abs(found.body_error) / scale
    out[FORCE_RESIDUALS_AT + 2] = sums.miss / scale
    return load_count
