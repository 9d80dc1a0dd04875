# SPDX-License-Identifier: Apache-2.0
"""What may differ from day to day on a healthy roller former."""

from __future__ import annotations

from mech_twin.capabilities.operating_point import OperatingVariable, motor_variables, varying_key
from mech_twin.machines.roller_former.parameters import RollerFormer

MIX_X, MIX_Y = "carts.roller_force_x_n", "carts.roller_force_y_n"


def operating(parameters: RollerFormer) -> tuple[OperatingVariable, ...]:
    """Return supply, motor temperature and mix, whose force on a roller keeps its direction."""
    return (*motor_variables(), varying_key("mix", "force of the mix on the rollers", MIX_X, 0.1, "cart_load", MIX_Y))
