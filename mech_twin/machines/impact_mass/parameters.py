# SPDX-License-Identifier: Apache-2.0
"""Parameters of the impact mass, and its generator of a periodic force with two levels.

::

      P |      P1
        |  +-------+                +-------+
        |  |       |                |       |
      --+--+-------+------------+---+-------+----> t
        |  0      t1            |   T      T + t1
        |          +------------+
        |                P2

Phase 1 lasts from nT to nT + t1, phase 2 from there to (n + 1)T; an instant of change belongs to the phase that ends.
The force is positive towards the stop.  The supply command multiplies both levels; 1 is nominal, 0 is off.

Source: manzhosov_novikov, eq. (2) and fig. 1.
"""

from typing import Self

from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, choice, quantity
from mech_twin.engine.coupling import Coupling
from mech_twin.machines.impact_mass.dynamics import ImpactSystem, MassMotion, impact_system, initial_motion
from mech_twin.machines.impact_mass.impact_stop import StopParameters
from mech_twin.machines.impact_mass.wave_stop import StopModel, rod_restitution
from mech_twin.parts.induction_motor import SupplyParameters

LEAST_SHARE = 1e-10  # of the period, of either phase: rounding of a shorter one is of its own size
MOST_PERIODS_PER_STEP = 100.0  # a step holds at most so many periods of the force, and so a bounded number of events


class GeneratorParameters(Parameters):
    """The two-level periodic force."""

    period_s: float = quantity("s", "period T of the force", gt=0)
    phase1_duration_s: float = quantity("s", "duration t1 of the first phase, 0 < t1 < T")
    phase1_force_n: float = quantity("N", "force P1 of the first phase, positive towards the stop", live=True)
    phase2_force_n: float = quantity("N", "force P2 of the second phase, positive towards the stop", live=True)

    @model_validator(mode="after")
    def _phases_in_order(self) -> Self:
        if not 0.0 < self.phase1_duration_s < self.period_s:
            raise ValueError(
                f"0 < phase1_duration_s < period_s does not hold: phase1_duration_s = {self.phase1_duration_s!r}, "
                f"period_s = {self.period_s!r}"
            )
        shortest = LEAST_SHARE * self.period_s
        if min(self.phase1_duration_s, self.period_s - self.phase1_duration_s) < shortest:
            raise ValueError(
                f"phase1_duration_s = {self.phase1_duration_s!r} leaves a phase shorter than {LEAST_SHARE:g} period_s "
                f"= {shortest!r} s"
            )
        return self


class ImpactMass(StopParameters, GeneratorParameters):
    """Parameters of the impact mass."""

    initial_position_m: float = quantity("m", "position x0 at the start, not beyond the stop")
    initial_velocity_m_per_s: float = quantity("m/s", "velocity v0 at the start, positive towards the stop")
    stop: StopModel = choice("rigid stop, or a rod", default=StopModel())
    supply: SupplyParameters = choice("supply of the generator: the fraction multiplies both force levels")
    coupling: Coupling = choice("coupling of the roles")

    @model_validator(mode="after")
    def _can_be_run(self) -> Self:
        if self.initial_position_m > self.stop_position_m:
            raise ValueError(
                "initial_position_m <= stop_position_m does not hold: "
                f"initial_position_m = {self.initial_position_m!r}, stop_position_m = {self.stop_position_m!r}"
            )
        if self.coupling.step_s > MOST_PERIODS_PER_STEP * self.period_s:
            raise ValueError(
                f"coupling.step_s <= {MOST_PERIODS_PER_STEP:g} period_s does not hold: "
                f"coupling.step_s = {self.coupling.step_s!r}, period_s = {self.period_s!r}"
            )
        if self.stop.model == "rigid":
            return self
        if self.contact_stiffness_n_per_m is not None:
            raise ValueError(
                "contact_stiffness_n_per_m must be left out with stop.model wave: stop.wave.face is the contact; "
                f"got {self.contact_stiffness_n_per_m:g}"
            )
        rod_restitution(self.stop.wave, self.mass_kg)
        return self

    @property
    def rebound(self) -> float:
        """Speed after a blow over that before it: that of the rods, or the given one."""
        if self.stop.model == "rigid":
            return self.restitution
        return rod_restitution(self.stop.wave, self.mass_kg)

    @property
    def system(self) -> ImpactSystem:
        """What acts on the mass at nominal supply."""
        times_s = self.period_s, self.phase1_duration_s
        accelerations = self.phase1_force_n / self.mass_kg, self.phase2_force_n / self.mass_kg
        return impact_system(times_s, accelerations, self.rebound, self.chatter_cutoff)

    @property
    def start(self) -> MassMotion:
        """The motion at the start, at nominal supply."""
        gap_m = self.stop_position_m - self.initial_position_m
        return initial_motion(gap_m, self.initial_velocity_m_per_s, self.system)
