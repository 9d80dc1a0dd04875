"""Force analysis of the impact mass: reaction of the stop, and what an impact takes at a stop of finite stiffness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mech_twin.machines.impact_mass.memory import MassMemory
from mech_twin.machines.impact_mass.states import STUCK
from mech_twin.samples import ForceSample, LinkageSample, Named, Wrench


class StopQuantities(NamedTuple):
    """Quantities of a step: impulse and force of the stop, force of the generator, the last full period, energies."""

    stop_impulse_ns: float
    stop_force_n: float
    drive_force_n: float
    last_period_impulse_ns: float
    last_period_mean_force_n: float
    last_period_impacts_1: float
    period_1: float
    drive_work_j: float
    stop_loss_j: float
    change_work_j: float
    change_momentum_ns: float


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
        memory = MassMemory.unpacked(linkage.memory.values)
        (force,) = linkage.effort
        reaction = max(force, 0.0) if memory.mode_1 == STUCK else 0.0
        last_impulse_ns = memory.last_period_impulse_m_per_s * self.mass_kg
        values = StopQuantities(
            stop_impulse_ns=memory.step_impulse_m_per_s * self.mass_kg,
            stop_force_n=reaction,
            drive_force_n=force,
            last_period_impulse_ns=last_impulse_ns,
            last_period_mean_force_n=last_impulse_ns / self.period_s,
            last_period_impacts_1=memory.last_period_impacts_1,
            period_1=memory.anchor_period_1,
            drive_work_j=memory.step_drive_work_j,
            stop_loss_j=memory.step_stop_loss_j,
            change_work_j=memory.step_change_work_j,
            change_momentum_ns=memory.step_change_momentum_ns,
        )
        quantities = Named(StopQuantities._fields, tuple(values))
        wrench = Wrench(-reaction if reaction else 0.0, 0.0, 0.0)
        return ForceSample(linkage.step, linkage.time_s, self.pins, (wrench,), quantities, 0.0, Named())
