"""Force analysis of the impact mass: reaction of the stop, and what an impact takes at a stop of finite stiffness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mech_twin.machines.impact_mass.contact_estimate import ContactEstimate, contact_estimate
from mech_twin.machines.impact_mass.memory import MassMemory
from mech_twin.machines.impact_mass.states import IMPACT, KIND_NAMES, STUCK
from mech_twin.samples import Event, ForceSample, LinkageSample, Named, Wrench

IMPACT_NAME = KIND_NAMES[int(IMPACT)]
NO_CONTACT = ContactEstimate(0.0, 0.0, 0.0, 0.0)


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
    peak_contact_force_n: float
    contact_time_s: float
    contact_loss_j: float


@dataclass(frozen=True)
class StopReaction:
    """The force analysis: the stop's impulse in the step, its force on a resting mass, its mean over a period.

    The stop can only push back, along -x.  Over a periodic motion its mean force equals the mean force of the
    generator, since the momentum of the mass comes back.  With a contact stiffness the quantities hold peak force,
    contact time and loss of the hardest impact of the step; 0 without an impact, or at a rigid stop.  Mass and
    restitution are those of the step, from the memory: a live change does not reach back.
    """

    times_s: tuple[float, float]
    step_s: float
    contact_stiffness_n_per_m: float | None = None
    pins: tuple[str, ...] = ("stop",)
    acts_on: tuple[str, ...] = ("mass",)
    residual_limits: Mapping[str, float] = field(default_factory=dict)

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return the stop's reaction on the mass, its impulse in this step and its mean over the last full period."""
        memory = MassMemory.unpacked(linkage.memory.values)
        (force,) = linkage.effort
        reaction = max(force, 0.0) if memory.mode_1 == STUCK else 0.0
        last_impulse_ns = memory.last_period_impulse_m_per_s * memory.mass_kg
        period_s, _ = self.times_s
        contact = self._hardest_contact(linkage.events, memory)
        values = StopQuantities(
            stop_impulse_ns=memory.step_impulse_m_per_s * memory.mass_kg,
            stop_force_n=reaction,
            drive_force_n=force,
            last_period_impulse_ns=last_impulse_ns,
            last_period_mean_force_n=last_impulse_ns / period_s,
            last_period_impacts_1=memory.last_period_impacts_1,
            period_1=memory.anchor_period_1,
            drive_work_j=memory.step_drive_work_j,
            stop_loss_j=memory.step_stop_loss_j,
            change_work_j=memory.step_change_work_j,
            change_momentum_ns=memory.step_change_momentum_ns,
            peak_contact_force_n=contact.peak_force_n,
            contact_time_s=contact.contact_time_s,
            contact_loss_j=contact.loss_j,
        )
        quantities = Named(StopQuantities._fields, tuple(values))
        wrench = Wrench(-reaction if reaction else 0.0, 0.0, 0.0)
        return ForceSample(linkage.step, linkage.time_s, self.pins, (wrench,), quantities, 0.0, Named())

    def _hardest_contact(self, events: tuple[Event, ...], memory: MassMemory) -> ContactEstimate:
        """Return the contact of the fastest impact among the events."""
        impacts = [event for event in events if event.kind == IMPACT_NAME]
        if self.contact_stiffness_n_per_m is None or not impacts:
            return NO_CONTACT
        hardest = max(impacts, key=lambda event: event.pre_velocity_m_per_s)
        period_s, phase1_s = self.times_s
        tau_s = hardest.time_s - memory.origin_step_1 * self.step_s - hardest.period * period_s
        in_phase1 = tau_s <= phase1_s
        acting = memory.phase1_acceleration_m_per_s2 if in_phase1 else memory.phase2_acceleration_m_per_s2
        mass_kg, speed = memory.mass_kg, hardest.pre_velocity_m_per_s
        return contact_estimate(mass_kg, speed, memory.restitution_1, self.contact_stiffness_n_per_m, acting * mass_kg)
