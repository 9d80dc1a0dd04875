# SPDX-License-Identifier: Apache-2.0
"""Roles of the impact mass: force generator (motor) and mass (linkage); the force analysis is in `forces`.

Their kernels work on rows of numbers, whose memory from step to step is named here.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

from mech_twin.engine.addresses import record_at, record_of
from mech_twin.engine.compiled_roles import CompiledLinkage, EffortStepMotor
from mech_twin.engine.compiled_steps import LOG_FULL, Work, linkage_step, motor_step, step_of
from mech_twin.engine.sample_vectors import (
    COMMAND,
    LINKAGE_JOINTS,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    REGIME,
    Array,
    EventLayout,
    LinkageLayout,
)
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.impact_mass.dynamics import (
    FREE_REGIME,
    KIND_NAMES,
    PHASE_1,
    REGIME_NAMES,
    STUCK,
    STUCK_REGIME,
    ImpactSystem,
    MassMotion,
    initial_motion,
)
from mech_twin.machines.impact_mass.step import (
    CONTACTS,
    BalanceResiduals,
    RunningCounts,
    Span,
    mass_step,
    reanchored,
    rescaled,
)
from mech_twin.parts.induction_motor import limited_command
from mech_twin.samples import LinkageSample, Named

RESIDUAL_LIMITS = dict.fromkeys(BalanceResiduals._fields, 1e-9)


class MassMemory(NamedTuple):
    """State of the mass besides its joint: last event, running counts, constants of the motion, energies of the step.

    The first nine fields are `MassMotion`, the next seven `RunningCounts`; phase and mode are named in `dynamics`.
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
    step_drive_work_j: float = 0.0
    step_stop_loss_j: float = 0.0
    step_change_work_j: float = 0.0
    step_change_momentum_ns: float = 0.0


MEMORY = record_of(MassMemory)
MEMORY_AT = LINKAGE_JOINTS + 3
COUNTS_AT = MEMORY_AT + len(MassMotion._fields)
ACTING_AT = COUNTS_AT + len(RunningCounts._fields)
RESIDUALS_AT = MEMORY_AT + len(MassMemory._fields)


@borrowing_kernel
def memory_of(row: Array) -> Any:
    """Return the memory of a linkage row as a record that shares its numbers."""
    return record_at(row, MEMORY_AT, MEMORY)


@kernel
def motion_of(row: Array) -> MassMotion:
    """Return the motion from its last event on: the first numbers of the memory."""
    m = row[MEMORY_AT:]
    return MassMotion(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8])


@kernel
def counts_of(row: Array) -> RunningCounts:
    """Return the running counts: the numbers of the memory after the motion."""
    c = row[COUNTS_AT:]
    return RunningCounts(c[0], c[1], c[2], c[3], c[4], c[5], c[6])


@kernel
def fill(numbers: tuple[float, ...], row: Array, place: int) -> None:
    """Write numbers into a row, from a place on."""
    for i in range(len(numbers)):
        row[place + i] = numbers[i]


class Generator(NamedTuple):
    """Constants of the motor role: forces of both phases at full command (N), rate (1/s), coupling step (s)."""

    phase1_force_n: float
    phase2_force_n: float
    rate_per_s: float
    step_s: float


class StoppedMass(NamedTuple):
    """Constants of the linkage role; ``system`` under no force."""

    system: ImpactSystem
    mass_kg: float
    stop_m: float
    step_s: float


