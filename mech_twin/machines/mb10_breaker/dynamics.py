# SPDX-License-Identifier: Apache-2.0
r"""Crank and body of the breaker, solved together: masses, forces, accelerations, energies.

::

        y (of the body)       springs press          A  crank axis = pivot of the body, origin of both frames
        ^                        |                   D  rocker bearing, on the body's x axis
        |   coupler _____        v                   q  crank angle from AD, counter-clockwise, against the body
        |      ____/     \                           phi  angle of the body, clockwise (lifting) positive:
        |  C'_/           o B                             it runs against the crank
        | /  q          /                            n  direction of the blow, r_tool from A, striker_arm from D
        A o-----------o D ----> x                    S  striking face; y_c + r_tool phi is where the tool stands
                       \                             R  collar force times its arm, >= 0 while the body rests
                        \  S|===> n   tool | wall

    M11 u' + M12 p' + M11,q u^2/2 - M22,q p^2/2       = Q - v u + T_q + G_q
    M12 u' + M22 p' + M12,q u^2 + M22,q u p           = -Q (frame drive) - c (l phi + a) l - d p + T_phi + R + G_phi

with u = q', p = phi', Q the torque on the crank behind the gear, v its bearing's viscous friction, G gravity,
T_q = -c_q sign u and T_phi = -c_phi sign p Coulomb friction, which at rest is whatever holds (`joint_laws`).
An absolute angular velocity is counter-clockwise: crank u - p, link i  g_i u - p, body -p.

Also the accelerations of crank and body, free or on its collar, and curves of the linkage over a turn for bounds.
"""

import math
from typing import NamedTuple

import numpy as np

from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import inline_kernel, kernel
from mech_twin.parts.four_bar import (
    Coefficients,
    FourBar,
    Link,
    Position,
    coefficients,
    offset,
    position,
    weight_moments,
)
from mech_twin.parts.friction_and_gear import gear_torque
from mech_twin.parts.rod_waves.parameters import WaveGrid

TURN = 2.0 * math.pi
REST, FLIGHT, HELD = 0, 1, 2  # regimes of the body
# what the tool does: stands in the wall, moves into it, is pushed by the striker, is pressed by it and does not move
STANDING, MOVING, PUSHED, BLOCKED = 0, 1, 2, 3


class Breaker(NamedTuple):
    """Constants of the coupled motion, SI units; see the parameter model for their meaning."""

    bar: FourBar
    crank: Link
    coupler: Link
    rocker: Link
    rotor_11_kg_m2: float
    rotor_12_kg_m2: float
    rotor_22_kg_m2: float
    frame_drive: float
    ratio: float
    efficiency: float
    body_inertia_kg_m2: float
    spring_rate_n_per_m: float
    spring_arm_m: float
    preload_m: float
    body_damping_nms_per_rad: float
    collar_restitution: float
    tool_radius_m: float
    striker_arm_m: float
    tool_mass_kg: float
    tool_restitution: float
    overtravel_m: float
    wall_force_n: float
    n_x: float
    n_y: float
    striking_crank_rad: float
    retreating_crank_rad: float
    extreme_x: float
    extreme_y: float
    gravity_m_per_s2: float
    held: bool
    crank_viscous_nms_per_rad: float
    crank_coulomb_nm: float
    body_coulomb_nm: float
    waves: bool  # the blow is a wave in the tool
    wave: WaveGrid


class Masses(NamedTuple):
    """Generalised masses (kg m^2), their derivatives in the crank angle, and gravity's forces (N m)."""

    m11: float
    m12: float
    m22: float
    m11_q: float
    m12_q: float
    m22_q: float
    g_q: float
    g_phi: float


