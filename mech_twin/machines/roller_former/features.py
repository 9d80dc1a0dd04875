# SPDX-License-Identifier: Apache-2.0
"""What sensors tell of one turn of the roller former's crank."""

from __future__ import annotations

from mech_twin.capabilities.crank_features import crank_features
from mech_twin.capabilities.cycle import CycleFeatures, CycleReference, harmonic, mean, swing
from mech_twin.machines.roller_former.parameters import RollerFormer

CRANK, TORQUE, TWIST = "linkage.crank.position", "motor.rotor.effort", "linkage.twist.position"
SETTLING_TURNS = 4
RUN_UP_S = 5.0


def features(parameters: RollerFormer) -> CycleFeatures:
    """Return the features of a turn of the crank shaft."""
    return CycleFeatures(
        CycleReference(CRANK),
        (
            *crank_features(CRANK, TORQUE),
            harmonic("torque_cos_4_nm", "N.m", TORQUE, 4, "cos", "driving torque, cosine of a quarter of a turn"),
            harmonic("torque_sin_4_nm", "N.m", TORQUE, 4, "sin", "driving torque, sine of a quarter of a turn"),
            mean("twist_mean_rad", "rad", TWIST, "mean twist of the coupling"),
            swing("twist_range_rad", "rad", TWIST, "range of the coupling's twist"),
            harmonic("twist_cos_2_rad", "rad", TWIST, 2, "cos", "twist, cosine of half a turn"),
            harmonic("twist_sin_2_rad", "rad", TWIST, 2, "sin", "twist, sine of half a turn"),
            harmonic("twist_cos_4_rad", "rad", TWIST, 4, "cos", "twist, cosine of a quarter of a turn"),
            harmonic("twist_sin_4_rad", "rad", TWIST, 4, "sin", "twist, sine of a quarter of a turn"),
        ),
        SETTLING_TURNS,
        RUN_UP_S,
    )
