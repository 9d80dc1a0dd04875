# SPDX-License-Identifier: Apache-2.0
"""What a monitor asks of the machine: features of a cycle, faults, the operating point."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from mech_twin.capabilities.cycle import (
    TURN,
    Array,
    CycleFeature,
    CycleFeatures,
    CycleReference,
    SampledCycle,
    speed_harmonic,
)
from mech_twin.capabilities.cycle_kernels import fitted_slope, fourier_coefficient, weighted_sum
from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key
from mech_twin.capabilities.operating_point import FREQUENCY_RANGE, OperatingVariable, varying_key
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.winding_drum.dynamics import drive_torque
from mech_twin.machines.winding_drum.parameters import WindingDrum, package_constants
from mech_twin.machines.winding_drum.wound_package import Package, package_mass, wound_at

DRUM, YARN, TORQUE = "linkage.drum.position", "linkage.yarn.position", "linkage.drum.effort"
ANGLES: Array = np.arange(24, dtype=np.float64) * (TURN / 24.0)
EVEN = np.full(len(ANGLES), 1.0 / len(ANGLES))
GRAVITY = 9.80665
RUN_UP_S = 16.0
# a sensor of the yarn that is stuck, or tells nonsense, tells of no package
LEAST_OF_CORE, MOST_OF_CORE = 0.5, 1000.0


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
    return fitted_slope(yarn.phase_rad, yarn.values)


def _torque_left(name: str, unit: str, package: Package, order: int, meaning: str) -> CycleFeature:
    """Return a coefficient of the measured torque less the model's: order 0 the mean, 1 cosine, -1 sine."""

    def of(cycle: SampledCycle) -> float:
        radius, measured = _yarn_per_radian(cycle), cycle.channels[TORQUE]
        least = max(LEAST_OF_CORE * package.core_m, package.eccentricity_m)
        if not least < radius < MOST_OF_CORE * package.core_m:
            return math.nan
        model = _model_torques(package, radius, radius * TURN / cycle.period_s)
        left = _coefficient(measured.weights, measured.phase_rad, measured.values, order) - _coefficient(
            EVEN, ANGLES, model, order
        )
        return left if order == 0 else left / (GRAVITY * package_mass(package, wound_at(package, radius)))

    return CycleFeature(name, unit, meaning, (YARN, TORQUE), of)


def _coefficient(weights: Array, phase_rad: Array, values: Array, order: int) -> float:
    if order == 0:
        return weighted_sum(weights, values)
    return fourier_coefficient(weights, phase_rad, values, 1, order < 0)


@kernel
def _model_torques(package: Package, radius: float, yarn_m_per_s: float) -> Array:
    """Return the torque of the drive at the angles of a turn."""
    found = np.empty(len(ANGLES))
    for i in range(len(ANGLES)):
        found[i] = drive_torque(package, wound_at(package, radius), ANGLES[i], yarn_m_per_s, 0.0)
    return found


def _run_out(name: str, part: Literal["cos", "sin"], meaning: str) -> CycleFeature:
    """Return a coefficient of the drum's relative speed times the radius: about the eccentricity at steady yarn."""
    relative = speed_harmonic(name, DRUM, 1, part, meaning)
    return CycleFeature(name, "m", meaning, (DRUM, YARN), lambda cycle: relative.of(cycle) * _yarn_per_radian(cycle))


def faults(parameters: WindingDrum) -> tuple[MachineFault, ...]:
    """Return the faults of package and drum."""
    return (
        added_to_key(
            "eccentricity", "the package sits off centre", "eccentricity_m", "m", (0.0005, 0.001, 0.002, 0.004, 0.01)
        ),
        share_of_key("density", "the package is denser or softer", "package_density_kg_per_m3", (-0.3, -0.1, 0.1, 0.3)),
        added_to_key("drum_friction", "the drum's bearings rub", "friction.coulomb_nm", "N.m", (0.2, 0.5, 1.0, 2.0)),
    )


def operating(parameters: WindingDrum) -> tuple[OperatingVariable, ...]:
    """Return the speed of the yarn, which the supply gives, and the yarn's weight."""
    speed, density = "yarn_speed_m_per_s", "package_density_kg_per_m3"
    return (
        varying_key("supply_frequency", "frequency of the supply", speed, FREQUENCY_RANGE, "supply_sag"),
        varying_key("yarn_weight", "density of the package, by the yarn's moisture", density, 0.1, "density"),
    )
