# SPDX-License-Identifier: Apache-2.0
"""Pin reactions of the breaker from the equilibrium of the dyad, between impacts and across them.

The accelerations follow from the joint states and the crank's torque by the reduced masses.  The pin reactions follow
from the equilibrium of links 2 and 3.  They give the torque on the crank and the moment on the body a second time.
Forces are in the frame of the machine; a moment that lifts the body is positive.
"""

import math
from typing import NamedTuple

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import (
    HELD,
    Breaker,
    accelerations,
    masses,
    spring_moment,
)
from mech_twin.parts.four_bar import Link, coefficients, dyad_reactions, offset, point_acceleration, position

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
    s_x, s_y = point_acceleration(x, y, u - p, du - dp)
    o_x, o_y = a_x - b.crank.mass_kg * (g_x - s_x), a_y - b.crank.mass_kg * (g_y - s_y)
    torque = b.crank.inertia_kg_m2 * (du - dp) + at.a_x * a_y - at.a_y * a_x - b.crank.mass_kg * (x * g_y - y * g_x)
    needed = torque + b.rotor_11_kg_m2 * du + b.rotor_12_kg_m2 * dp
    moment = b.bar.pivot_x_m * c_y - b.bar.pivot_y_m * c_x
    moment += (1.0 - b.frame_drive) * (torque - b.rotor_12_kg_m2 * du - b.rotor_22_kg_m2 * dp)
    held = b.body_inertia_kg_m2 * dp + spring_moment(b, phi) + b.body_damping_nms_per_rad * p - body_nm
    o_x, o_y = in_frame(phi, o_x, o_y)
    a_x, a_y = in_frame(phi, a_x, a_y)
    b_x, b_y = in_frame(phi, b_x, b_y)
    c_x, c_y = in_frame(phi, c_x, c_y)
    friction = b.crank_viscous_nms_per_rad * u - crank_nm
    moment -= b.frame_drive * friction  # of the crank's bearing; on the body it is in the torque above
    drive_error = needed - drive + friction
    return PinForces(
        o_x,
        o_y,
        a_x,
        a_y,
        b_x,
        b_y,
        c_x,
        c_y,
        needed,
        moment,
        du,
        dp,
        collar,
        drive_error,
        held - collar - moment,
        thrust,
    )


@kernel
def impulsive(link: Link, a_x: float, a_y: float, x: float, y: float, turn: float) -> tuple[float, float, float]:
    """Return a link's inertia impulse and its moment about the link's pin; (a_x, a_y) is the centroid's jump."""
    f_x, f_y = -link.mass_kg * a_x, -link.mass_kg * a_y
    return f_x, f_y, x * f_y - y * f_x - link.inertia_kg_m2 * turn


@kernel
def pin_impulses(b: Breaker, q: float, phi: float, du: float, dp: float, blow: float) -> PinForces:
    """Return the impulsive pin reactions for speed jumps du, dp of crank and body (rad/s) and a blow (N s).

    Equilibrium of the dyad as in `pin_forces`; the blow acts on the rocker along -n at the arm of the striker.
    """
    at = position(b.bar, q)
    by = coefficients(at)
    x, y = offset(b.coupler, at.u_x, at.u_y, b.bar.coupler_m)
    w = by.g2 * du
    r_x, r_y = at.a_x + x, at.a_y + y
    f2_x, f2_y, moment2 = impulsive(
        b.coupler, -at.a_y * du - y * w + r_y * dp, at.a_x * du + x * w - r_x * dp, x, y, w - dp
    )
    x, y = offset(b.rocker, at.v_x, at.v_y, b.bar.rocker_m)
    w = by.g3 * du
    r_x, r_y = b.bar.pivot_x_m + x, b.bar.pivot_y_m + y
    f3_x, f3_y, moment3 = impulsive(b.rocker, -y * w + r_y * dp, x * w - r_x * dp, x, y, w - dp)
    f3_x, f3_y, moment3 = f3_x - blow * b.n_x, f3_y - blow * b.n_y, moment3 - blow * b.striker_arm_m
    a_x, a_y, b_x, b_y, c_x, c_y = dyad_reactions(at, f2_x, f2_y, moment2, f3_x, f3_y, moment3)
    x, y = offset(b.crank, at.a_x, at.a_y, b.bar.crank_m)
    o_x, o_y = a_x - b.crank.mass_kg * y * (du - dp), a_y + b.crank.mass_kg * x * (du - dp)
    torque = b.crank.inertia_kg_m2 * (du - dp) + at.a_x * a_y - at.a_y * a_x
    needed = torque + b.rotor_11_kg_m2 * du + b.rotor_12_kg_m2 * dp
    moment = b.bar.pivot_x_m * c_y - b.bar.pivot_y_m * c_x
    moment += (1.0 - b.frame_drive) * (torque - b.rotor_12_kg_m2 * du - b.rotor_22_kg_m2 * dp)
    o_x, o_y = in_frame(phi, o_x, o_y)
    a_x, a_y = in_frame(phi, a_x, a_y)
    b_x, b_y = in_frame(phi, b_x, b_y)
    c_x, c_y = in_frame(phi, c_x, c_y)
    error = b.body_inertia_kg_m2 * dp - moment
    return PinForces(o_x, o_y, a_x, a_y, b_x, b_y, c_x, c_y, needed, moment, du, dp, -error, needed, error, blow)
