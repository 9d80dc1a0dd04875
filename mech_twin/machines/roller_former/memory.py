# SPDX-License-Identifier: Apache-2.0
"""The numbers of the roller former's linkage row by name: joints of the shaft, and its state that is no joint.

That are modes, works, and the energy balance they make.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from mech_twin.engine.records import record_of
from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import kernel


class ShaftMotion(NamedTuple):
    """What the row begins with: regime, command of the motor; angle, rate, effort of drive, crank and twist.

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
    """State that is no joint.

    Works are those since the start; ``stored_energy_j`` is the energy at the sample; ``change_work_j`` what parameters
    changed while running put in.  The balance error and the turnover (sum of the sizes of all works) begin anew with
    every turn of the crank, so that neither hours nor a large sum hide an error.
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
    """What must be zero but for rounding: energy, and the length of the rods."""

    energy_balance: float
    rod_length: float


SHAFT, MEMORY, RESIDUALS = record_of(ShaftMotion), record_of(FormerMemory), record_of(FormerResiduals)
CARTS_AT = len(ShaftMotion._fields)
MEMORY_SIZE = len(FormerMemory._fields)


@kernel
def shaft_of(row: Array) -> Any:
    """Return what a linkage row begins with, as a record that shares its numbers (see `engine.records`)."""
    return row[:CARTS_AT].view(SHAFT)[0]


@kernel
def memory_of(row: Array, carts: int) -> Any:
    """Return the memory of a linkage row with so many carts as a record that shares its numbers."""
    at = CARTS_AT + 6 * carts
    return row[at : at + MEMORY_SIZE].view(MEMORY)[0]


@kernel
def residuals_of(row: Array, carts: int) -> Any:
    """Return the residuals of a linkage row with so many carts as a record that shares its numbers."""
    return row[CARTS_AT + 6 * carts + MEMORY_SIZE :].view(RESIDUALS)[0]