@inline_kernel
def masses(b: Breaker, at: Position, by: Coefficients, phi: float) -> Masses:
    """Return the generalised masses: a_i = dr_i/dq, b_i = -k x r_i, V_i = a_i u + b_i p.

    M11 = sum m a.a + I g^2, M12 = sum m a.b - I g, M22 = J + sum m r.r + I, rotor and crank added.
    """
    down_x, down_y = b.gravity_m_per_s2 * math.sin(phi), -b.gravity_m_per_s2 * math.cos(phi)
    crank = b.crank.inertia_kg_m2
    x, y = offset(b.crank, at.a_x, at.a_y, b.bar.crank_m)
    g_q = b.crank.mass_kg * (-y * down_x + x * down_y)
    g_phi = -g_q
    # coupler
    m, inertia = b.coupler.mass_kg, b.coupler.inertia_kg_m2
    x, y = offset(b.coupler, at.u_x, at.u_y, b.bar.coupler_m)
    r_x, r_y = at.a_x + x, at.a_y + y
    a_x, a_y = -at.a_y - by.g2 * y, at.a_x + by.g2 * x
    d_x = -at.a_x - by.g2_1 * y - by.g2 * by.g2 * x
    d_y = -at.a_y + by.g2_1 * x - by.g2 * by.g2 * y
    m11 = crank + b.rotor_11_kg_m2 + m * (a_x * a_x + a_y * a_y) + inertia * by.g2 * by.g2
    m11_q = 2.0 * (m * (a_x * d_x + a_y * d_y) + inertia * by.g2 * by.g2_1)
    m12 = -crank + b.rotor_12_kg_m2 + m * (a_x * r_y - a_y * r_x) - inertia * by.g2
    m12_q = m * (d_x * r_y - d_y * r_x) - inertia * by.g2_1
    m22 = b.body_inertia_kg_m2 + crank + b.rotor_22_kg_m2 + m * (r_x * r_x + r_y * r_y) + inertia
    m22_q = 2.0 * m * (r_x * a_x + r_y * a_y)
    g_q += m * (a_x * down_x + a_y * down_y)
    g_phi += m * (r_y * down_x - r_x * down_y)
    # rocker
    m, inertia = b.rocker.mass_kg, b.rocker.inertia_kg_m2
    x, y = offset(b.rocker, at.v_x, at.v_y, b.bar.rocker_m)
    r_x, r_y = b.bar.pivot_x_m + x, b.bar.pivot_y_m + y
    a_x, a_y = -by.g3 * y, by.g3 * x
    d_x, d_y = -by.g3_1 * y - by.g3 * by.g3 * x, by.g3_1 * x - by.g3 * by.g3 * y
    m11 += m * (a_x * a_x + a_y * a_y) + inertia * by.g3 * by.g3
    m11_q += 2.0 * (m * (a_x * d_x + a_y * d_y) + inertia * by.g3 * by.g3_1)
    m12 += m * (a_x * r_y - a_y * r_x) - inertia * by.g3
    m12_q += m * (d_x * r_y - d_y * r_x) - inertia * by.g3_1
    m22 += m * (r_x * r_x + r_y * r_y) + inertia
    m22_q += 2.0 * m * (r_x * a_x + r_y * a_y)
    g_q += m * (a_x * down_x + a_y * down_y)
    g_phi += m * (r_y * down_x - r_x * down_y)
    return Masses(m11, m12, m22, m11_q, m12_q, m22_q, g_q, g_phi)


@inline_kernel
def spring_moment(b: Breaker, phi: float) -> float:
    """Return c (l phi + a) l, the moment with which the springs press the body down (N m)."""
    return b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_m) * b.spring_arm_m


@inline_kernel
def crank_torque(b: Breaker, torque: float, u: float, p: float) -> float:
    """Return the torque behind the gear, Q = eta i M_m; eta becomes 1/eta when the motor generates (N m)."""
    return gear_torque(b.ratio, b.efficiency, torque, u - b.frame_drive * p)


@inline_kernel
def masses_at(b: Breaker, q: float, phi: float) -> Masses:
    """Return the generalised masses at crank angle q and body angle phi (rad)."""
    at = position(b.bar, q)
    return masses(b, at, coefficients(at), phi)


