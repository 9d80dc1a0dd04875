# SPDX-License-Identifier: Apache-2.0
"""Parameters of the impact mass."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from mech_twin.declarations.quantity import choice, quantity
from mech_twin.engine.coupling import Coupling
from mech_twin.machines.impact_mass.dynamics import ImpactSystem, impact_system
from mech_twin.machines.impact_mass.force_generator import GeneratorParameters
from mech_twin.machines.impact_mass.impact_stop import LARGEST_RESTITUTION, LEAST_RESTITUTION, StopParameters
from mech_twin.machines.impact_mass.wave_stop import StopModel, rod_restitution
from mech_twin.parts.supply import SupplyParameters

MOST_PERIODS_PER_STEP = 100.0  # a step holds at most so many periods of the force, and so a bounded number of events


class ImpactMass(StopParameters, GeneratorParameters):
    """Parameters of the impact mass."""

    initial_position_m: float = quantity("m", "position x0 at the start, not beyond the stop")
    initial_velocity_m_per_s: float = quantity("m/s", "velocity v0 at the start, positive towards the stop")
    stop: StopModel = choice("rigid stop, or a rod", default=StopModel())
    supply: SupplyParameters = choice("supply of the generator: the fraction multiplies both force levels")
    coupling: Coupling = choice("coupling of the roles")

    @model_validator(mode="after")
    def _start_before_the_stop(self) -> Self:
        if self.initial_position_m > self.stop_position_m:
            raise ValueError(
                "initial_position_m <= stop_position_m does not hold: "
                f"initial_position_m = {self.initial_position_m!r}, stop_position_m = {self.stop_position_m!r}"
            )
        return self

    @model_validator(mode="after")
    def _few_periods_in_a_step(self) -> Self:
        if self.coupling.step_s > MOST_PERIODS_PER_STEP * self.period_s:
            raise ValueError(
                f"coupling.step_s <= {MOST_PERIODS_PER_STEP:g} period_s does not hold: "
                f"coupling.step_s = {self.coupling.step_s!r}, period_s = {self.period_s!r}"
            )
        return self

    @model_validator(mode="after")
    def _stop_gives_one_rebound(self) -> Self:
        if self.stop.model == "rigid":
            return self
        if self.contact_stiffness_n_per_m is not None:
            raise ValueError(
                "contact_stiffness_n_per_m must be left out with stop.model wave: stop.wave.face is the contact; "
                f"got {self.contact_stiffness_n_per_m:g}"
            )
        rod_restitution(self.stop.wave, self.mass_kg, LEAST_RESTITUTION, LARGEST_RESTITUTION)
        return self

    @property
    def rebound(self) -> float:
        """Speed after a blow over that before it: that of the rods, or the given one."""
        if self.stop.model == "rigid":
            return self.restitution
        return rod_restitution(self.stop.wave, self.mass_kg, LEAST_RESTITUTION, LARGEST_RESTITUTION)

    @property
    def times_s(self) -> tuple[float, float]:
        """Period T and duration t1 of the first phase, s."""
        return self.period_s, self.phase1_duration_s

    @property
    def accelerations_m_per_s2(self) -> tuple[float, float]:
        """Accelerations A1, A2 at nominal supply, m/s2."""
        return self.phase1_force_n / self.mass_kg, self.phase2_force_n / self.mass_kg

    @property
    def system(self) -> ImpactSystem:
        """What acts on the mass at nominal supply."""
        return impact_system(self.times_s, self.accelerations_m_per_s2, self.rebound, self.chatter_cutoff)

    @property
    def initial_gap_m(self) -> float:
        """Gap between mass and stop at the start, m."""
        return self.stop_position_m - self.initial_position_m
