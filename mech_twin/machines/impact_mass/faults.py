# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with the impact mass."""

from __future__ import annotations

from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.wave_stop import StopRod

LESS = (-0.6, -0.5, -0.4, -0.3, -0.2, -0.1, -0.05)
EITHER = (-0.2, -0.1, -0.05, 0.05, 0.1, 0.2)


RIGID_FAULTS = (share_of_key("restitution", "the stop's face has changed", "restitution", EITHER),)


def wave_faults(stop: StopRod) -> tuple[MachineFault, ...]:
    """Return the faults of a stop that is a rod: its face, its wall."""
    found = [share_of_key("face_worn", "the stop's face is softer", "stop.wave.face.stiffness_n_per_m", LESS)]
    if stop.wall.kind == "loading":
        wall = "stop.wave.wall.stiffness_n_per_m"
        found.append(share_of_key("wall_soft", "the wall behind the stop is softer", wall, LESS))
    return tuple(found)


def faults(parameters: ImpactMass) -> tuple[MachineFault, ...]:
    """Return the faults of stop and generator."""
    return (
        *(wave_faults(parameters.stop.wave) if parameters.stop.model == "wave" else RIGID_FAULTS),
        share_of_key("first_level", "the force of the first phase is off", "phase1_force_n", EITHER),
        share_of_key("second_level", "the force of the second phase is off", "phase2_force_n", EITHER),
        added_to_key("stop_moved", "the stop has moved", "stop_position_m", "m", (-0.02, -0.005, 0.005, 0.02)),
    )
