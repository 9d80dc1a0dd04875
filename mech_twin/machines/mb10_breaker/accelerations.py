# SPDX-License-Identifier: Apache-2.0
"""Accelerations of crank and body under what acts on them: free, the striker pushing the tool, the tool held fast.

Symbols and equations as in `dynamics`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.kernels.kernel import inline_kernel, kernel
from mech_twin.machines.mb10_breaker.dynamics import (
    BLOCKED,
    MOVING,
    PUSHED,
    Breaker,
    Masses,
    Senses,
    masses_at,
    spring_moment,
    striker,
)
from mech_twin.machines.mb10_breaker.state import BreakerState

LOST = 1e-4  # of the determinant left over by cancellation


class Accelerations(NamedTuple):
    """u' and p' (rad/s2), what holds the body, the force of the striker on the tool (N), what holds the crank.

    ``collar_nm`` is what collar and pivot friction together do to a body at rest (N m, 0 where it moves), ``hold_nm``
    the torque that keeps a crank at rest which friction holds (N m).
    """

    crank: float
    body: float
    collar_nm: float
    tool_force_n: float
    hold_nm: float


@inline_kernel
def generalised_forces(
    b: Breaker, m: Masses, u: float, phi: float, p: float, drive: float, crank_nm: float, body_nm: float
) -> tuple[float, float]:
    """Return the right-hand sides of both equations without collar and tool, Coulomb friction as given (N m)."""
    first = drive - b.crank_viscous_nms_per_rad * u + m.g_q - 0.5 * m.m11_q * u * u + 0.5 * m.m22_q * p * p
    second = -b.frame_drive * drive - spring_moment(b, phi) - b.body_damping_nms_per_rad * p + m.g_phi
    second -= m.m12_q * u * u + m.m22_q * u * p
    return first + crank_nm, second + body_nm


@inline_kernel
def sliding_forces(
    b: Breaker, m: Masses, u: float, phi: float, p: float, drive: float, rests: bool, senses: Senses
) -> tuple[float, float]:
    """Return the right-hand sides with the friction of what slides; a sense of 0 adds none."""
    body = 0.0 if rests else -b.body_coulomb_nm * senses.body
    return generalised_forces(b, m, u, phi, p, drive, -b.crank_coulomb_nm * senses.crank, body)


@kernel
def moving(u: float, p: float) -> Senses:
    """Return the senses of sliding at these speeds, forward at rest."""
    return Senses(1.0 if u >= 0.0 else -1.0, 1.0 if p >= 0.0 else -1.0)


@inline_kernel
def coupled(
    m11: float, m12: float, m22: float, first: float, second: float, still: bool, stuck: bool
) -> tuple[float, float, float, float]:
    """Return u', p' (rad/s2), the moment on a still body and the torque on a stuck crank that keep them so (N m)."""
    if still and stuck:
        return 0.0, 0.0, -second, -first
    if stuck:
        dp = second / m22
        return 0.0, dp, 0.0, m12 * dp - first
    if still:
        du = first / m11
        return du, 0.0, m12 * du - second, 0.0
    det = m11 * m22 - m12 * m12
    if det < LOST * m11 * m22:  # a heavy flywheel: both equations hold mostly its inertia, their sum does not
        both, whole = m11 + m12, m11 + 2.0 * m12 + m22
        det = m11 * whole - both * both
        turn, dp = (first * whole - (first + second) * both) / det, ((first + second) * m11 - first * both) / det
        return turn + dp, dp, 0.0, 0.0
    return (first * m22 - second * m12) / det, (second * m11 - first * m12) / det, 0.0, 0.0


@kernel
def accelerations(
    b: Breaker, m: Masses, u: float, phi: float, p: float, drive: float, rests: bool, senses: Senses
) -> tuple[float, float, float]:
    """Return u', p' (rad/s2) and the moment that holds a body at rest (N m), the striker off the tool."""
    first, second = sliding_forces(b, m, u, phi, p, drive, rests, senses)
    still = rests or senses.body == 0.0
    du, dp, collar, _ = coupled(m.m11, m.m12, m.m22, first, second, still, senses.crank == 0.0)
    return du, dp, collar


@kernel
def loaded_accelerations(
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
) -> Accelerations:
    """Return the accelerations under known forces: of the striker on the tool (N), of friction on both (N m)."""
    first, second = generalised_forces(b, m, u, phi, p, drive, crank_nm, body_nm)
    if thrust != 0.0:
        first, second = first - striker(b, q)[1] * thrust, second + b.tool_radius_m * thrust
    du, dp, collar, _ = coupled(m.m11, m.m12, m.m22, first, second, rests, False)
    return Accelerations(du, dp, collar, thrust, 0.0)


@kernel
def on_tool(b: Breaker, m: Masses, q: float, u: float, forces: tuple[float, float], lightness: float) -> Accelerations:
    """Return the accelerations of crank and body, both free, on a tool of 1/m_t (1/kg) under right-hand sides."""
    _, slope, bend = striker(b, q)
    du, dp, _, _ = coupled(m.m11, m.m12, m.m22, forces[0], forces[1], False, False)
    x, y, _, _ = coupled(m.m11, m.m12, m.m22, slope, -b.tool_radius_m, False, False)
    closing = slope * du - b.tool_radius_m * dp + bend * u * u + lightness * b.wall_force_n
    force = closing / (lightness + slope * x - b.tool_radius_m * y)
    return Accelerations(du - x * force, dp - y * force, 0.0, force, 0.0)


@kernel
def pushing(
    b: Breaker, m: Masses, q: float, u: float, phi: float, p: float, drive: float, rests: bool, senses: Senses
) -> Accelerations:
    """Return the accelerations with the striker pushing the tool into the wall.

    g = 0 holds: (M + m_t j j')(u', p') = rhs - j (F + m_t j'.(u, p)), N = F + m_t (j.(u', p') + j'.(u, p)).  Of a tool
    that outweighs crank and body both sides hold mostly the tool, and N is found first, as of one that does not move:
    (1/m_t + j' M^-1 j) N = F/m_t + j.M^-1 rhs + j'.(u, p).
    """
    _, slope, bend = striker(b, q)
    load = b.wall_force_n + b.tool_mass_kg * bend * u * u
    first, second = sliding_forces(b, m, u, phi, p, drive, rests, senses)
    first, second = first - slope * load, second + b.tool_radius_m * load
    m11 = m.m11 + b.tool_mass_kg * slope * slope
    m12 = m.m12 - b.tool_mass_kg * slope * b.tool_radius_m
    m22 = m.m22 + b.tool_mass_kg * b.tool_radius_m * b.tool_radius_m
    still = rests or senses.body == 0.0
    free = not still and senses.crank != 0.0
    if free and m11 * m22 - m12 * m12 > (m.m11 * m.m22 - m.m12 * m.m12) / LOST:
        return on_tool(b, m, q, u, sliding_forces(b, m, u, phi, p, drive, rests, senses), 1.0 / b.tool_mass_kg)
    du, dp, collar, hold = coupled(m11, m12, m22, first, second, still, senses.crank == 0.0)
    return Accelerations(du, dp, collar, load + b.tool_mass_kg * (slope * du - b.tool_radius_m * dp), hold)


@kernel
def blocked(
    b: Breaker, m: Masses, q: float, u: float, phi: float, p: float, drive: float, rests: bool, senses: Senses
) -> Accelerations:
    """Return the accelerations with the striker on a tool that the wall holds fast: j.(u', p') + j'.(u, p) = 0.

    With the body at rest too the crank stands, its bearing taking what it can; else it lifts the body as it turns.
    Friction that holds both has each bearing carry the same share of what it can.
    """
    _, slope, bend = striker(b, q)
    if rests:
        first, second = generalised_forces(b, m, u, phi, p, drive, 0.0, 0.0)
        hold = -min(max(first, -b.crank_coulomb_nm), b.crank_coulomb_nm)
        force = (first + hold) / math.copysign(max(abs(slope), 1e-12), slope)  # < 0: the crank strikes backward
        return Accelerations(0.0, 0.0, -second - b.tool_radius_m * force, force, hold)
    first, second = sliding_forces(b, m, u, phi, p, drive, rests, senses)
    if senses.crank == 0.0:
        lean = slope / b.tool_radius_m
        share = -(first + lean * second) / (b.crank_coulomb_nm + abs(lean) * b.body_coulomb_nm)
        body = math.copysign(share * b.body_coulomb_nm, share * lean)
        return Accelerations(0.0, 0.0, body, -(second + body) / b.tool_radius_m, share * b.crank_coulomb_nm)
    det = m.m11 * m.m22 - m.m12 * m.m12
    x, y = (m.m22 * slope + m.m12 * b.tool_radius_m) / det, (-m.m12 * slope - m.m11 * b.tool_radius_m) / det
    du, dp = (first * m.m22 - second * m.m12) / det, (second * m.m11 - first * m.m12) / det
    force = (slope * du - b.tool_radius_m * dp + bend * u * u) / (slope * x - b.tool_radius_m * y)
    return Accelerations(du - x * force, dp - y * force, 0.0, force, 0.0)


@kernel
def standing_gear(
    b: Breaker, m: Masses, q: float, u: float, phi: float, p: float, tool: int, senses: Senses
) -> tuple[float, float]:
    """Return the crank torque (N m) with which the gear's shaft goes on standing, the body flying, and p' (rad/s2).

    f = 1 with the drive on the frame, else 0; the shaft stands while u = f p, so u' = f p', and the sum of both
    equations, the first f times, is without the torque.
    """
    f = b.frame_drive
    first, second = sliding_forces(b, m, u, phi, p, 0.0, False, senses)
    m11, m12, m22 = m.m11, m.m12, m.m22
    if tool == PUSHED:
        _, slope, bend = striker(b, q)
        load = b.wall_force_n + b.tool_mass_kg * bend * u * u
        first, second = first - slope * load, second + b.tool_radius_m * load
        m11 += b.tool_mass_kg * slope * slope
        m12 -= b.tool_mass_kg * slope * b.tool_radius_m
        m22 += b.tool_mass_kg * b.tool_radius_m * b.tool_radius_m
    dp = 0.0 if senses.body == 0.0 else (f * first + second) / (f * (f * m11 + 2.0 * m12) + m22)
    return (f * m11 + m12) * dp - first, dp


@inline_kernel
def contact_accelerations(
    b: Breaker,
    m: Masses,
    q: float,
    u: float,
    phi: float,
    p: float,
    drive: float,
    rests: bool,
    tool: int,
    senses: Senses,
) -> Accelerations:
    """Return accelerations, what holds body and crank at rest, and the force on the tool for what the tool does."""
    if tool == PUSHED:
        return pushing(b, m, q, u, phi, p, drive, rests, senses)
    if tool == BLOCKED:
        return blocked(b, m, q, u, phi, p, drive, rests, senses)
    first, second = sliding_forces(b, m, u, phi, p, drive, rests, senses)
    still = rests or senses.body == 0.0
    du, dp, collar, hold = coupled(m.m11, m.m12, m.m22, first, second, still, senses.crank == 0.0)
    return Accelerations(du, dp, collar, 0.0, hold)


@inline_kernel
def rates_of_state(
    b: Breaker, state: BreakerState, drive: float, rests: bool, tool: int, senses: Senses
) -> BreakerState:
    """Return the rates of everything in the state under a torque on the crank (N m)."""
    q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    m = masses_at(b, q, phi)
    now = contact_accelerations(b, m, q, u, phi, p, drive, rests, tool, senses)
    moves = tool in (MOVING, PUSHED)
    tool_speed = state.tool_m_per_s if moves else 0.0
    work = drive * (u - b.frame_drive * p)
    damped = b.body_damping_nms_per_rad * p * p + b.crank_viscous_nms_per_rad * u * u
    damped += b.crank_coulomb_nm * senses.crank * u + b.body_coulomb_nm * senses.body * p
    moment = -b.frame_drive * drive - spring_moment(b, phi) - b.body_damping_nms_per_rad * p + now.collar_nm + m.g_phi
    if not rests:
        moment -= b.body_coulomb_nm * senses.body
    return BreakerState(
        u,
        now.crank,
        p,
        now.body,
        tool_speed,
        (now.tool_force_n - b.wall_force_n) / b.tool_mass_kg if moves else 0.0,
        work,
        damped,
        moment + b.tool_radius_m * now.tool_force_n,
        b.wall_force_n * tool_speed,
    )
