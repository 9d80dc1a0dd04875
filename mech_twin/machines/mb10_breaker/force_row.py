# SPDX-License-Identifier: Apache-2.0
"""The breaker's force analysis as a kernel: pin reactions, and the loads on the body during the step."""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.engine.compiled_steps import force_step, step_of, with_room
from mech_twin.engine.sample_vectors import (
    BODY_MOMENT,
    CONTACT,
    EVENT_WIDTH,
    IMPULSE,
    KIND,
    LOAD_CONTACT,
    LOAD_IMPULSE,
    LOAD_KIND,
    LOAD_TIME,
    MOMENT_AFTER,
    MOMENT_BEFORE,
    PINS,
    REGIME,
    SIDES,
    TIME,
    Array,
)
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import FLIGHT, HELD, Breaker
from mech_twin.machines.mb10_breaker.forces import QUANTITIES, PinForces, pin_forces, pin_impulses
from mech_twin.machines.mb10_breaker.impacts import gap
from mech_twin.machines.mb10_breaker.linkage_row import BODY_AT, CRANK_AT, memory_of
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
    LIFT_OFF,
    PUSH_BEGINS,
    PUSHING,
    RELEASED,
    SETTLED,
    TOUCHDOWN,
)

STRIKES = (BLOW, CATCH_UP, PUSH_BEGINS)
OF_BEARINGS = (CRANK_STOPPED, CRANK_STARTED, CRANK_REVERSED, BODY_STOPPED, BODY_STARTED, BODY_REVERSED)
OF_GEAR = (GEAR_STOPPED, GEAR_STARTED, GEAR_REVERSED)
LOADING = (*STRIKES, TOUCHDOWN, SETTLED, LIFT_OFF, PUSHING, RELEASED, *OF_BEARINGS, *OF_GEAR)
QUANTITIES_AT = PINS + 12
RESIDUALS_AT = QUANTITIES_AT + len(QUANTITIES)
# an event's coordinates on either side: angle (or way), rate, effort of crank, body, tool, crank bearing, body pivot
CRANK_SIDE, BODY_SIDE, TOOL_SIDE, BEARING_SIDE, PIVOT_SIDE, SIDE_WIDTH = 0, 3, 6, 9, 12, 15


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
def fill_loads(
    b: Breaker, log: Array, events: int, moment_nm: float, loads: Array
) -> tuple[Array, int, Impulses, float]:
    """Fill the loads on the body at each event of a step; return them, the sums, and the collar's impulse (N m s).

    ``moment_nm`` is the moment on the body at the end of the step, used for an event without coordinates.
    """
    count, collar, moment, crank, rocker, miss = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(events):
        event = log[i]
        if event[SIDES] == 0.0:
            loads = with_room(loads, count)
            write_load(loads[count], event, moment_nm, moment_nm, 0.0)
            count += 1
        elif int(event[KIND]) in LOADING:
            jump = across(b, event)
            pressed = collar_impulse(b, event, jump.moment)
            before = side_moment(b, event[EVENT_WIDTH : EVENT_WIDTH + SIDE_WIDTH])
            after = side_moment(b, event[EVENT_WIDTH + SIDE_WIDTH :])
            loads = with_room(loads, count)
            write_load(loads[count], event, before, after, jump.moment + pressed)
            count += 1
            collar += pressed
            moment += jump.moment
            crank = max(crank, math.hypot(jump.o_x, jump.o_y))
            rocker = max(rocker, math.hypot(jump.c_x, jump.c_y))
            miss = max(miss, abs(jump.drive))
    return loads, count, Impulses(moment, crank, rocker, miss), collar


@kernel
def largest_moment(b: Breaker, found: PinForces) -> float:
    """Return the largest term (N m) of the two routes to the moment: inertia, collar, and pin forces times lengths.

    It is the scale of their difference: with a heavy linkage on a light body the sum is far smaller than its terms.
    """
    spin = max(abs(found.crank_acceleration), abs(found.body_acceleration))
    return max(
        (b.crank.inertia_kg_m2 + b.rotor_11_kg_m2) * spin,
        b.body_inertia_kg_m2 * abs(found.body_acceleration),
        abs(found.collar_moment),
        b.bar.crank_m * math.hypot(found.a_x, found.a_y),
        b.bar.rocker_m * math.hypot(found.b_x, found.b_y),
        math.hypot(b.bar.pivot_x_m, b.bar.pivot_y_m) * math.hypot(found.c_x, found.c_y),
    )


@step_of(force_step, LoadedBreaker)
def breaker_forces(
    model: LoadedBreaker, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array
) -> tuple[Array, int]:
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
    loads, load_count, sums, collar = fill_loads(b, log, count, found.moment, loads)
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
    out[RESIDUALS_AT], out[RESIDUALS_AT + 1] = abs(found.drive_error) / scale, abs(found.body_error) / scale
    out[RESIDUALS_AT + 2] = sums.miss / scale
    return loads, load_count
