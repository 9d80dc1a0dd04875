# SPDX-License-Identifier: Apache-2.0
"""What may differ from day to day on a healthy press."""

from __future__ import annotations

from mech_twin.capabilities.operating_point import OperatingVariable, drive_variables, varying_key
from mech_twin.machines.compaction_press.parameters import CompactionPress


def operating(parameters: CompactionPress) -> tuple[OperatingVariable, ...]:
    """Return supply and layer."""
    layer = varying_key("layer", "force of the layer at the bottom", "working_force.peak_n", 0.1, "layer_force")
    return (*drive_variables(parameters.drive.kind), layer)
