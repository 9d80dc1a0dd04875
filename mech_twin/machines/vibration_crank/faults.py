# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with the vibration crank."""

from __future__ import annotations

from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key, supply_sag
from mech_twin.machines.vibration_crank.parameters import VibrationCrank

EITHER = (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)


def faults(parameters: VibrationCrank) -> tuple[MachineFault, ...]:
    """Return the faults of counterweight (where its mass is given), boom load, bearings and supply."""
    found = [
        share_of_key("boom_load", "the boom carries another load", "masses.tree_kg", EITHER),
        added_to_key(
            "working_force", "a steady force on the boom", "working_force_n", "N", (-400.0, -100.0, 100.0, 400.0)
        ),
        added_to_key(
            "crank_friction", "the crank's bearing rubs", "friction.coulomb_nm", "N.m", (2.0, 5.0, 20.0, 50.0)
        ),
        supply_sag(),
    ]
    if parameters.counterweight.mass_kg is not None:
        sizes = (-0.6, -0.4, -0.2, -0.1, -0.05)
        found.append(
            share_of_key("counterweight_lost", "part of the counterweight is gone", "counterweight.mass_kg", sizes)
        )
    return tuple(found)