@kernel
def energies(b: Breaker, q: float, u: float, phi: float, p: float) -> tuple[float, float, float]:
    """Return kinetic energy, potential energy of springs and weights (J), and the angular momentum M12 u + M22 p."""
    at = position(b.bar, q)
    m = masses(b, at, coefficients(at), phi)
    kinetic = 0.5 * m.m11 * u * u + m.m12 * u * p + 0.5 * m.m22 * p * p
    stretch = b.spring_arm_m * phi + b.preload_m
    x, y = weight_moments(b.bar, b.crank, b.coupler, b.rocker, at)
    height = y * math.cos(phi) - x * math.sin(phi)
    return kinetic, 0.5 * b.spring_rate_n_per_m * stretch * stretch + b.gravity_m_per_s2 * height, m.m12 * u + m.m22 * p


@inline_kernel
def striker_travel(b: Breaker, x: float, y: float) -> float:
    """Return the striker's travel (m) relative to the face of the seated tool, for a direction of the rocker."""
    cross = b.extreme_x * y - b.extreme_y * x
    dot = b.extreme_x * x + b.extreme_y * y
    return b.overtravel_m + b.striker_arm_m * math.atan2(cross, dot)


@kernel
def striker(b: Breaker, q: float) -> tuple[float, float, float]:
    """Return y - y_c (m), dy/dq (m/rad) and d2y/dq2: the striker's travel relative to the face of the seated tool.

    y = striker_arm x rocker angle; at the rocker's extreme y - y_c = h.
    """
    at = position(b.bar, q)
    by = coefficients(at)
    return striker_travel(b, at.v_x, at.v_y), b.striker_arm_m * by.g3, b.striker_arm_m * by.g3_1


LOST = 1e-4  # of the determinant left over by cancellation


@kernel
def accelerations(
    b: Breaker,
    m: Masses,
    q: float,
    u: float,
    phi: float,
    p: float,
    drive: float,
    rests: bool,
    thrust: float,
    crank_nm: float,
    body_nm: float,
) -> tuple[float, float, float]:
    """Return u', p' (rad/s2), and the moment of collar and pivot on a body at rest (N m).

    Known are the striker's force on the tool (N), and Coulomb friction on crank and body (N m).
    """
    first = drive - b.crank_viscous_nms_per_rad * u + m.g_q - 0.5 * m.m11_q * u * u + 0.5 * m.m22_q * p * p
    second = -b.frame_drive * drive - spring_moment(b, phi) - b.body_damping_nms_per_rad * p + m.g_phi
    second -= m.m12_q * u * u + m.m22_q * u * p
    first, second = first + crank_nm, second + body_nm
    if thrust != 0.0:
        first, second = first - striker(b, q)[1] * thrust, second + b.tool_radius_m * thrust
    if rests:
        du = first / m.m11
        return du, 0.0, m.m12 * du - second
    det = m.m11 * m.m22 - m.m12 * m.m12
    if det < LOST * m.m11 * m.m22:  # a heavy flywheel: both equations hold mostly its inertia, their sum does not
        both, whole = m.m11 + m.m12, m.m11 + 2.0 * m.m12 + m.m22
        det = m.m11 * whole - both * both
        turn, dp = (first * whole - (first + second) * both) / det, ((first + second) * m.m11 - first * both) / det
        return turn + dp, dp, 0.0
    return (first * m.m22 - second * m.m12) / det, (second * m.m11 - first * m.m12) / det, 0.0


@kernel
def turn_rocker_rates(bar: FourBar, count: int) -> Array:
    """Return the rocker's angle per crank angle at equal angles of a turn, the last that of the first: (count + 1,)."""
    found = np.empty(count + 1)
    for i in range(count + 1):
        found[i] = coefficients(position(bar, 2.0 * math.pi * i / count)).g3
    return found