@step_of(motor_step, Generator)
def generator_force(model: Generator, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` with the present force on the mass, and the levels of both phases (N)."""
    command = limited_command(linkage[COMMAND], target, model.rate_per_s, model.step_s)
    level1, level2 = command * model.phase1_force_n, command * model.phase2_force_n
    out[:] = 0.0
    out[MOTOR_COMMAND] = command
    out[MOTOR_JOINTS], out[MOTOR_JOINTS + 1] = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1]
    out[MOTOR_JOINTS + 2] = level1 if memory_of(linkage).phase_1 == PHASE_1 else level2
    out[MOTOR_JOINTS + 5], out[MOTOR_JOINTS + 8] = level1, level2


@kernel
def under_levels(model: StoppedMass, level1_n: float, level2_n: float) -> ImpactSystem:
    """Return the constants of the motion under these forces of both phases (N)."""
    s = model.system
    first, second = level1_n / model.mass_kg, level2_n / model.mass_kg
    return ImpactSystem(s.period_s, s.phase1_s, first, second, s.restitution, s.listed, s.exact)


@kernel
def acted_before(now: ImpactSystem, memory: Any) -> ImpactSystem:
    """Return the constants of the motion in the step before; ``now`` gives times and the rule of series."""
    return ImpactSystem(
        now.period_s,
        now.phase1_s,
        memory.phase1_acceleration_m_per_s2,
        memory.phase2_acceleration_m_per_s2,
        memory.restitution_1,
        now.listed,
        now.exact,
    )


@kernel
def anchor_at(model: StoppedMass, linkage: Array, step: int) -> None:
    """Rewrite the motion in a linkage row as starting at this step instead of at its last event; it stays the same."""
    memory = memory_of(linkage)
    before = acted_before(model.system, memory)
    motion = reanchored(motion_of(linkage), before, before, step - memory.origin_step_1, model.step_s)
    fill(motion, linkage, MEMORY_AT)


@step_of(linkage_step, StoppedMass)
def mass_on_stop(
    model: StoppedMass, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> int:
    """Fill ``out`` with the mass one coupling step later, and log every event in between at its own time."""
    memory, levels = memory_of(linkage), (motor[MOTOR_JOINTS + 5], motor[MOTOR_JOINTS + 8])
    system = under_levels(model, levels[0], levels[1])
    steps, before = step - memory.origin_step_1, acted_before(system, memory)
    motion = motion_of(linkage)
    if before != system:
        motion = reanchored(motion, before, system, steps, model.step_s)
    counts = rescaled(counts_of(linkage), memory.mass_kg / model.mass_kg)
    origin_s, latest_s = memory.origin_step_1 * model.step_s, (step + 1) * model.step_s
    span = Span(origin_s, steps + 1.0, model.step_s, latest_s, model.mass_kg)
    done = mass_step(motion, system, counts, span, log)
    velocity, added_kg = linkage[LINKAGE_JOINTS + 1], model.mass_kg - memory.mass_kg
    after = memory_of(out)
    fill(done.motion, out, MEMORY_AT)
    fill(done.counts, out, COUNTS_AT)
    fill((system.acceleration1, system.acceleration2, system.restitution), out, ACTING_AT)
    after.origin_step_1, after.mass_kg = memory.origin_step_1, model.mass_kg
    after.step_drive_work_j = done.balance.drive_work_m2_per_s2 * model.mass_kg
    after.step_stop_loss_j = done.balance.stop_loss_m2_per_s2 * model.mass_kg
    after.step_change_work_j = 0.5 * added_kg * (velocity * velocity)
    after.step_change_momentum_ns = added_kg * velocity if added_kg != 0.0 else 0.0
    out[REGIME], out[COMMAND] = done.regime, motor[MOTOR_COMMAND]
    out[LINKAGE_JOINTS], out[LINKAGE_JOINTS + 1] = model.stop_m - done.gap_m, done.velocity_m_per_s
    out[LINKAGE_JOINTS + 2] = levels[0] if done.motion.phase == PHASE_1 else levels[1]
    out[RESIDUALS_AT], out[RESIDUALS_AT + 1] = done.residuals.momentum_balance, done.residuals.energy_balance
    return done.found if done.found <= len(log) else LOG_FULL


def force_generator(model: Generator) -> EffortStepMotor:
    """Return the motor role: the present force and both levels, all times the supply command.

    The mass uses these levels, so the forces reach it only through the sample (or the topic).
    """
    largest = max(abs(model.phase1_force_n), abs(model.phase2_force_n))
    return EffortStepMotor(model, ("generator", "phase_1_level", "phase_2_level"), largest)


@dataclass(frozen=True)
class MassOnStop(CompiledLinkage):
    """The linkage role: the mass, simulated exactly from event to event."""

    model: StoppedMass
    step_s: float
    start_levels_n: tuple[float, float]
    start_fraction: float
    start_position_m: float
    start_velocity_m_per_s: float
    joints = ("mass",)
    coordinates = ("mass",)
    regimes = REGIME_NAMES
    residual_limits = RESIDUAL_LIMITS
    layout = LinkageLayout(("mass",), MassMemory._fields, BalanceResiduals._fields, EventLayout(KIND_NAMES, CONTACTS))

    def start(self, step: int = 0) -> LinkageSample:
        """Return the mass in its configured state, the force at the start of its first phase."""
        levels, mass_kg = [self.start_fraction * level for level in self.start_levels_n], self.model.mass_kg
        first, second = (level / mass_kg for level in levels)
        system = self.model.system._replace(acceleration1=first, acceleration2=second)
        motion = initial_motion(self.model.stop_m - self.start_position_m, self.start_velocity_m_per_s, system)
        counts = RunningCounts(*(0.0,) * len(RunningCounts._fields))
        acting = (system.acceleration1, system.acceleration2, system.restitution)
        memory = MassMemory(*motion, *counts, *acting, float(step), mass_kg)
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
