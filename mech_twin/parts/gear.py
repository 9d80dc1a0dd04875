# SPDX-License-Identifier: Apache-2.0
r"""Gear between a motor and a crank: one ratio, and one rule of efficiency, by the sign of power.

::

    motor --[ ratio i, efficiency eta ]--> crank, speed u          tau = i M: the motor's torque at the crank

    power into the crank (tau u > 0)    crank torque eta tau        the crank gets less than the motor gives
    power out of it      (tau u < 0)    crank torque tau/eta        the crank gives more than the motor takes

The rule is Coulomb friction at the crank whose size follows the load:
crank torque = tau (eta + 1/eta)/2 - |tau| (1/eta - eta)/2 sign u, so a gear never creates energy.
At u = 0 the torque passed on is whatever holds the crank, within eta tau and tau/eta: the crank sticks until the load
leaves that band (`friction.released`).
"""

from __future__ import annotations

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
