# SPDX-License-Identifier: Apache-2.0
"""Metrics of the winding drum (one position, one package, one run), and what a monitor asks of it.

The package runs off, so a turn is compared with the model's torque at the radius R found from the yarn of that turn.
Torque is linear in the package's density, M = M_0 + k M_1 with k = 1 as configured.  k follows from the turn by least
squares.  The residual then depends neither on the radius nor on the density::

    k = <M_1, M - M_0>/<M_1, M_1>,      R(phi) = R - L (phi - pi)
"""

import math
from math import hypot, pi
from typing import Any, Literal

import numpy as np

from mech_twin.capabilities.cycle import (
    TURN,
    Array,
    CycleFeature,
    CycleFeatures,
    CycleReference,
    SampledCycle,
    fitted_slope,
    fourier_coefficient,
    speed_harmonic,
    weighted_sum,
)
from mech_twin.capabilities.faults import (
    MachineFault,
    OperatingVariable,
    added_to_key,
    beyond_range,
    prescribed_speed,
    share_of_key,
    varying_key,
)
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.crank_run import Extremes
from mech_twin.machines.winding_drum.dynamics import (
    Package,
    drive_torque,
    gravity_moment,
    package_inertia,
    package_mass,
    speed_terms,
    tangent_arm,
    torque_terms,
    wound_at,
)
from mech_twin.machines.winding_drum.parameters import WindingDrum, package_constants
from mech_twin.machines.winding_drum.roles import DrumMemory
from mech_twin.samples import Frame, LinkageSample

DRUM, YARN, TORQUE = "linkage.drum.position", "linkage.yarn.position", "linkage.drum.effort"
RUN_UP_S = 16.0
STEADY = 0.0025  # of twice the yarn's speed, by which it may differ in the halves of a turn: inertia is not told then
# a sensor of the yarn that is stuck, or tells nonsense, tells of no package
LEAST_OF_CORE, MOST_OF_CORE = 0.5, 1000.0
GRID = 3600
OF_PACKAGE = (  # of the full package at angle 0, in a report too
    "package_inertia_kg_m2",
    "package_mass_kg",
    "acceleration_torque_nm",
    "radius_torque_nm",
    "mass_torque_nm",
    "dynamic_torque_nm",
)


