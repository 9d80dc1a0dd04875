"""Roles of the impact mass: force generator (motor) and mass (linkage); the force analysis is in `forces`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mech_twin.machines.impact_mass.balance import BalanceResiduals
from mech_twin.machines.impact_mass.dynamics import ImpactSystem, MotionEvent, impact_system, initial_motion
from mech_twin.machines.impact_mass.memory import MassMemory, StepEnergies, packed
from mech_twin.machines.impact_mass.states import (
    FREE_REGIME,
    KIND_CONTACTS,
    KIND_NAMES,
    PHASE_1,
    REGIME_NAMES,
    STUCK,
    STUCK_REGIME,
)
from mech_twin.machines.impact_mass.step import RunningCounts, mass_step, reanchored
from mech_twin.parts.supply import limited_command
from mech_twin.samples import BodySample, Event, LinkageSample, MotorSample, Named

RESIDUAL_LIMITS = dict.fromkeys(BalanceResiduals._fields, 1e-9)


class GeneratorEfforts(NamedTuple):
    """Efforts of the generator's joints, N: the force now, and the level of each phase."""

    now_n: float
    phase1_n: float
    phase2_n: float


@dataclass(frozen=True)
class ForceGenerator:
    """The motor role: force now, and both levels in force, all times the supply command.

    The mass obeys these levels; so the forces reach it through the sample (or the topic) alone.
    """

    phase1_force_n: float
    phase2_force_n: float
    rate_per_s: float
    step_s: float
    joints: tuple[str, ...] = ("generator", "phase_1_level", "phase_2_level")

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        """Return the force on the mass now and the levels of both phases (`GeneratorEfforts`), in N."""
        command = limited_command(linkage.command, target, self.rate_per_s, self.step_s)
        phase = MassMemory.unpacked(linkage.memory.values).phase_1
        level1, level2 = command * self.phase1_force_n, command * self.phase2_force_n
        efforts = GeneratorEfforts(level1 if phase == PHASE_1 else level2, level1, level2)
        (position,), (velocity,) = linkage.position, linkage.velocity
        return MotorSample(
            linkage.step,
            linkage.time_s,
            self.joints,
            (position, 0.0, 0.0),
            (velocity, 0.0, 0.0),
            tuple(efforts),
            command,
        )


@dataclass(frozen=True)
class MassOnStop:
    """The linkage role: the mass between its exact events."""

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
        """Return what acts on the mass under these force levels."""
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

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the mass one coupling step later, with every event in between at its own time."""
        memory = MassMemory.unpacked(linkage.memory.values)
        efforts = GeneratorEfforts(*motor.effort)
        system = self.system((efforts.phase1_n, efforts.phase2_n))
        motion, steps = memory.motion, float(linkage.step) - memory.origin_step_1
        before = memory.acted(system)
        if before != system:
            motion = reanchored(motion, before, system, steps, self.step_s)
        counts = memory.counts.rescaled(memory.mass_kg / self.mass_kg)
        done = mass_step(motion, system, counts, steps + 1.0, self.step_s)
        (begin_velocity,) = linkage.velocity
        added_kg = self.mass_kg - memory.mass_kg
        energies = StepEnergies(
            done.balance.drive_work_m2_per_s2 * self.mass_kg,
            done.balance.stop_loss_m2_per_s2 * self.mass_kg,
            0.5 * added_kg * begin_velocity**2,
            added_kg * begin_velocity if added_kg else 0.0,
        )
        after = packed(done.motion, done.counts, system, memory.origin_step_1, self.mass_kg, energies)
        step = linkage.step + 1
        time_s = step * self.step_s
        origin_s = memory.origin_step_1 * self.step_s
        return LinkageSample(
            step,
            time_s,
            self.joints,
            (self.stop_m - done.gap_m,),
            (done.velocity_m_per_s,),
            (efforts.phase1_n if done.motion.phase == PHASE_1 else efforts.phase2_n,),
            done.regime,
            motor.command,
            Named(MassMemory._fields, tuple(after)),
            Named(BalanceResiduals._fields, tuple(done.residuals)),
            tuple(self._event(MotionEvent(*row), origin_s, time_s) for row in done.rows.tolist()),
        )

    def _event(self, event: MotionEvent, origin_s: float, latest_s: float) -> Event:
        return Event(
            min(origin_s + (event.period * self.times_s[0] + event.tau_s), latest_s),
            KIND_NAMES[int(event.kind)],
            KIND_CONTACTS[int(event.kind)],
            event.pre_m_per_s,
            event.post_m_per_s,
            event.impulse_per_mass * self.mass_kg,
            int(event.period),
        )
