"""Roles of the impact mass: generator (motor), mass (linkage) and reaction of the stop (force analysis)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mech_twin.machines.impact_mass.events import (
    CHATTER_END,
    IMPACT,
    KINDS,
    STUCK,
    Drive,
    Motion,
    drive,
    initial_motion,
)
from mech_twin.machines.impact_mass.step import Count, replanted, window
from mech_twin.parts.supply import limited_command
from mech_twin.samples import BodySample, Event, ForceSample, LinkageSample, MotorSample, Named, Wrench

REGIMES = ("free", "impact", "chatter", "stuck")
FREE_AT_START, STUCK_AT_START = 0, 3
CONTACTS = ("stop", "stop", "stop", "generator")  # of the event kinds, in their order
RESIDUALS = ("momentum_balance", "energy_balance")
RESIDUAL_LIMITS = {"momentum_balance": 1e-9, "energy_balance": 1e-9}
MEMORY = (
    "anchor_period_1",
    "anchor_tau_s",
    "phase_1",
    "anchor_gap_m",
    "anchor_velocity_m_per_s",
    "mode_1",
    "series_number_1",
    "series_speed_m_per_s",
    "series_tau_s",
    "impacts_1",
    "chatter_ends_1",
    "period_impacts_1",
    "last_period_impacts_1",
    "period_impulse_m_per_s",
    "last_period_impulse_m_per_s",
    "step_impulse_m_per_s",
    "phase1_acceleration_m_per_s2",
    "phase2_acceleration_m_per_s2",
    "restitution_1",
    "origin_step_1",
)
MOTION, COUNT = slice(0, 9), slice(9, 16)
PHASE_AT, MODE_AT, ORIGIN_AT = MEMORY.index("phase_1"), MEMORY.index("mode_1"), MEMORY.index("origin_step_1")
ACTING_AT = MEMORY.index("phase1_acceleration_m_per_s2")
QUANTITIES = (
    "stop_impulse_ns",
    "stop_force_n",
    "drive_force_n",
    "last_period_impulse_ns",
    "last_period_mean_force_n",
    "last_period_impacts_1",
    "period_1",
)


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
        """Return the force on the mass now (effort 0) and the levels of both phases (efforts 1, 2), in N."""
        command = limited_command(linkage.command, target, self.rate_per_s, self.step_s)
        level1, level2 = command * self.phase1_force_n, command * self.phase2_force_n
        now = level1 if linkage.memory.values[PHASE_AT] == 0.0 else level2
        position, velocity = (linkage.position[0], 0.0, 0.0), (linkage.velocity[0], 0.0, 0.0)
        return MotorSample(
            linkage.step, linkage.time_s, self.joints, position, velocity, (now, level1, level2), command
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
    regimes: tuple[str, ...] = REGIMES
    residual_limits: Mapping[str, float] = field(default_factory=lambda: RESIDUAL_LIMITS)

    def acting(self, levels_n: tuple[float, float]) -> Drive:
        """Return what acts on the mass under these force levels."""
        accelerations = (levels_n[0] / self.mass_kg, levels_n[1] / self.mass_kg)
        return drive(self.times_s, accelerations, self.restitution, self.chatter_cutoff)

    def start(self, step: int = 0) -> LinkageSample:
        """Return the mass in its configured state, the force at the start of its first phase."""
        levels = (self.start_fraction * self.start_levels_n[0], self.start_fraction * self.start_levels_n[1])
        acting = self.acting(levels)
        motion = initial_motion(self.stop_m - self.start_position_m, self.start_velocity_m_per_s, acting)
        memory = (*motion, *Count(*(0.0,) * 7), acting[2], acting[3], acting[4], float(step))
        regime = STUCK_AT_START if motion.mode == STUCK else FREE_AT_START
        return LinkageSample(
            step,
            step * self.step_s,
            self.joints,
            (self.start_position_m,),
            (self.start_velocity_m_per_s,),
            (levels[0],),
            regime,
            self.start_fraction,
            Named(MEMORY, memory),
            Named(RESIDUALS, (0.0, 0.0)),
        )

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the mass one coupling step later, with every event in between at its own time."""
        memory = linkage.memory.values
        motion, count = Motion(*memory[MOTION]), Count(*memory[COUNT])
        acting = self.acting((motor.effort[1], motor.effort[2]))
        steps = float(linkage.step) - memory[ORIGIN_AT]
        if acting[2:5] != memory[ACTING_AT : ACTING_AT + 3]:
            first, second, restitution = memory[ACTING_AT : ACTING_AT + 3]
            before = Drive(*self.times_s, first, second, restitution, acting.listed, acting.exact)
            motion = replanted(motion, before, acting, steps, self.step_s)
        motion, count, residual, (gap, velocity), regime, rows = window(motion, acting, count, steps + 1.0, self.step_s)
        step = linkage.step + 1
        origin_s = memory[ORIGIN_AT] * self.step_s
        return LinkageSample(
            step,
            step * self.step_s,
            self.joints,
            (self.stop_m - gap,),
            (velocity,),
            (motor.effort[1] if motion.phase == 0.0 else motor.effort[2],),
            regime,
            motor.command,
            Named(MEMORY, (*motion, *count, acting[2], acting[3], acting[4], memory[ORIGIN_AT])),
            Named(RESIDUALS, residual),
            tuple(self._event(row, origin_s) for row in rows.tolist()) if len(rows) else (),
        )

    def _event(self, row: list[float], origin_s: float) -> Event:
        kind, period, tau, pre, post, impulse = row
        return Event(
            origin_s + (period * self.times_s[0] + tau),
            KINDS[int(kind)],
            CONTACTS[int(kind)],
            pre,
            post,
            impulse * self.mass_kg if kind in (IMPACT, CHATTER_END) else 0.0,
            int(period),
        )


@dataclass(frozen=True)
class StopReaction:
    """The force analysis: the stop's impulse in the step, its force on a resting mass, its mean over a period.

    The stop can only push back, along -x.  Over a periodic motion its mean force equals the mean force of the
    generator, since the momentum of the mass comes back.
    """

    mass_kg: float
    period_s: float
    pins: tuple[str, ...] = ("stop",)
    acts_on: tuple[str, ...] = ("mass",)
    residual_limits: Mapping[str, float] = field(default_factory=dict)

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return the stop's reaction on the mass, its impulse in this step and its mean over the last full period."""
        memory = linkage.memory.values
        stuck = memory[MODE_AT] == STUCK
        force = linkage.effort[0]
        reaction = max(force, 0.0) if stuck else 0.0
        count = Count(*memory[COUNT])
        last = count.last_period_impulse * self.mass_kg
        values = (
            count.step_impulse * self.mass_kg,
            reaction,
            force,
            last,
            last / self.period_s,
            count.last_period_impacts,
            memory[0],
        )
        wrench = Wrench(-reaction if reaction else 0.0, 0.0, 0.0)
        return ForceSample(linkage.step, linkage.time_s, self.pins, (wrench,), Named(QUANTITIES, values), 0.0, Named())
