# SPDX-License-Identifier: Apache-2.0
"""What may differ from day to day on a healthy vibration crank."""

from __future__ import annotations

from mech_twin.capabilities.operating_point import OperatingVariable, drive_variables, varying_key
from mech_twin.machines.vibration_crank.parameters import VibrationCrank


def operating(parameters: VibrationCrank) -> tuple[OperatingVariable, ...]:
    """Return supply and load."""
    load = varying_key("boom_load", "mass that the boom carries", "masses.tree_kg", 0.1, "boom_load")
    return (*drive_variables(parameters.drive.kind), load)
