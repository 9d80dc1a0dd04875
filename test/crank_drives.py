# SPDX-License-Identifier: Apache-2.0
"""Overrides of crank machines that several of their tests share: induction motors behind a gear, a boom."""

from __future__ import annotations

from typing import Any


def kloss_drive(power_w: float, inertia_kg_m2: float, ratio: float) -> dict[str, Any]:
    """Return an induction motor with four poles (Kloss curve) behind a gear of efficiency 0.95."""
    return {
        "drive.kind": "kloss",
        "motor.rated_power_w": power_w,
        "motor.rated_speed_rpm": 1440.0,
        "motor.synchronous_speed_rpm": 1500.0,
        "motor.breakdown_torque_ratio": 2.5,
        "motor.starting_torque_ratio": 2.0,
        "motor.rotor_inertia_kg_m2": inertia_kg_m2,
        "gear.ratio": ratio,
        "gear.efficiency": 0.95,
    }


VIBRATION_CRANK_KLOSS = kloss_drive(7500.0, 0.03, 9.6)
PRESS_KLOSS = kloss_drive(2200.0, 0.01, 4.8) | {"flywheel.inertia_kg_m2": 3.0}
BOOM = {
    "boom.pivot_x_m": -1.2,
    "boom.pivot_y_m": 0.504,
    "boom.length_m": 1.2,
    "boom.load_ratio": 1.3,
    "boom.side": "left",
}
