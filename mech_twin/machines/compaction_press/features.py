# SPDX-License-Identifier: Apache-2.0
"""What sensors tell of one stroke of the press."""

from __future__ import annotations

from mech_twin.capabilities.cycle import (
    CycleFeatures,
    CycleReference,
    harmonic,
    mean,
    period,
    speed_harmonic,
    swing,
    upper,
)
from mech_twin.machines.compaction_press.parameters import CompactionPress

CRANK, TORQUE, PENDULUM = "linkage.crank.position", "linkage.crank.effort", "linkage.pendulum.position"


def features(parameters: CompactionPress) -> CycleFeatures:
    """Return the features of a turn of the crank."""
    return CycleFeatures(
        CycleReference(CRANK),
        (
            period(),
            speed_harmonic("speed_cos_1", CRANK, 1, "cos", "relative crank speed, cosine of the turn"),
            speed_harmonic("speed_sin_1", CRANK, 1, "sin", "relative crank speed, sine of the turn"),
            speed_harmonic("speed_cos_2", CRANK, 2, "cos", "relative crank speed, cosine of half a turn"),
            speed_harmonic("speed_sin_2", CRANK, 2, "sin", "relative crank speed, sine of half a turn"),
            mean("torque_mean_nm", "N.m", TORQUE, "mean driving torque"),
            upper("torque_peak_nm", "N.m", TORQUE, "largest driving torque"),
            harmonic("torque_cos_1_nm", "N.m", TORQUE, 1, "cos", "driving torque, cosine of the turn"),
            harmonic("torque_sin_1_nm", "N.m", TORQUE, 1, "sin", "driving torque, sine of the turn"),
            harmonic("torque_cos_2_nm", "N.m", TORQUE, 2, "cos", "driving torque, cosine of half a turn"),
            harmonic("torque_sin_2_nm", "N.m", TORQUE, 2, "sin", "driving torque, sine of half a turn"),
            mean("pendulum_mean_rad", "rad", PENDULUM, "mean angle of the pendulum"),
            swing("pendulum_swing_rad", "rad", PENDULUM, "angle the pendulum swings through"),
        ),
    )
