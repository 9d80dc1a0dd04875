"""Figures of the winding drum: one position, one package, one run, and its drawing."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any

import numpy as np

from mech_twin.machines.winding_drum.wound_package import (
    Package,
    WoundPackage,
    package_inertia,
    package_mass,
    speed_terms,
    tangent_arm,
    torque_terms,
)
from mech_twin.samples import Frame, LinkageSample, Shape

GRID = 3600


def position_figures(parameters: WoundPackage, package: Package, phi: float) -> dict[str, Any]:
    """Return speeds and torque terms of the full package at drum angle ``phi`` (rad).

    Yarn speed and acceleration are the configured ones; the ideal package (e = 0) stands beside the eccentric one.
    """
    radius = parameters.package_radius_m
    theta, a = parameters.yarn_speed_m_per_s, parameters.yarn_acceleration_m_per_s2
    ideal = package._replace(eccentricity_m=0.0)
    terms = torque_terms(package, radius, phi, theta, a)
    rho = tangent_arm(package, radius, phi)
    return {
        "drum_angle_rad": phi,
        "package_radius_m": radius,
        "tangent_arm_m": rho,
        "angular_speed_rad_per_s": theta / rho,
        "angular_acceleration_rad_per_s2": sum(speed_terms(package, radius, phi, theta, a)),
        "package_inertia_kg_m2": package_inertia(package, radius),
        "package_mass_kg": package_mass(package, radius),
        "acceleration_torque_nm": terms.acceleration,
        "radius_torque_nm": terms.radius,
        "eccentric_torque_nm": terms.eccentric,
        "mass_torque_nm": terms.mass,
        "dynamic_torque_nm": terms.total,
        "steady_torque_nm": torque_terms(package, radius, phi, theta, 0.0).total,
        "ideal_torque_nm": torque_terms(ideal, radius, phi, theta, a).total,
        "ideal_steady_torque_nm": torque_terms(ideal, radius, phi, theta, 0.0).total,
    }


def sign_changes(values: np.ndarray) -> int:
    """Return how often a closed curve, sampled over one turn, changes its sign (zeros belong to neither side)."""
    signs = np.sign(values[np.abs(values) > 1e-12 * max(float(np.max(np.abs(values))), 1e-300)])
    return int(np.count_nonzero(signs != np.roll(signs, 1)))


def cycle_report(parameters: WoundPackage, package: Package, first: float, last: float) -> dict[str, float]:
    """Return the figures of the whole package and of one turn of the full package at the rated yarn speed."""
    radius, theta = parameters.package_radius_m, parameters.yarn_speed_m_per_s
    angles = np.arange(GRID) * 2.0 * pi / GRID
    turn = np.array([torque_terms(package, radius, phi, theta, 0.0) for phi in angles])
    length = (first * first - last * last) / (2.0 * package.layer_m)
    now = position_figures(parameters, package, 0.0)
    return {
        "yarn_length_m": length,
        "run_time_at_rated_speed_s": length / theta,
        "turns_of_ideal_package": (first - last) / (2.0 * pi * package.layer_m),
        "angular_speed_first_rad_per_s": theta / first,
        "angular_speed_last_rad_per_s": theta / last,
        "package_inertia_kg_m2": now["package_inertia_kg_m2"],
        "package_mass_kg": now["package_mass_kg"],
        "acceleration_torque_nm": now["acceleration_torque_nm"],
        "radius_torque_nm": now["radius_torque_nm"],
        "mass_torque_nm": now["mass_torque_nm"],
        "dynamic_torque_nm": now["dynamic_torque_nm"],
        "eccentric_torque_amplitude_nm": float(np.max(np.abs(turn[:, 2]))),
        "eccentric_torque_sign_changes_per_turn": float(sign_changes(turn[:, 2])) if np.any(turn[:, 2]) else 0.0,
        "ideal_terms_sign_changes_per_turn": float(sign_changes(turn[:, 1]) + sign_changes(turn[:, 3])),
        "steady_torque_max_nm": float(np.max(turn[:, 4])),
        "steady_torque_min_nm": float(np.min(turn[:, 4])),
    }


class DrumObserver:
    """Running figures of a run."""

    def __init__(self) -> None:
        self._numbers = {
            "torque_max_nm": float("-inf"),
            "torque_min_nm": float("inf"),
            "speed_max_rad_per_s": 0.0,
            "package_radius_m": 0.0,
            "yarn_length_m": 0.0,
            "turns": 0.0,
            "drive_work_j": 0.0,
        }

    def observe(self, frame: Frame) -> None:
        """Take one frame into account."""
        now, linkage = self._numbers, frame.linkage
        torque = linkage.effort[0]
        now["torque_max_nm"] = max(now["torque_max_nm"], torque)
        now["torque_min_nm"] = min(now["torque_min_nm"], torque)
        now["speed_max_rad_per_s"] = max(now["speed_max_rad_per_s"], linkage.velocity[0])
        now["turns"] = linkage.position[0] / (2.0 * pi)
        now["yarn_length_m"] = linkage.position[1]
        now["package_radius_m"] = linkage.position[2]
        now["drive_work_j"] = linkage.memory.as_dict()["drive_work_j"]
        for event in linkage.events:
            if event.contact == "package":
                now[f"{event.kind}_at_s"] = event.time_s

    def numbers(self) -> dict[str, float]:
        """Return the figures so far."""
        return dict(self._numbers)


def _circle(x: float, y: float, radius: float) -> tuple[tuple[float, float], ...]:
    angles = [2.0 * pi * i / 72 for i in range(73)]
    return tuple((x + radius * cos(angle), y + radius * sin(angle)) for angle in angles)


def package_drawing(package: Package, sample: LinkageSample) -> tuple[Shape, ...]:
    """Return the package, its core, a mark that turns with it, and the yarn that leaves at the top."""
    phi, _, radius = sample.position
    x, y = package.eccentricity_m * cos(phi), package.eccentricity_m * sin(phi)
    top = y + radius
    return (
        Shape("package", "line", _circle(x, y, radius), (196, 164, 112), 0.004),
        Shape("core", "line", _circle(0.0, 0.0, package.core_m), (90, 90, 90), 0.004),
        Shape("mark", "line", ((0.0, 0.0), (x + radius * cos(phi), y + radius * sin(phi))), (200, 60, 40), 0.003),
        Shape("yarn", "line", ((x, top), (x - 4.0 * package.core_m - radius, top)), (60, 90, 180), 0.002),
        Shape("axis", "points", ((0.0, 0.0),), (0, 0, 0), 0.008),
    )
