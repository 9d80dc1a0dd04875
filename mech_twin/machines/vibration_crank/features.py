# SPDX-License-Identifier: Apache-2.0
"""What sensors tell of one turn of the vibration crank."""

from __future__ import annotations

from mech_twin.capabilities.crank_features import crank_features
from mech_twin.capabilities.cycle import CycleFeatures, CycleReference, harmonic, mean, swing
from mech_twin.machines.vibration_crank.parameters import VibrationCrank

CRANK, TORQUE, SLIDER = "linkage.crank.position", "linkage.crank.effort", "linkage.slider.position"
FRAME_X, FRAME_Y = "forces.shaking_force_x_n", "forces.shaking_force_y_n"


def features(parameters: VibrationCrank) -> CycleFeatures:
    """Return the features of a turn of the crank."""
    return CycleFeatures(
        CycleReference(CRANK),
        (
            *crank_features(CRANK, TORQUE),
            swing("stroke_m", "m", SLIDER, "stroke of the slider"),
            mean("slider_mean_m", "m", SLIDER, "mean place of the slider"),
            mean("frame_x_mean_n", "N", FRAME_X, "mean force on the frame across"),
            mean("frame_y_mean_n", "N", FRAME_Y, "mean force on the frame along"),
            harmonic("frame_x_sin_1_n", "N", FRAME_X, 1, "sin", "force on the frame across, sine of the turn"),
            harmonic("frame_x_cos_1_n", "N", FRAME_X, 1, "cos", "force on the frame across, cosine of the turn"),
            harmonic("frame_y_sin_1_n", "N", FRAME_Y, 1, "sin", "force on the frame along, sine of the turn"),
            harmonic("frame_y_cos_2_n", "N", FRAME_Y, 2, "cos", "force on the frame along, cosine of half a turn"),
        ),
    )
