# SPDX-License-Identifier: Apache-2.0
r"""Elastic drive between a motor and a crank shaft, reduced to the crank.

::

      motor      coupling    gearbox                   J_p1        c         J_p2
     [ J_r ]-----[ J_c ]-----[ u, eta ]----> crank   (phi1, w1)--/\/\--(phi2, w2)
                                                               --[ k ]--

Source: LoveikinRoller2018 eq. (1) and (40).
"""

from __future__ import annotations

from typing import Literal

from mech_twin.declarations.quantity import choice, quantity
from mech_twin.parts.gear import Gear


class DriveParameters(Gear):
    """Gearbox, coupling, and the stiffness and damping of the drive at the crank."""

    ratio: float = quantity("1", "motor speed over crank speed, u", ge=0.1, le=1000.0)
    gear_loss: Literal["power", "printed"] = choice(
        "power: u eta M while the motor drives, u M/eta while it is driven; printed: u eta M always, as (40)",
        default="power",
    )
    inertia_factor: float = quantity("1", "gearbox parts counted in with the motor shaft, delta", ge=1.0, le=10.0)
    coupling_inertia_kg_m2: float = quantity("kg m^2", "inertia of the coupling on the motor shaft", ge=0.0, le=1e4)
    coupling_rated_moment_nm: float = quantity("N m", "rated moment of the coupling, on the motor shaft", gt=0.0)
    stiffness_nm_per_rad: float = quantity(
        "N m/rad", "stiffness c of the drive at the crank", ge=1.0, le=1e10, live=True
    )
    damping_nms_per_rad: float = quantity("N m s/rad", "damping k of the drive at the crank", ge=0.0, le=1e8, live=True)


def reduced_inertia(drive: DriveParameters, rotor_inertia_kg_m2: float) -> float:
    """Return ``J_p1 = (J_rotor + J_coupling) delta u^2`` (kg m^2), eq. (1)."""
    return (rotor_inertia_kg_m2 + drive.coupling_inertia_kg_m2) * drive.inertia_factor * drive.ratio**2
