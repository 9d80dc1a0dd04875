# SPDX-License-Identifier: Apache-2.0
"""What a monitor asks of the winding drum: features of a turn, faults, the operating point.

The package runs off, so a turn is compared with the model's torque at the radius R found from the yarn of that turn.
Torque is linear in the package's density, M = M_0 + k M_1 with k = 1 as configured.  k follows from the turn by least
squares.  The residual then depends neither on the radius nor on the density::

    k = <M_1, M - M_0>/<M_1, M_1>,      R(phi) = R - L (phi - pi)
"""

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
from mech_twin.capabilities.operating_point import OperatingVariable, prescribed_speed, varying_key
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.winding_drum.dynamics import drive_torque
from mech_twin.machines.winding_drum.parameters import WindingDrum, package_constants
from mech_twin.machines.winding_drum.wound_package import Package, wound_at

DRUM, YARN, TORQUE = "linkage.drum.position", "linkage.yarn.position", "linkage.drum.effort"
RUN_UP_S = 16.0
STEADY = 0.0025  # of twice the yarn's speed, by which it may differ in the halves of a turn: inertia is not told then
# a sensor of the yarn that is stuck, or tells nonsense, tells of no package
LEAST_OF_CORE, MOST_OF_CORE = 0.5, 1000.0


def features(parameters: WindingDrum) -> CycleFeatures:
    """Return the features of a turn: speed, density, torque minus the model's, and the package's run-out."""
    package = package_constants(parameters, parameters.direction == "winding")
    return CycleFeatures(
        CycleReference(DRUM),
        (
            CycleFeature("yarn_speed_m_per_s", "m/s", "mean speed of the yarn", (YARN,), _yarn_speed),
            _density(package),
            _torque_left("torque_left_nm", package, 0, "mean torque less that of the model at this radius and density"),
            _torque_left("torque_left_cos_1_nm", package, 1, "the same, cosine of the turn"),
            _run_out("run_out_cos_1_m", "cos", "offset of the package by the drum's speed, cosine of the turn"),
            _run_out("run_out_sin_1_m", "sin", "offset of the package by the drum's speed, sine of the turn"),
        ),
        2,
        RUN_UP_S,
    )


def _yarn_per_radian(cycle: SampledCycle) -> float:
    """Return the slope of yarn over drum angle (m): the radius of the package; nan while the yarn changes speed."""
    yarn = cycle.channels[YARN]
    half = len(yarn.values) // 2
    before, after = (fitted_slope(yarn.times_s[part], yarn.values[part]) for part in (slice(half), slice(half, None)))
    if not abs(after - before) <= STEADY * abs(before + after):
        return math.nan
    return fitted_slope(yarn.phase_rad, yarn.values)


def _yarn_speed(cycle: SampledCycle) -> float:
    yarn = cycle.channels[YARN]
    return fitted_slope(yarn.times_s, yarn.values)


def _density_fit(package: Package, cycle: SampledCycle) -> tuple[float, Array, Array]:
    """Return density relative to the configured one, and the model's torques M_0 and M_1 at each sample (N m)."""
    radius, measured = _yarn_per_radian(cycle), cycle.channels[TORQUE]
    least = max(LEAST_OF_CORE * package.core_m, package.eccentricity_m)
    if not least < radius < MOST_OF_CORE * package.core_m:
        return math.nan, measured.values, measured.values
    speed = radius * TURN / cycle.period_s
    bare = _model_torques(package._replace(density=0.0), radius, speed, measured.phase_rad)
    wound = _model_torques(package, radius, speed, measured.phase_rad) - bare
    whole = weighted_sum(measured.weights, wound * wound)
    k = weighted_sum(measured.weights, wound * (measured.values - bare)) / whole if whole > 0.0 else math.nan
    return k, bare, wound


def _density(package: Package) -> CycleFeature:
    return CycleFeature(
        "density_share", "1", "density of the package over that configured", (YARN, TORQUE),
        lambda cycle: _density_fit(package, cycle)[0],
    )  # fmt: skip


def _torque_left(name: str, package: Package, order: int, meaning: str) -> CycleFeature:
    """Return a coefficient of measured minus modelled torque at the fitted density: order 0 the mean, 1 the cosine."""

    def of(cycle: SampledCycle) -> float:
        measured, (k, bare, wound) = cycle.channels[TORQUE], _density_fit(package, cycle)
        left = measured.values - bare - k * wound
        if order == 0:
            return weighted_sum(measured.weights, left)
        return fourier_coefficient(measured.weights, measured.phase_rad, left, order, False)

    return CycleFeature(name, "N.m", meaning, (YARN, TORQUE), of)


@kernel
def _model_torques(package: Package, radius: float, yarn_m_per_s: float, phase_rad: Array) -> Array:
    """Return the drive torque (N m) at angles of a turn, for a package radius (m) at its middle."""
    found = np.empty(len(phase_rad))
    for i in range(len(phase_rad)):
        here = radius - package.layer_m * (phase_rad[i] - math.pi)
        found[i] = drive_torque(package, wound_at(package, here), phase_rad[i], yarn_m_per_s, 0.0)
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
    density = "package_density_kg_per_m3"
    return (
        prescribed_speed("yarn_speed_m_per_s"),
        varying_key("yarn_weight", "density of the package, by the yarn's moisture", density, 0.1, "density"),
    )
