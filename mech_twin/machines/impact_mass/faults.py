# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with the impact mass."""

from __future__ import annotations

from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key
from mech_twin.machines.impact_mass.parameters import ImpactMass

EITHER = (-0.2, -0.1, -0.05, 0.05, 0.1, 0.2)


def faults(parameters: ImpactMass) -> tuple[MachineFault, ...]:
    """Return the faults of stop and generator."""
    return (
        share_of_key("restitution", "the stop's face has changed", "restitution", EITHER),
        share_of_key("first_level", "the force of the first phase is off", "phase1_force_n", EITHER),
        share_of_key("second_level", "the force of the second phase is off", "phase2_force_n", EITHER),
        added_to_key("stop_moved", "the stop has moved", "stop_position_m", "m", (-0.02, -0.005, 0.005, 0.02)),
    )
