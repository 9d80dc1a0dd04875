"""Impact mass: a mass under a two-level periodic force, striking a stop; exact events, no time step."""

from __future__ import annotations

import math
from typing import Any, Self

from pydantic import model_validator

from mech_twin.machines.impact_mass_events import Drive, drive
from mech_twin.machines.impact_mass_figures import MassObserver, cycle_report, mass_drawing, position_figures
from mech_twin.machines.impact_mass_roles import ForceGenerator, MassOnStop, StopReaction
from mech_twin.parts.force_generator import GeneratorParameters
from mech_twin.parts.impact_stop import StopParameters
from mech_twin.parts.supply import SupplyParameters
from mech_twin.quantity import Parameters, choice, quantity
from mech_twin.roles import Machine


class MassCoupling(Parameters):
    """How the roles exchange samples; the motion itself does not depend on it."""

    step_s: float = quantity("s", "coupling step: the roles exchange samples once per step", gt=0.0, le=1.0)


class ImpactMass(StopParameters, GeneratorParameters):
    """Parameters of the impact mass."""

    initial_position_m: float = quantity("m", "position x0 at the start, not beyond the stop")
    initial_velocity_m_per_s: float = quantity("m/s", "velocity v0 at the start, positive towards the stop")
    supply: SupplyParameters = choice("supply of the generator: the fraction multiplies both force levels")
    coupling: MassCoupling = choice("coupling of the roles")

    @model_validator(mode="after")
    def _start_before_the_stop(self) -> Self:
        if self.initial_position_m > self.stop_position_m:
            raise ValueError(
                "initial_position_m <= stop_position_m does not hold: "
                f"initial_position_m = {self.initial_position_m!r}, stop_position_m = {self.stop_position_m!r}"
            )
        return self

    @property
    def times_s(self) -> tuple[float, float]:
        """Period T and duration t1 of the first phase, s."""
        return self.period_s, self.phase1_duration_s

    @property
    def accelerations_m_per_s2(self) -> tuple[float, float]:
        """Accelerations A1, A2 at nominal supply, m/s2."""
        return self.phase1_force_n / self.mass_kg, self.phase2_force_n / self.mass_kg

    @property
    def acting(self) -> Drive:
        """What acts on the mass at nominal supply."""
        return drive(self.times_s, self.accelerations_m_per_s2, self.restitution, self.chatter_cutoff)

    @property
    def initial_gap_m(self) -> float:
        """Gap between mass and stop at the start, m."""
        return self.stop_position_m - self.initial_position_m


PARAMETERS = ImpactMass


def build(parameters: Parameters) -> Machine:
    """Return the impact mass of these parameters."""
    if not isinstance(parameters, ImpactMass):
        raise TypeError(f"expected ImpactMass parameters, got {type(parameters).__name__}")
    p = parameters
    step_s = p.coupling.step_s
    linkage = MassOnStop(
        p.mass_kg,
        p.stop_position_m,
        p.restitution,
        p.chatter_cutoff,
        p.times_s,
        step_s,
        (p.phase1_force_n, p.phase2_force_n),
        p.supply.initial_fraction,
        p.initial_position_m,
        p.initial_velocity_m_per_s,
    )
    motor = ForceGenerator(p.phase1_force_n, p.phase2_force_n, p.supply.rate_per_s, step_s)

    def analyse(angle_rad: float) -> dict[str, Any]:
        return position_figures(
            p.acting,
            p.mass_kg,
            p.stop_position_m,
            p.initial_gap_m,
            p.initial_velocity_m_per_s,
            angle_rad % (2.0 * math.pi),
        )

    def report() -> dict[str, float]:
        return cycle_report(p.acting, p.mass_kg, p.initial_gap_m, p.initial_velocity_m_per_s)

    return Machine(
        "impact_mass",
        p,
        step_s,
        motor,
        linkage,
        StopReaction(p.mass_kg, p.period_s),
        None,
        lambda sample, _: mass_drawing(p.stop_position_m, sample),
        report,
        analyse,
        lambda: MassObserver(p.mass_kg, p.stop_position_m),
    )