def features(parameters: WindingDrum) -> CycleFeatures:
    """Return the features of a turn: speed, density, torque minus the model's, and the package's run-out."""
    package = package_constants(parameters, parameters.direction == "winding")

    def speed(cycle: SampledCycle) -> float:
        return fitted_slope(cycle.channels[YARN].times_s, cycle.channels[YARN].values)

    def density(cycle: SampledCycle) -> float:
        return _density_fit(package, cycle)[0]

    return CycleFeatures(
        CycleReference(DRUM),
        (
            CycleFeature("yarn_speed_m_per_s", "m/s", "mean speed of the yarn", (YARN,), speed),
            CycleFeature("density_share", "1", "density of the package over that configured", (YARN, TORQUE), density),
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


YARN_SPEED = prescribed_speed("yarn_speed_m_per_s")


def faults(parameters: WindingDrum) -> tuple[MachineFault, ...]:
    """Return the faults of package, drum and supply."""
    return (
        added_to_key(
            "eccentricity", "the package sits off centre", "eccentricity_m", "m", (0.0005, 0.001, 0.002, 0.004, 0.01)
        ),
        share_of_key("density", "the package is denser or softer", "package_density_kg_per_m3", (-0.3, -0.1, 0.1, 0.3)),
        added_to_key("drum_friction", "the drum's bearings rub", "friction.coulomb_nm", "N.m", (0.2, 0.5, 1.0, 2.0)),
        beyond_range(YARN_SPEED),
    )


def operating(parameters: WindingDrum) -> tuple[OperatingVariable, ...]:
    """Return the speed of the yarn, which the supply gives, and the yarn's weight."""
    density = "package_density_kg_per_m3"
    return (
        YARN_SPEED,
        varying_key("yarn_weight", "density of the package, by the yarn's moisture", density, 0.1, "density"),
    )


def position_metrics(parameters: WindingDrum, package: Package, phi: float) -> dict[str, Any]:
    """Return speeds and torque terms of the full package at drum angle ``phi`` (rad).

    Yarn speed and acceleration are the configured ones; the ideal package (e = 0) is given besides the eccentric one.
    """
    radius = parameters.package_radius_m
    wound = wound_at(package, radius)
    theta, a = parameters.yarn_speed_m_per_s, parameters.yarn_acceleration_m_per_s2
    ideal = package._replace(eccentricity_m=0.0)
    terms = torque_terms(package, wound, phi, theta, a)
    rho = tangent_arm(package, radius, phi)
    return {
        "drum_angle_rad": phi,
        "package_radius_m": radius,
        "tangent_arm_m": rho,
        "angular_speed_rad_per_s": theta / rho,
        "angular_acceleration_rad_per_s2": sum(speed_terms(package, radius, phi, theta, a)),
        "package_inertia_kg_m2": package_inertia(package, wound),
        "package_mass_kg": package_mass(package, wound),
        "acceleration_torque_nm": terms.acceleration,
        "radius_torque_nm": terms.radius,
        "eccentric_torque_nm": terms.eccentric,
        "mass_torque_nm": terms.mass,
        "dynamic_torque_nm": terms.total,
        "gravity_moment_nm": gravity_moment(package, wound, phi),
        "drive_torque_nm": drive_torque(package, wound, phi, theta, a),
        "steady_torque_nm": torque_terms(package, wound, phi, theta, 0.0).total,
        "ideal_torque_nm": torque_terms(ideal, wound, phi, theta, a).total,
        "ideal_steady_torque_nm": torque_terms(ideal, wound, phi, theta, 0.0).total,
    }


def sign_changes(values: np.ndarray) -> int:
    """Return the number of sign changes of a periodic curve sampled over one turn (zeros are skipped)."""
    signs = np.sign(values[np.abs(values) > 1e-12 * max(float(np.max(np.abs(values))), 1e-300)])
    return int(np.count_nonzero(signs != np.roll(signs, 1)))


def package_metrics(parameters: WindingDrum, package: Package) -> dict[str, float]:
    """Return the metrics of the whole package and of one turn of the full package at the rated yarn speed."""
    radius, theta, (first, last) = parameters.package_radius_m, parameters.yarn_speed_m_per_s, parameters.radii_m
    wound = wound_at(package, radius)
    angles = np.arange(GRID) * 2.0 * pi / GRID
    turn = np.array([torque_terms(package, wound, phi, theta, 0.0) for phi in angles])
    _, radial, eccentric, mass, total = turn.T
    length = (first * first - last * last) / (2.0 * package.layer_m)
    now = position_metrics(parameters, package, 0.0)
    return {
        "yarn_length_m": length,
        "run_time_at_rated_speed_s": length / theta,
        "turns_of_ideal_package": (first - last) / (2.0 * pi * package.layer_m),
        "angular_speed_first_rad_per_s": theta / first,
        "angular_speed_last_rad_per_s": theta / last,
        **{name: now[name] for name in OF_PACKAGE},
        "eccentric_torque_amplitude_nm": float(np.max(np.abs(eccentric))),
        "eccentric_torque_sign_changes_per_turn": float(sign_changes(eccentric)) if np.any(eccentric) else 0.0,
        "ideal_terms_sign_changes_per_turn": float(sign_changes(radial) + sign_changes(mass)),
        "steady_torque_max_nm": float(np.max(total)),
        "steady_torque_min_nm": float(np.min(total)),
    }


class DrumObserver:
    """Metrics of a run."""

    def __init__(self) -> None:
        self._extremes, self._ends = Extremes(), dict[str, float]()
        self._last: LinkageSample | None = None

    def observe(self, frame: Frame) -> None:
        """Update with one frame."""
        self._last = linkage = frame.linkage
        (shaft,) = frame.forces.wrenches
        self._extremes.take("torque_{}_nm", linkage.effort[0])
        self._extremes.take("speed_{}_rad_per_s", max(0.0, linkage.velocity[0]))
        self._extremes.take("shaft_force_{}_n", hypot(shaft.force_x_n, shaft.force_y_n))
        for event in linkage.events:
            if event.contact == "package":
                self._ends[f"{event.kind}_at_s"] = event.time_s

    def numbers(self) -> dict[str, float]:
        """Return the metrics so far."""
        if self._last is None:
            return {}
        most, memory = self._extremes.numbers(""), DrumMemory(*self._last.memory.values)
        drum_rad, yarn_m, radius_m = self._last.position
        return {
            "torque_max_nm": most["torque_max_nm"],
            "torque_min_nm": most["torque_min_nm"],
            "speed_max_rad_per_s": most["speed_max_rad_per_s"],
            "package_radius_m": radius_m,
            "yarn_run_m": yarn_m,
            "turns": drum_rad / (2.0 * pi),
            "drive_work_j": memory.drive_work_j,
            "friction_loss_j": memory.friction_loss_j,
            "shaft_force_max_n": most["shaft_force_max_n"],
            **self._ends,
        }
