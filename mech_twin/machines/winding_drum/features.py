# SPDX-License-Identifier: Apache-2.0
"""What sensors tell of one turn of the winding drum.

The package changes all the time, so a turn is compared with the model's own torque at the radius that the yarn of that
turn tells, R = yarn/(2 pi): what is left does not drift as the package runs off.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from mech_twin.capabilities.cycle import TURN, CycleFeature, CycleFeatures, CycleReference, SampledCycle, speed_harmonic
from mech_twin.machines.winding_drum.dynamics import drive_torque
from mech_twin.machines.winding_drum.parameters import WindingDrum, package_constants
from mech_twin.machines.winding_drum.wound_package import Package, package_mass

DRUM, YARN, TORQUE = "linkage.drum.position", "linkage.yarn.position", "linkage.drum.effort"
ANGLES = np.arange(24) * TURN / 24.0
GRAVITY = 9.80665
RUN_UP_S = 16.0


def features(parameters: WindingDrum) -> CycleFeatures:
    """Return the features of a turn: torque beside the model's, and the package's run-out."""
    package = package_constants(parameters, parameters.direction == "winding")
    return CycleFeatures(
        CycleReference(DRUM),
        (
            _torque_left("torque_left_nm", "N.m", package, 0, "mean torque less that of the model at this radius"),
            _torque_left("weight_cos_1_m", "m", package, 1, "the same, cosine of the turn, over the package's weight"),
            _torque_left("weight_sin_1_m", "m", package, -1, "the same, sine of the turn, over the package's weight"),
            _run_out("run_out_cos_1_m", "cos", "offset of the package by the drum's speed, cosine of the turn"),
            _run_out("run_out_sin_1_m", "sin", "offset of the package by the drum's speed, sine of the turn"),
        ),
        2,
        RUN_UP_S,
    )


def _yarn_per_radian(cycle: SampledCycle) -> float:
    """Return the slope of yarn over drum angle (m): the radius of the package."""
    yarn = cycle.channels[YARN]
    return float(np.polyfit(yarn.phase_rad, yarn.values, 1)[0])


def _torque_left(name: str, unit: str, package: Package, order: int, meaning: str) -> CycleFeature:
    """Return a coefficient of the measured torque less the model's: order 0 the mean, 1 cosine, -1 sine."""

    def coefficient(phase: np.ndarray, weights: np.ndarray, torque: np.ndarray) -> float:
        wave = 1.0 if order == 0 else 2.0 * (np.cos(phase) if order > 0 else np.sin(phase))
        return float((weights * wave) @ torque)

    def of(cycle: SampledCycle) -> float:
        radius, measured = _yarn_per_radian(cycle), cycle.channels[TORQUE]
        yarn_m_per_s = radius * TURN / cycle.period_s
        model = np.array([drive_torque(package, radius, phi, yarn_m_per_s, 0.0) for phi in ANGLES])
        left = coefficient(measured.phase_rad, measured.weights, measured.values) - coefficient(
            ANGLES, np.full(len(ANGLES), 1.0 / len(ANGLES)), model
        )
        return left if order == 0 else left / (GRAVITY * package_mass(package, radius))

    return CycleFeature(name, unit, meaning, (YARN, TORQUE), of)


def _run_out(name: str, part: Literal["cos", "sin"], meaning: str) -> CycleFeature:
    """Return a coefficient of the drum's relative speed times the radius: about the eccentricity at steady yarn."""
    relative = speed_harmonic(name, DRUM, 1, part, meaning)
    return CycleFeature(name, "m", meaning, (DRUM, YARN), lambda cycle: relative.of(cycle) * _yarn_per_radian(cycle))
