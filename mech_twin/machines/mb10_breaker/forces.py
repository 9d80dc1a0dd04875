# SPDX-License-Identifier: Apache-2.0
"""Force analysis of the breaker: pin reactions between impacts and across them, and the body under their moment.

The accelerations follow from the joint states and the crank's torque by the reduced masses.  The pin reactions follow
from the equilibrium of links 2 and 3.  They give the torque on the crank and the moment on the body a second time.
Forces are in the frame of the machine; a moment that lifts the body is positive.
"""

import math
from typing import NamedTuple

from mech_twin.engine.compiled_steps import Work, body_step, copy_numbers, force_step, step_of
from mech_twin.engine.sample_vectors import (
    BODY_JOINTS,
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
    PRESSING_FORCE,
    REGIME,
    SIDES,
    TIME,
    Array,
)
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.mb10_breaker.dynamics import (
    FLIGHT,
    HELD,
    Breaker,
    accelerations,
    masses,
    spring_moment,
)
from mech_twin.machines.mb10_breaker.impacts import gap
from mech_twin.machines.mb10_breaker.joint_laws import SIDE_WIDTH
from mech_twin.machines.mb10_breaker.state import EVENT
from mech_twin.machines.mb10_breaker.step import BODY_AT, CRANK_AT, memory_of
from mech_twin.parts.four_bar import (
    Coefficients,
    Position,
    coefficients,
    dyad_reactions,
    offset,
    point_acceleration,
    position,
)

QUANTITIES = (
    "drive_torque_nm",
    "crank_acceleration_rad_per_s2",
    "body_acceleration_rad_per_s2",
    "body_angle_rad",
    "body_rate_rad_per_s",
    "collar_force_n",
    "spring_force_n",
    "shaking_force_x_n",
    "shaking_force_y_n",
    "striker_gap_m",
    "closing_speed_m_per_s",
    "blow_impulse_on_body_nms",
    "crank_bearing_impulse_ns",
    "rocker_bearing_impulse_ns",
    "tool_force_n",
    "collar_impulse_nms",
)
QUANTITIES_AT = PINS + 12
FORCE_RESIDUALS_AT = QUANTITIES_AT + len(QUANTITIES)
LED_ANGLE, LED_RATE = (QUANTITIES_AT + QUANTITIES.index(name) for name in ("body_angle_rad", "body_rate_rad_per_s"))
STRIKES = (EVENT.blow, EVENT.catch_up, EVENT.push_begins)
UNLOADING = (EVENT.missed, EVENT.off_collar, EVENT.stalled)
# an event's coordinates on either side: angle (or way), rate, effort of crank, body, tool, crank bearing, body pivot
CRANK_SIDE, BODY_SIDE, TOOL_SIDE, BEARING_SIDE, PIVOT_SIDE = range(0, SIDE_WIDTH, 3)
IN_CONTACT, FLYING, HANGING = 0, 1, 2  # regimes of the body in its own sample


class PinForces(NamedTuple):
    """Pin reactions (N; N s across an impact) and what follows from them.

    o: body on crank, a: crank on coupler, b: rocker on coupler, c: body on rocker.  ``drive`` is the torque on the
    crank behind the gear and ``moment`` the moment on the body, both from the pin reactions.  The errors are the
    differences between the two routes.
    """

    o_x: float
    o_y: float
    a_x: float
    a_y: float
    b_x: float
    b_y: float
    c_x: float
    c_y: float
    drive: float
    moment: float
    crank_acceleration: float
    body_acceleration: float
    collar_moment: float
    drive_error: float
    body_error: float
    tool_force: float


@kernel
def absolute(
    x: float, y: float, rel_vx: float, rel_vy: float, rel_ax: float, rel_ay: float, turn: float, spin: float
) -> tuple[float, float]:
    """Return the absolute acceleration of a point at (x, y) of a frame turning with rate ``turn``, axes of the frame.

    a = a_rel + 2 turn k x v_rel + spin k x r - turn^2 r.
    """
    t_x, t_y = point_acceleration(x, y, turn, spin)
    return rel_ax - 2.0 * turn * rel_vy + t_x, rel_ay + 2.0 * turn * rel_vx + t_y


@kernel
def in_frame(phi: float, x: float, y: float) -> tuple[float, float]:
    """Return a vector of the body's axes in the machine's frame (the body has turned clockwise by phi)."""
    c, s = math.cos(phi), math.sin(phi)
    return c * x + s * y, c * y - s * x


