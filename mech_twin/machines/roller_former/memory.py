# SPDX-License-Identifier: Apache-2.0
"""The numbers of the roller former's linkage row by name: joints of the shaft, and its memory.

The memory holds modes, works, and their energy balance.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from mech_twin.engine.records import record_at, record_of
from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import borrowing_kernel


class ShaftMotion(NamedTuple):
    """First numbers of the row: regime, command of the motor; angle, rate, effort of drive, crank and twist.

    Position, velocity and effort of cart and rod of each crank follow.
    """

    regime: float
    command: float
    drive_rad: float
    drive_rad_per_s: float
    drive_nm: float
    crank_rad: float
    crank_rad_per_s: float
    crank_nm: float
    twist_rad: float
    twist_rad_per_s: float
    twist_nm: float


class FormerMemory(NamedTuple):
    """State besides the joints.

    Works are those since the start; ``stored_energy_j`` is the energy at the sample; ``change_work_j`` is the energy
    added by live changes of parameters.  The balance error and the turnover (sum of the magnitudes of all works) are
    reset with every turn of the crank, so that a long run or a large sum hides no error.
    """

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


class FormerResiduals(NamedTuple):
    """Residuals, zero but for rounding: energy balance, and length of the rods."""

    energy_balance: float
    rod_length: float


SHAFT, MEMORY, RESIDUALS = record_of(ShaftMotion), record_of(FormerMemory), record_of(FormerResiduals)
CARTS_AT = len(ShaftMotion._fields)
MEMORY_SIZE = len(FormerMemory._fields)


@borrowing_kernel
def shaft_of(row: Array) -> Any:
    """Return the first numbers of a linkage row as a record that shares them."""
    return record_at(row, 0, SHAFT)


@borrowing_kernel
def memory_of(row: Array, carts: int) -> Any:
    """Return the memory in a linkage row with this number of carts as a record that shares its numbers."""
    return record_at(row, CARTS_AT + 6 * carts, MEMORY)


@borrowing_kernel
def residuals_of(row: Array, carts: int) -> Any:
    """Return the residuals in a linkage row with this number of carts as a record that shares its numbers."""
    return record_at(row, CARTS_AT + 6 * carts + MEMORY_SIZE, RESIDUALS)
