# SPDX-License-Identifier: Apache-2.0
"""Monitoring of the machine: features of a cycle, faults, the operating point."""

from __future__ import annotations

from mech_twin.capabilities.crank_features import crank_features
from mech_twin.capabilities.cycle import CycleFeatures, CycleReference, mean, swing
from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key, supply_sag
from mech_twin.capabilities.operating_point import OperatingVariable, drive_variables, varying_key
from mech_twin.machines.compaction_press.parameters import CompactionPress

CRANK, TORQUE, PENDULUM = "linkage.crank.position", "linkage.crank.effort", "linkage.pendulum.position"


def features(parameters: CompactionPress) -> CycleFeatures:
    """Return the features of a turn of the crank."""
    return CycleFeatures(
        CycleReference(CRANK),
        (
            *crank_features(CRANK, TORQUE),
            mean("pendulum_mean_rad", "rad", PENDULUM, "mean angle of the pendulum"),
            swing("pendulum_swing_rad", "rad", PENDULUM, "angle the pendulum swings through"),
        ),
    )


def faults(parameters: CompactionPress) -> tuple[MachineFault, ...]:
    """Return the faults of layer, joints, flywheel (where one is fitted) and supply."""
    found = [
        share_of_key(
            "layer_force", "the layer is stiffer or softer", "working_force.peak_n", (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)
        ),
        added_to_key("joint_friction", "a joint rubs", "friction.coulomb_nm", "N.m", (1.0, 3.0, 10.0, 30.0)),
        supply_sag(),
    ]
    if parameters.flywheel.inertia_kg_m2 > 0.0:
        sizes = (-0.8, -0.5, -0.2, -0.1)
        found.append(share_of_key("flywheel_loose", "the flywheel slips", "flywheel.inertia_kg_m2", sizes))
    return tuple(found)


def operating(parameters: CompactionPress) -> tuple[OperatingVariable, ...]:
    """Return supply and layer."""
    layer = varying_key("layer", "force of the layer at the bottom", "working_force.peak_n", 0.1, "layer_force")
    return (*drive_variables(parameters.drive.kind), layer)
