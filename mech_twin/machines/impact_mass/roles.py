# SPDX-License-Identifier: Apache-2.0
"""Roles of the impact mass: force generator (motor) and mass (linkage); the force analysis is in `forces`."""

from dataclasses import dataclass
from typing import NamedTuple

from mech_twin.engine.compiled_roles import CompiledLinkage, EffortStepMotor
from mech_twin.engine.compiled_steps import motor_step, step_of
from mech_twin.engine.sample_vectors import (
    COMMAND,
    LINKAGE_JOINTS,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    Array,
    EventLayout,
    LinkageLayout,
)
from mech_twin.machines.impact_mass.dynamics import (
    FREE_REGIME,
    KIND_NAMES,
    PHASE_1,
    REGIME_NAMES,
    STUCK,
    STUCK_REGIME,
    initial_motion,
)
from mech_twin.machines.impact_mass.step import CONTACTS, BalanceResiduals, MassMemory, StoppedMass, memory_of
from mech_twin.parts.induction_motor import limited_command
from mech_twin.samples import LinkageSample

RESIDUAL_LIMITS = dict.fromkeys(BalanceResiduals._fields, 1e-9)


class Generator(NamedTuple):
    """Constants of the motor role: forces of both phases at full command (N), rate (1/s), coupling step (s)."""

    phase1_force_n: float
    phase2_force_n: float
    rate_per_s: float
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
        memory = MassMemory(*motion)._replace(
            phase1_acceleration_m_per_s2=first,
            phase2_acceleration_m_per_s2=second,
            restitution_1=system.restitution,
            origin_step_1=float(step),
            mass_kg=mass_kg,
        )
        regime = STUCK_REGIME if motion.mode == STUCK else FREE_REGIME
        joint = self.start_position_m, self.start_velocity_m_per_s, levels[0]
        row = (regime, self.start_fraction, *joint, *memory, *BalanceResiduals(0.0, 0.0))
        return self.layout.sample(step, step * self.step_s, row, ())
