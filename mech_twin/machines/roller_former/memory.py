# SPDX-License-Identifier: Apache-2.0
"""State of the roller former that is no joint: modes, works, and the energy balance they make."""

from __future__ import annotations

from typing import NamedTuple


class FormerMemory(NamedTuple):
    """State that is no joint.

    Works are those since the start; ``stored_energy_j`` is the energy at the sample; ``change_work_j`` what parameters
    changed while running put in.  The balance error and the turnover (sum of the sizes of all works) begin anew with
    every turn of the crank, so that neither hours nor a large sum hide an error.
    """

    motor_torque_nm: float = 0.0
    torque_known_1: float = 0.0
    command_change_1: float = 0.0
    direction_1: float = 1.0
    drive_direction_1: float = 1.0
    load_on_1: float = 0.0
    load_share_1: float = 0.0
    slow_s: float = -1.0
    stalled_1: float = 0.0
    motor_work_j: float = 0.0
    damping_work_j: float = 0.0
    load_work_j: float = 0.0
    friction_work_j: float = 0.0
    change_work_j: float = 0.0
    stored_energy_j: float = 0.0
    turn_balance_error_j: float = 0.0
    turn_turnover_j: float = 0.0
