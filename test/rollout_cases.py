# SPDX-License-Identifier: Apache-2.0
"""Configurations that cover the kernels of every machine: as installed, and with the models of the other branches."""

from __future__ import annotations

from typing import Any

from mech_twin.machines.catalog import CATALOGUE

KLOSS: dict[str, Any] = {
    "drive.kind": "kloss",
    "motor.rated_power_w": 7500.0,
    "motor.rated_speed_rpm": 1440.0,
    "motor.synchronous_speed_rpm": 1500.0,
    "motor.breakdown_torque_ratio": 2.5,
    "motor.starting_torque_ratio": 2.0,
    "motor.rotor_inertia_kg_m2": 0.03,
    "gear.ratio": 9.6,
    "gear.efficiency": 0.95,
    "friction.coulomb_nm": 20.0,
}
CASES: list[tuple[str, dict[str, Any]]] = [
    *((name, {}) for name in CATALOGUE),
    ("compaction_press", KLOSS),
    ("vibration_crank", KLOSS),
    ("mb10_breaker", {"excitation.kind": "approximated"}),
    ("mb10_breaker", {"friction.coulomb_nm": 2.0, "body.friction.coulomb_nm": 8.0}),
    ("mb10_breaker", {"tool.model": "wave"}),
    ("mb10_breaker", {"tool.model": "wave", "tool.wave.wall.kind": "loading"}),
    ("impact_mass", {"contact_stiffness_n_per_m": 1e7}),
    ("impact_mass", {"stop.model": "wave"}),
    ("winding_drum", {"package_radius_m": 0.0812, "supply.initial_fraction": 1.0, "friction.coulomb_nm": 20.0}),
]
IDS = [f"{name}-{len(overrides)}" for name, overrides in CASES]
