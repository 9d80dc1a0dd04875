# SPDX-License-Identifier: Apache-2.0
"""Memory of the impact mass from step to step, by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from mech_twin.engine.records import record_at, record_of
from mech_twin.engine.sample_vectors import LINKAGE_JOINTS, Array
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.impact_mass.dynamics import ImpactSystem, MassMotion
from mech_twin.machines.impact_mass.step import RunningCounts


class MassMemory(NamedTuple):
    """State of the mass besides its joint: last event, running counts, constants of the motion, energies of the step.

    The first nine fields are `MassMotion`, the next seven `RunningCounts`; phase and mode are named in `states`.
    """

    anchor_period_1: float
    anchor_tau_s: float
    phase_1: float
    anchor_gap_m: float
    anchor_velocity_m_per_s: float
    mode_1: float
    series_number_1: float
    series_speed_m_per_s: float
    series_tau_s: float
    impacts_1: float
    chatter_ends_1: float
    period_impacts_1: float
    last_period_impacts_1: float
    period_impulse_m_per_s: float
    last_period_impulse_m_per_s: float
    step_impulse_m_per_s: float
    phase1_acceleration_m_per_s2: float
    phase2_acceleration_m_per_s2: float
    restitution_1: float
    origin_step_1: float
    mass_kg: float
    step_drive_work_j: float
    step_stop_loss_j: float
    step_change_work_j: float
    step_change_momentum_ns: float

    @classmethod
    def unpacked(cls, values: Sequence[float]) -> MassMemory:
        """Return the memory of a sample's values."""
        return cls(*values)


class StepEnergies(NamedTuple):
    """Of one coupling step: work of the force, loss at the stop, energy and momentum added by a change of mass."""

    drive_work_j: float
    stop_loss_j: float
    change_work_j: float
    change_momentum_ns: float


def packed(
    motion: MassMotion,
    counts: RunningCounts,
    system: ImpactSystem,
    origin_step: float,
    mass_kg: float,
    energies: StepEnergies,
) -> MassMemory:
    """Return the memory of a step."""
    acting = (system.acceleration1, system.acceleration2, system.restitution)
    return MassMemory(*motion, *counts, *acting, origin_step, mass_kg, *energies)


MEMORY = record_of(MassMemory)
MEMORY_AT = LINKAGE_JOINTS + 3
RESIDUALS_AT = MEMORY_AT + len(MassMemory._fields)


@borrowing_kernel
def memory_of(row: Array) -> Any:
    """Return the memory of a linkage row as a record that shares its numbers."""
    return record_at(row, MEMORY_AT, MEMORY)


@kernel
def motion_of(memory: Any) -> MassMotion:
    """Return the motion from its last event on."""
    return MassMotion(
        memory.anchor_period_1,
        memory.anchor_tau_s,
        memory.phase_1,
        memory.anchor_gap_m,
        memory.anchor_velocity_m_per_s,
        memory.mode_1,
        memory.series_number_1,
        memory.series_speed_m_per_s,
        memory.series_tau_s,
    )


@kernel
def counts_of(memory: Any) -> RunningCounts:
    """Return the running counts."""
    return RunningCounts(
        memory.impacts_1,
        memory.chatter_ends_1,
        memory.period_impacts_1,
        memory.last_period_impacts_1,
        memory.period_impulse_m_per_s,
        memory.last_period_impulse_m_per_s,
        memory.step_impulse_m_per_s,
    )


@kernel
def fill_motion(motion: MassMotion, memory: Any) -> None:
    """Write the motion into the memory; the rest is unchanged."""
    memory.anchor_period_1, memory.anchor_tau_s, memory.phase_1 = motion.period, motion.tau_s, motion.phase
    memory.anchor_gap_m, memory.anchor_velocity_m_per_s = motion.gap_m, motion.velocity_m_per_s
    memory.mode_1, memory.series_number_1 = motion.mode, motion.series_number
    memory.series_speed_m_per_s, memory.series_tau_s = motion.series_speed_m_per_s, motion.series_tau_s


@kernel
def fill_memory(motion: MassMotion, counts: RunningCounts, system: ImpactSystem, memory: Any) -> None:
    """Write motion, counts and constants into the memory; origin, mass and energies are unchanged."""
    fill_motion(motion, memory)
    memory.impacts_1, memory.chatter_ends_1 = counts.impacts, counts.chatter_ends
    memory.period_impacts_1, memory.last_period_impacts_1 = counts.period_impacts, counts.last_period_impacts
    memory.period_impulse_m_per_s = counts.period_impulse_m_per_s
    memory.last_period_impulse_m_per_s = counts.last_period_impulse_m_per_s
    memory.step_impulse_m_per_s = counts.step_impulse_m_per_s
    memory.phase1_acceleration_m_per_s2 = system.acceleration1
    memory.phase2_acceleration_m_per_s2 = system.acceleration2
    memory.restitution_1 = system.restitution
