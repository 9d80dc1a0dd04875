# SPDX-License-Identifier: Apache-2.0
"""What the impact mass remembers from step to step, by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mech_twin.machines.impact_mass.dynamics import ImpactSystem, MassMotion
from mech_twin.machines.impact_mass.step import RunningCounts

UNPACKED_MOTION = len(MassMotion._fields)
UNPACKED_COUNTS = UNPACKED_MOTION + len(RunningCounts._fields)


class MassMemory(NamedTuple):
    """State of the mass that is no joint: anchor of the motion, running counts, what acted, energies of the step.

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
    """Of one coupling step: work of the force, loss at the stop, energy and momentum that a change of mass brought."""

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
