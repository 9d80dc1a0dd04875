# SPDX-License-Identifier: Apache-2.0
"""What sensors tell of one stroke of the press."""

from __future__ import annotations

from mech_twin.capabilities.crank_features import crank_features
from mech_twin.capabilities.cycle import CycleFeatures, CycleReference, mean, swing
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
