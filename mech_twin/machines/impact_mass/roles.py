# SPDX-License-Identifier: Apache-2.0
"""Roles of the impact mass: force generator (motor) and mass (linkage); the force analysis is in `forces`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from mech_twin.engine.compiled_roles import CompiledLinkage, CompiledMotor
from mech_twin.engine.sample_vectors import EventLayout, LinkageLayout, MotorLayout
from mech_twin.machines.impact_mass.balance import BalanceResiduals
from mech_twin.machines.impact_mass.dynamics import ImpactSystem, impact_system, initial_motion
from mech_twin.machines.impact_mass.mass_row import Generator, StoppedMass
from mech_twin.machines.impact_mass.memory import MassMemory, StepEnergies, packed
from mech_twin.machines.impact_mass.states import FREE_REGIME, KIND_NAMES, REGIME_NAMES, STUCK, STUCK_REGIME
from mech_twin.machines.impact_mass.step import CONTACTS, RunningCounts
from mech_twin.samples import LinkageSample, Named

RESIDUAL_LIMITS = dict.fromkeys(BalanceResiduals._fields, 1e-9)


@dataclass(frozen=True)
class ForceGenerator(CompiledMotor):
    """The motor role: the present force and both levels, all times the supply command.

    The mass uses these levels, so the forces reach it only through the sample (or the topic).
    """

    phase1_force_n: float
    phase2_force_n: float
    rate_per_s: float
    step_s: float
    joints: tuple[str, ...] = ("generator", "phase_1_level", "phase_2_level")

    @property
    def effort_limit(self) -> float:
        """Largest force that can be commanded (N): the larger level."""
        return float(max(abs(self.phase1_force_n), abs(self.phase2_force_n)))

    @cached_property
    def model(self) -> Generator:
        """Constants of the kernel."""
        return Generator(*map(float, (self.phase1_force_n, self.phase2_force_n, self.rate_per_s, self.step_s)))

    @cached_property
    def layout(self) -> MotorLayout:
        """Row of the samples."""
        return MotorLayout(self.joints)


@dataclass(frozen=True)
class MassOnStop(CompiledLinkage):
    """The linkage role: the mass, simulated exactly from event to event."""

    mass_kg: float
    stop_m: float
    restitution: float
    chatter_cutoff: float
    times_s: tuple[float, float]
    step_s: float
    start_levels_n: tuple[float, float]
    start_fraction: float
    start_position_m: float
    start_velocity_m_per_s: float
    joints: tuple[str, ...] = ("mass",)
    coordinates: tuple[str, ...] = ("mass",)
    regimes: tuple[str, ...] = REGIME_NAMES
    residual_limits: Mapping[str, float] = field(default_factory=lambda: RESIDUAL_LIMITS)

    def system(self, levels_n: tuple[float, float]) -> ImpactSystem:
        """Return the constants of the motion under these force levels (N)."""
        level1, level2 = levels_n
        accelerations = (level1 / self.mass_kg, level2 / self.mass_kg)
        return impact_system(self.times_s, accelerations, self.restitution, self.chatter_cutoff)

    def start(self, step: int = 0) -> LinkageSample:
        """Return the mass in its configured state, the force at the start of its first phase."""
        level1, level2 = self.start_levels_n
        levels = (self.start_fraction * level1, self.start_fraction * level2)
        system = self.system(levels)
        motion = initial_motion(self.stop_m - self.start_position_m, self.start_velocity_m_per_s, system)
        counts = RunningCounts(*(0.0,) * len(RunningCounts._fields))
        memory = packed(motion, counts, system, float(step), self.mass_kg, StepEnergies(0.0, 0.0, 0.0, 0.0))
        return LinkageSample(
            step,
            step * self.step_s,
            self.joints,
            (self.start_position_m,),
            (self.start_velocity_m_per_s,),
            (levels[0],),
            STUCK_REGIME if motion.mode == STUCK else FREE_REGIME,
            self.start_fraction,
            Named(MassMemory._fields, tuple(memory)),
            Named(BalanceResiduals._fields, tuple(BalanceResiduals(0.0, 0.0))),
        )

    @cached_property
    def model(self) -> StoppedMass:
        """Constants of the kernel."""
        return StoppedMass(self.system((0.0, 0.0)), float(self.mass_kg), float(self.stop_m), float(self.step_s))

    @cached_property
    def layout(self) -> LinkageLayout:
        """Row of the samples."""
        events = EventLayout(KIND_NAMES, CONTACTS)
        return LinkageLayout(self.joints, MassMemory._fields, BalanceResiduals._fields, events)
