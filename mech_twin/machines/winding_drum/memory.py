# SPDX-License-Identifier: Apache-2.0
"""The numbers of the drum's linkage row by name: its motion, its memory, its residuals."""

from __future__ import annotations

from typing import Any, NamedTuple

from mech_twin.engine.records import record_at, record_of
from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import borrowing_kernel


class DrumMotion(NamedTuple):
    """First numbers of the row: regime, command of the motor; position, rate, effort of each joint.

    The joints are the drum, the yarn that has run, and the radius of the package.
    """

    regime: float
    command: float
    drum_rad: float
    drum_rad_per_s: float
    drum_nm: float
    yarn_m: float
    yarn_m_per_s: float
    yarn_n: float
    radius_m: float
    radius_m_per_s: float
    radius_n: float


class DrumMemory(NamedTuple):
    """State of the linkage besides its joints."""

    yarn_acceleration_m_per_s2: float
    drive_work_j: float
    gravity_work_j: float
    friction_loss_j: float
    initial_energy_j: float
    largest_energy_j: float


class DrumResiduals(NamedTuple):
    """Residuals, zero but for rounding: area of the layers against the yarn, energy balance."""

    area_balance: float
    energy_balance: float


MOTION, MEMORY, RESIDUALS = record_of(DrumMotion), record_of(DrumMemory), record_of(DrumResiduals)
MEMORY_AT = len(DrumMotion._fields)
RESIDUALS_AT = MEMORY_AT + len(DrumMemory._fields)


@borrowing_kernel
def motion_of(row: Array) -> Any:
    """Return the first numbers of a linkage row as a record that shares them."""
    return record_at(row, 0, MOTION)


@borrowing_kernel
def memory_of(row: Array) -> Any:
    """Return the memory of a linkage row as a record that shares its numbers."""
    return record_at(row, MEMORY_AT, MEMORY)


@borrowing_kernel
def residuals_of(row: Array) -> Any:
    """Return the residuals of a linkage row as a record that shares its numbers."""
    return record_at(row, RESIDUALS_AT, RESIDUALS)
