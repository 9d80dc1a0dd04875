# SPDX-License-Identifier: Apache-2.0
"""What may differ from day to day on a healthy breaker."""

from __future__ import annotations

from mech_twin.capabilities.operating_point import OperatingVariable, motor_variables, varying_key
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters


def operating(parameters: BreakerParameters) -> tuple[OperatingVariable, ...]:
    """Return supply, motor temperature, the tool within its tolerance, and the wall."""
    return (
        *motor_variables(),
        varying_key("tool_load", "mass that the blow meets", "tool.mass_kg", 0.1, "tool_mass"),
        varying_key("tool_face", "restitution of the tool's face", "tool.restitution", 0.05, "tool_restitution"),
        varying_key("wall", "force of the wall", "tool.wall_force_n", 0.2, "wall_range"),
    )
