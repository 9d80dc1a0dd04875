# SPDX-License-Identifier: Apache-2.0
"""Metrics of the winding drum: of one position, of one package, of one run."""

from __future__ import annotations

from math import hypot, pi
from typing import Any

import numpy as np

from mech_twin.machines.winding_drum.dynamics import drive_torque
from mech_twin.machines.winding_drum.memory import DrumMemory
from mech_twin.machines.winding_drum.parameters import WoundPackage
from mech_twin.machines.winding_drum.roles import place_of
from mech_twin.machines.winding_drum.wound_package import (
    Package,
    gravity_moment,
    package_inertia,
    package_mass,
    speed_terms,
    tangent_arm,
    torque_terms,
    wound_at,
)
from mech_twin.samples import Frame

GRID = 3600


def position_metrics(parameters: WoundPackage, package: Package, phi: float) -> dict[str, Any]:
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


def package_metrics(parameters: WoundPackage, package: Package, first: float, last: float) -> dict[str, float]:
    """Return the metrics of the whole package and of one turn of the full package at the rated yarn speed."""
    radius, theta = parameters.package_radius_m, parameters.yarn_speed_m_per_s
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
        "package_inertia_kg_m2": now["package_inertia_kg_m2"],
        "package_mass_kg": now["package_mass_kg"],
        "acceleration_torque_nm": now["acceleration_torque_nm"],
        "radius_torque_nm": now["radius_torque_nm"],
        "mass_torque_nm": now["mass_torque_nm"],
        "dynamic_torque_nm": now["dynamic_torque_nm"],
        "eccentric_torque_amplitude_nm": float(np.max(np.abs(eccentric))),
        "eccentric_torque_sign_changes_per_turn": float(sign_changes(eccentric)) if np.any(eccentric) else 0.0,
        "ideal_terms_sign_changes_per_turn": float(sign_changes(radial) + sign_changes(mass)),
        "steady_torque_max_nm": float(np.max(total)),
        "steady_torque_min_nm": float(np.min(total)),
    }


class DrumObserver:
    """Metrics of a run."""

    def __init__(self) -> None:
        self._numbers = {
            "torque_max_nm": float("-inf"),
            "torque_min_nm": float("inf"),
            "speed_max_rad_per_s": 0.0,
            "package_radius_m": 0.0,
            "yarn_run_m": 0.0,
            "turns": 0.0,
            "drive_work_j": 0.0,
            "friction_loss_j": 0.0,
            "shaft_force_max_n": 0.0,
        }

    def observe(self, frame: Frame) -> None:
        """Update with one frame."""
        now, linkage = self._numbers, frame.linkage
        torque, _, _ = linkage.effort
        now["torque_max_nm"] = max(now["torque_max_nm"], torque)
        now["torque_min_nm"] = min(now["torque_min_nm"], torque)
        now["speed_max_rad_per_s"] = max(now["speed_max_rad_per_s"], place_of(linkage).drum_rad_per_s)
        at, memory = place_of(linkage), DrumMemory(*linkage.memory.values)
        now["turns"] = at.drum_rad / (2.0 * pi)
        now["yarn_run_m"] = at.yarn_m
        now["package_radius_m"] = at.package_radius_m
        now["drive_work_j"] = memory.drive_work_j
        now["friction_loss_j"] = memory.friction_loss_j
        (shaft,) = frame.forces.wrenches
        now["shaft_force_max_n"] = max(now["shaft_force_max_n"], hypot(shaft.force_x_n, shaft.force_y_n))
        for event in linkage.events:
            if event.contact == "package":
                now[f"{event.kind}_at_s"] = event.time_s

    def numbers(self) -> dict[str, float]:
        """Return the metrics so far."""
        return dict(self._numbers)
