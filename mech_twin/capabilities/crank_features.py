# SPDX-License-Identifier: Apache-2.0
"""Features of one turn of a crank: its period, its speed and its driving torque."""

from __future__ import annotations

from mech_twin.capabilities.cycle import CycleFeature, harmonic, mean, period, speed_harmonic, upper


def speed_features(crank: str) -> tuple[CycleFeature, ...]:
    """Return the features period and relative speed of a turn; ``crank`` is the column of its angle (rad)."""
    return (
        period(),
        speed_harmonic("speed_cos_1", crank, 1, "cos", "relative crank speed, cosine of the turn"),
        speed_harmonic("speed_sin_1", crank, 1, "sin", "relative crank speed, sine of the turn"),
        speed_harmonic("speed_cos_2", crank, 2, "cos", "relative crank speed, cosine of half a turn"),
        speed_harmonic("speed_sin_2", crank, 2, "sin", "relative crank speed, sine of half a turn"),
    )


def crank_features(crank: str, torque: str) -> tuple[CycleFeature, ...]:
    """Return the features of period, speed and torque of a turn.

    Parameters
    ----------
    crank, torque : str
        Columns of the crank's angle (rad) and of the driving torque (N m).
    """
    return (
        *speed_features(crank),
        mean("torque_mean_nm", "N.m", torque, "mean driving torque"),
        upper("torque_peak_nm", "N.m", torque, "largest driving torque"),
        harmonic("torque_cos_1_nm", "N.m", torque, 1, "cos", "driving torque, cosine of the turn"),
        harmonic("torque_sin_1_nm", "N.m", torque, 1, "sin", "driving torque, sine of the turn"),
        harmonic("torque_cos_2_nm", "N.m", torque, 2, "cos", "driving torque, cosine of half a turn"),
        harmonic("torque_sin_2_nm", "N.m", torque, 2, "sin", "driving torque, sine of half a turn"),
    )
