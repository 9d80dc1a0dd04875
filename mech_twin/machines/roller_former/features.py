# SPDX-License-Identifier: Apache-2.0
"""What sensors tell of one turn of the roller former's crank."""

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
from mech_twin.machines.roller_former.parameters import RollerFormer

CRANK, TORQUE, TWIST = "linkage.crank.position", "motor.rotor.effort", "linkage.twist.position"
SETTLING_TURNS = 4
RUN_UP_S = 5.0


def features(parameters: RollerFormer) -> CycleFeatures:
    """Return the features of a turn of the crank shaft."""
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
