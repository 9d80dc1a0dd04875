# SPDX-License-Identifier: Apache-2.0
"""What may differ from day to day on a healthy winding drum."""

from __future__ import annotations

from mech_twin.capabilities.operating_point import FREQUENCY_RANGE, OperatingVariable, varying_key
from mech_twin.machines.winding_drum.parameters import WindingDrum


def operating(parameters: WindingDrum) -> tuple[OperatingVariable, ...]:
    """Return the speed of the yarn, which the supply gives, and the yarn's weight."""
    speed, density = "yarn_speed_m_per_s", "package_density_kg_per_m3"
    return (
        varying_key("supply_frequency", "frequency of the supply", speed, FREQUENCY_RANGE, "supply_sag"),
        varying_key("yarn_weight", "density of the package, by the yarn's moisture", density, 0.1, "density"),
    )
