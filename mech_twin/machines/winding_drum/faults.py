# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with the winding drum."""

from __future__ import annotations

from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key
from mech_twin.machines.winding_drum.parameters import WindingDrum


def faults(parameters: WindingDrum) -> tuple[MachineFault, ...]:
    """Return the faults of package and drum."""
    return (
        added_to_key(
            "eccentricity", "the package sits off centre", "eccentricity_m", "m", (0.0005, 0.001, 0.002, 0.004, 0.01)
        ),
        share_of_key("density", "the package is denser or softer", "package_density_kg_per_m3", (-0.3, -0.1, 0.1, 0.3)),
        added_to_key("drum_friction", "the drum's bearings rub", "friction.coulomb_nm", "N.m", (0.2, 0.5, 1.0, 2.0)),
    )