@kernel
def equilibrium(
    b: Breaker, at: Position, by: Coefficients, phi: float, u: float, p: float, du: float, dp: float, g_x: float,
    g_y: float, f1_x: float, f1_y: float, thrust: float, friction: float,
) -> tuple[float, float, float, float, float, float, float, float, float, float]:  # fmt: skip
    """Return pin reactions, torque on the crank and moment on the body (10 numbers), in the order of `PinForces`.

    Across an impact rates and gravity are zero, du and dp the jumps, the thrust and all that follows impulses.
    ``f1`` is the force of weight and inertia on the crank.
    """
    # coupler: relative to the body its centroid is carried by A and by its own turning
    x, y = offset(b.coupler, at.u_x, at.u_y, b.bar.coupler_m)
    w, e = by.g2 * u, by.g2 * du + by.g2_1 * u * u
    p_x, p_y = point_acceleration(at.a_x, at.a_y, u, du)
    s_x, s_y = point_acceleration(x, y, w, e)
    a_x, a_y = absolute(at.a_x + x, at.a_y + y, -at.a_y * u - y * w, at.a_x * u + x * w, p_x + s_x, p_y + s_y, -p, -dp)
    f2_x, f2_y = b.coupler.mass_kg * (g_x - a_x), b.coupler.mass_kg * (g_y - a_y)
    moment2 = x * f2_y - y * f2_x - b.coupler.inertia_kg_m2 * (e - dp)
    # rocker
    x, y = offset(b.rocker, at.v_x, at.v_y, b.bar.rocker_m)
    w, e = by.g3 * u, by.g3 * du + by.g3_1 * u * u
    s_x, s_y = point_acceleration(x, y, w, e)
    a_x, a_y = absolute(b.bar.pivot_x_m + x, b.bar.pivot_y_m + y, -y * w, x * w, s_x, s_y, -p, -dp)
    f3_x, f3_y = b.rocker.mass_kg * (g_x - a_x), b.rocker.mass_kg * (g_y - a_y)
    moment3 = x * f3_y - y * f3_x - b.rocker.inertia_kg_m2 * (e - dp)
    f3_x, f3_y, moment3 = f3_x - thrust * b.n_x, f3_y - thrust * b.n_y, moment3 - thrust * b.striker_arm_m
    a_x, a_y, b_x, b_y, c_x, c_y = dyad_reactions(at, f2_x, f2_y, moment2, f3_x, f3_y, moment3)
    # crank
    x, y = offset(b.crank, at.a_x, at.a_y, b.bar.crank_m)
    o_x, o_y = a_x - f1_x, a_y - f1_y
    torque = b.crank.inertia_kg_m2 * (du - dp) + at.a_x * a_y - at.a_y * a_x - b.crank.mass_kg * (x * g_y - y * g_x)
    needed = torque + b.rotor_11_kg_m2 * du + b.rotor_12_kg_m2 * dp
    moment = b.bar.pivot_x_m * c_y - b.bar.pivot_y_m * c_x
    moment += (1.0 - b.frame_drive) * (torque - b.rotor_12_kg_m2 * du - b.rotor_22_kg_m2 * dp)
    moment -= b.frame_drive * friction  # of the crank's bearing; on the body it is in the torque above
    o_x, o_y = in_frame(phi, o_x, o_y)
    a_x, a_y = in_frame(phi, a_x, a_y)
    b_x, b_y = in_frame(phi, b_x, b_y)
    c_x, c_y = in_frame(phi, c_x, c_y)
    return o_x, o_y, a_x, a_y, b_x, b_y, c_x, c_y, needed, moment


@kernel
def pin_forces(
    b: Breaker,
    q: float,
    u: float,
    phi: float,
    p: float,
    drive: float,
    regime: int,
    thrust: float = 0.0,
    crank_nm: float = 0.0,
    body_nm: float = 0.0,
) -> PinForces:
    """Return every reaction in one state under a torque on the crank (N m) and the tool's force on the striker (N).

    ``crank_nm`` and ``body_nm`` are the Coulomb friction on crank and body (N m), sliding or held.
    """
    at = position(b.bar, q)
    by = coefficients(at)
    m = masses(b, at, by, phi)
    still = regime == HELD or (phi == 0.0 and p == 0.0)
    du, dp, collar = accelerations(b, m, q, u, phi, p, drive, still, thrust, crank_nm, body_nm)
    if still and regime != HELD and collar < 0.0:  # the collar can only push: the body is leaving it
        du, dp, collar = accelerations(b, m, q, u, phi, p, drive, False, thrust, crank_nm, body_nm)
    g_x, g_y = b.gravity_m_per_s2 * math.sin(phi), -b.gravity_m_per_s2 * math.cos(phi)
    x, y = offset(b.crank, at.a_x, at.a_y, b.bar.crank_m)
    s_x, s_y = point_acceleration(x, y, u - p, du - dp)
    f1_x, f1_y = b.crank.mass_kg * (g_x - s_x), b.crank.mass_kg * (g_y - s_y)
    friction = b.crank_viscous_nms_per_rad * u - crank_nm
    found = equilibrium(b, at, by, phi, u, p, du, dp, g_x, g_y, f1_x, f1_y, thrust, friction)
    held = b.body_inertia_kg_m2 * dp + spring_moment(b, phi) + b.body_damping_nms_per_rad * p - body_nm
    drive_error, body_error = found[8] - drive + friction, held - collar - found[9]
    return PinForces(*found, du, dp, collar, drive_error, body_error, thrust)


