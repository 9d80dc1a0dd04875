# SPDX-License-Identifier: Apache-2.0
r"""Friction of a turning joint, Coulomb and viscous with exact sticking and release, and loss of a gear.

::

    torque on the joint |______            sliding, u != 0:   - c sign u - v u
                        |     \_____       sticking, u = 0:   - T, whatever torque T drives it, while |T| <= c
              __________0__________ u      release:           |T| > c, then it slides towards T
             \_____     |
                   \____|                  c  Coulomb torque (N m), v  viscous coefficient (N m s/rad)

A gear between motor and crank has one ratio, and one rule of efficiency, by the sign of power::

    motor --[ ratio i, efficiency eta ]--> crank, speed u          tau = i M: the motor's torque at the crank

    power into the crank (tau u > 0)    crank torque eta tau        the crank gets less than the motor gives
    power out of it      (tau u < 0)    crank torque tau/eta        the crank gives more than the motor takes

The rule is Coulomb friction at the crank whose size follows the load:
crank torque = tau (eta + 1/eta)/2 - |tau| (1/eta - eta)/2 sign u, so a gear never creates energy.
At u = 0 the torque passed on is whatever holds the crank, within eta tau and tau/eta: the crank sticks until the load
leaves that band (`friction.released`).
"""

from typing import NamedTuple

from mech_twin.declarations.quantity import Parameters, quantity
from mech_twin.kernels.kernel import embedded_kernel


class Gear(Parameters):
    """Gear between motor and crank."""

    ratio: float = quantity("1", "motor speed over crank speed", ge=0.01, le=1000.0)
    efficiency: float = quantity(
        "1", "share of the power that the gear passes on, in either direction", ge=0.05, le=1.0, live=True
    )


class GearTorque(NamedTuple):
    """Torque at the crank (N m) without regard to direction, and the friction torque (N m, >= 0) against its speed."""

    mean_nm: float
    friction_nm: float


@embedded_kernel
def gear_split(ratio: float, efficiency: float, torque: float) -> GearTorque:
    """Return a motor torque (N m) at the crank as mean and friction: tau (eta + 1/eta)/2 and |tau| (1/eta - eta)/2."""
    at_crank = ratio * torque
    return GearTorque(
        0.5 * (efficiency + 1.0 / efficiency) * at_crank, 0.5 * (1.0 / efficiency - efficiency) * abs(at_crank)
    )


@embedded_kernel
def gear_torque(ratio: float, efficiency: float, torque: float, speed: float) -> float:
    """Return the crank torque (N m) of a motor torque at a crank speed: eta i M while it drives, i M/eta while driven.

    Parameters
    ----------
    ratio, efficiency : float
        i = motor speed over crank speed, and eta.
    torque : float
        Motor torque M (N m).
    speed : float
        Crank speed u (rad/s); at 0 the value just after the torque has begun to drive, eta i M.
    """
    return ratio * torque * (efficiency if torque * speed >= 0.0 else 1.0 / efficiency)


def passed_on(before: float, after: float, known: float) -> float:
    """Return the share of the power that a gear passes on, from the torques on its two sides.

    Parameters
    ----------
    before, after : float
        Torque of the motor times the ratio, and torque of the crank (N m).
    known : float
        The share so far; it stays where no power goes through the gear.
    """
    return min(after / before, before / after) if before * after > 0.0 else known


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
