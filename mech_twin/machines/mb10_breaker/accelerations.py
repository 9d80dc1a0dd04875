# SPDX-License-Identifier: Apache-2.0
"""Accelerations of crank and body under what acts on them, the body free or on its collar.

Symbols and equations as in `dynamics`.
"""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.kernels.kernel import inline_kernel, kernel
from mech_twin.machines.mb10_breaker.dynamics import Breaker, Masses, Senses, spring_moment, striker

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
