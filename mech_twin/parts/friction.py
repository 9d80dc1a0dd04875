# SPDX-License-Identifier: Apache-2.0
r"""Friction of a turning joint: Coulomb and viscous, with sticking and release told exactly.

::

    torque on the joint |______            sliding, u != 0:   - c sign u - v u
                        |     \_____       sticking, u = 0:   - T, whatever torque T drives it, while |T| <= c
              __________0__________ u      release:           |T| > c, then it slides towards T
             \_____     |
                   \____|                  c  Coulomb torque (N m), v  viscous coefficient (N m s/rad)
"""

from __future__ import annotations

from mech_twin.declarations.quantity import Parameters, quantity
from mech_twin.kernels.kernel import embedded_kernel, kernel


class Friction(Parameters):
    """Friction of a turning joint; none where both numbers are 0."""

    coulomb_nm: float = quantity(
        "N m", "Coulomb friction torque, also the largest that sticks", default=0.0, ge=0.0, le=1e9, live=True
    )
    viscous_nms_per_rad: float = quantity(
        "N m s/rad", "friction torque per speed", default=0.0, ge=0.0, le=1e9, live=True
    )


@embedded_kernel
def sliding_torque(coulomb: float, viscous: float, speed: float, direction: float) -> float:
    """Return the friction torque on a sliding joint (N m): -c sign u - v u.

    Parameters
    ----------
    coulomb, viscous : float
        c (N m) and v (N m s/rad).
    speed : float
        u (rad/s).
    direction : float
        Sense of sliding, +1 or -1: the sign of u, and at u = 0 the sense in which it begins.
    """
    return -coulomb * direction - viscous * speed


@kernel
def sticking_torque(driving: float) -> float:
    """Return the friction torque that holds a joint at rest against a driving torque (N m)."""
    return -driving


@kernel
def release_margin(coulomb: float, driving: float) -> float:
    """Return c - |T| (N m): a joint at rest sticks while >= 0, released where it falls below."""
    return coulomb - abs(driving)


@kernel
def released(coulomb: float, driving: float) -> float:
    """Return the sense (+1, -1) in which a joint at rest starts under a driving torque (N m), or 0 where it sticks."""
    if release_margin(coulomb, driving) >= 0.0:
        return 0.0
    return 1.0 if driving > 0.0 else -1.0
