# SPDX-License-Identifier: Apache-2.0
"""The impact mass as rows of numbers: its generator and a coupling step of its motion, as kernels."""

from __future__ import annotations

from typing import Any, NamedTuple

from mech_twin.engine.compiled_steps import linkage_step, motor_step, step_of
from mech_twin.engine.sample_vectors import COMMAND, LINKAGE_JOINTS, MOTOR_COMMAND, MOTOR_JOINTS, REGIME, Array
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.impact_mass.dynamics import ImpactSystem
from mech_twin.machines.impact_mass.memory import (
    RESIDUALS_AT,
    counts_of,
    fill_memory,
    fill_motion,
    memory_of,
    motion_of,
)
from mech_twin.machines.impact_mass.states import PHASE_1
from mech_twin.machines.impact_mass.step import Span, mass_step, reanchored, rescaled
from mech_twin.parts.supply import limited_command


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
    motion = reanchored(motion_of(memory), before, before, step - memory.origin_step_1, model.step_s)
    fill_motion(motion, memory)


@step_of(linkage_step, StoppedMass)
def mass_on_stop(
    model: StoppedMass, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill ``out`` with the mass one coupling step later, and log every event in between at its own time."""
    memory, levels = memory_of(linkage), (motor[MOTOR_JOINTS + 5], motor[MOTOR_JOINTS + 8])
    system = under_levels(model, levels[0], levels[1])
    steps, before = step - memory.origin_step_1, acted_before(system, memory)
    motion = motion_of(memory)
    if before != system:
        motion = reanchored(motion, before, system, steps, model.step_s)
    counts = rescaled(counts_of(memory), memory.mass_kg / model.mass_kg)
    origin_s, latest_s = memory.origin_step_1 * model.step_s, (step + 1) * model.step_s
    span = Span(origin_s, steps + 1.0, model.step_s, latest_s, model.mass_kg)
    done = mass_step(motion, system, counts, span, log)
    velocity, added_kg = linkage[LINKAGE_JOINTS + 1], model.mass_kg - memory.mass_kg
    after = memory_of(out)
    fill_memory(done.motion, done.counts, system, after)
    after.origin_step_1, after.mass_kg = memory.origin_step_1, model.mass_kg
    after.step_drive_work_j = done.balance.drive_work_m2_per_s2 * model.mass_kg
    after.step_stop_loss_j = done.balance.stop_loss_m2_per_s2 * model.mass_kg
    after.step_change_work_j = 0.5 * added_kg * (velocity * velocity)
    after.step_change_momentum_ns = added_kg * velocity if added_kg != 0.0 else 0.0
    out[REGIME], out[COMMAND] = done.regime, motor[MOTOR_COMMAND]
    out[LINKAGE_JOINTS], out[LINKAGE_JOINTS + 1] = model.stop_m - done.gap_m, done.velocity_m_per_s
    out[LINKAGE_JOINTS + 2] = levels[0] if done.motion.phase == PHASE_1 else levels[1]
    out[RESIDUALS_AT], out[RESIDUALS_AT + 1] = done.residuals.momentum_balance, done.residuals.energy_balance
    return done.log, done.found