@kernel
def pin_impulses(b: Breaker, q: float, phi: float, du: float, dp: float, blow: float) -> PinForces:
    """Return the impulsive pin reactions for speed jumps du, dp of crank and body (rad/s) and a blow (N s).

    The blow acts on the rocker along -n at the arm of the striker.
    """
    at = position(b.bar, q)
    x, y = offset(b.crank, at.a_x, at.a_y, b.bar.crank_m)
    f1_x, f1_y = b.crank.mass_kg * y * (du - dp), -b.crank.mass_kg * x * (du - dp)
    found = equilibrium(b, at, coefficients(at), phi, 0.0, 0.0, du, dp, 0.0, 0.0, f1_x, f1_y, blow, 0.0)
    error = b.body_inertia_kg_m2 * dp - found[9]
    return PinForces(*found, du, dp, -error, found[8], error, blow)


class LoadedBreaker(NamedTuple):
    """Constants of the force analysis, and of the body that follows the linkage."""

    breaker: Breaker


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
) -> tuple[int, float, float, float, float, float]:
    """Fill the loads on the body at each event; return their number, sums and extremes.

    After the number: the sum of the moments on the body (N m s), the largest impulses at crank and rocker bearing
    (N s).  Then the largest miss of the two routes, and the collar's impulse on a body that stays at rest (N m s).
    ``moment_nm`` is the moment on the body at the end of the step, used for an event without coordinates.
    """
    count, moment, crank, rocker, miss, collar = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(events):
        event, kind = log[i], int(log[i, KIND])
        if event[SIDES] == 0.0:
            write_load(loads[count], event, moment_nm, moment_nm, 0.0)
            count += 1
        elif kind not in UNLOADING:
            before, after = event[EVENT_WIDTH : EVENT_WIDTH + SIDE_WIDTH], event[EVENT_WIDTH + SIDE_WIDTH :]
            du, dp = after[CRANK_SIDE + 1] - before[CRANK_SIDE + 1], after[BODY_SIDE + 1] - before[BODY_SIDE + 1]
            struck = event[IMPULSE] if kind in STRIKES else 0.0
            jump = pin_impulses(b, before[CRANK_SIDE], before[BODY_SIDE], du, dp, struck)
            rests = before[BODY_SIDE] == 0.0 and before[BODY_SIDE + 1] == 0.0 and after[BODY_SIDE + 1] == 0.0
            pressed = -jump.moment if rests and kind in STRIKES and not b.held else 0.0
            write_load(loads[count], event, side_moment(b, before), side_moment(b, after), jump.moment + pressed)
            count += 1
            collar += pressed
            moment += jump.moment
            crank = max(crank, math.hypot(jump.o_x, jump.o_y))
            rocker = max(rocker, math.hypot(jump.c_x, jump.c_y))
            miss = max(miss, abs(jump.drive))
    return count, moment, crank, rocker, miss, collar


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
    load_count, moment, crank, rocker, miss, collar = fill_loads(b, log, count, found.moment, loads)
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
        moment,
        crank,
        rocker,
        found.tool_force,
        collar,
    )  # fmt: skip
    copy_numbers(numbers, out[PINS:])
    scale = max(abs(found.drive), b.crank.inertia_kg_m2 * u * u, 1.0, largest_moment(b, found))
    out[FORCE_RESIDUALS_AT], out[FORCE_RESIDUALS_AT + 1] = abs(found.drive_error) / scale, abs(found.body_error) / scale
    out[FORCE_RESIDUALS_AT + 2] = miss / scale
    return load_count


@kernel
def after_load(regime: int, kind: int, impulse: float) -> int:
    """Return the regime of the body after an event of the linkage with an angular impulse (N m s)."""
    if kind in STRIKES:
        return FLYING if regime != IN_CONTACT or impulse > 0.0 else IN_CONTACT
    if kind == EVENT.settled:
        return IN_CONTACT
    if kind in (EVENT.touchdown, EVENT.lift_off, EVENT.body_started):
        return FLYING
    return HANGING if kind == EVENT.body_stopped else regime


@kernel
def fill_body(b: Breaker, forces: Array, regime: int, out: Array) -> None:
    """Fill the row of the body from the linkage's result."""
    phi = forces[LED_ANGLE]
    force = b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_m)
    out[REGIME], out[PRESSING_FORCE] = regime, force
    out[BODY_JOINTS], out[BODY_JOINTS + 1], out[BODY_JOINTS + 2] = phi, forces[LED_RATE], -force * b.spring_arm_m


@step_of(body_step, LoadedBreaker)
def follow_linkage(
    model: LoadedBreaker, step: int, body: Array, forces: Array, loads: Array, count: int, out: Array, log: Array
) -> int:
    """Fill ``out`` with the body one step later."""
    regime = int(body[REGIME])
    for i in range(count):
        regime = after_load(regime, int(loads[i, LOAD_KIND]), loads[i, LOAD_IMPULSE])
    fill_body(model.breaker, forces, regime, out)
    return 0
