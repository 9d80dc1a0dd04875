# SPDX-License-Identifier: Apache-2.0
"""The stop of the impact mass as a rod on a wall: results of one blow, and the restitution.

Such a stop is linear: linear contacts, no gap, no threshold.  So forces are proportional to the impact speed, energies
to its square, and the restitution is one number, for which the event-driven simulation stays exact.  The stop is in
its seat and free of waves before each blow.  The impulse of the generator's force during the blow is neglected.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Literal

from pydantic import model_validator

from mech_twin.capabilities.blow_gauge import BlowGauge, GaugeCurve
from mech_twin.declarations.quantity import Parameters, choice, upper
from mech_twin.machines.impact_mass.dynamics import IMPACT, KIND_CONTACTS, KIND_NAMES
from mech_twin.machines.impact_mass.impact_stop import LARGEST_RESTITUTION, LEAST_RESTITUTION
from mech_twin.parts.rod_waves.blow import RodBlow
from mech_twin.parts.rod_waves.parameters import Wall, WaveGrid, WaveTool, wave_grid
from mech_twin.parts.rod_waves.struck_tool import (
    LARGEST_HEAD,
    NO_CURVE,
    NO_FORCES,
    force_room,
    gauge_curve,
    gauge_numbers,
    life_numbers,
    place_m,
    rod_blow,
)
from mech_twin.samples import Event

POWERS = (2, 2, 2, 1, 1, 1)  # of the speed, of each number of a gauge


class StopWall(Wall):
    """The wall behind the stop."""

    kind: Literal["loading", "yielding", "rigid", "free"] = choice("law of the wall", default="loading")


class StopRod(WaveTool):
    """The stop as a rod."""

    wall: StopWall = choice("the wall behind the stop", default=StopWall())

    @property
    def grid(self) -> WaveGrid:
        """The constants of a blow."""
        return wave_grid(self, 0.0)


class StopModel(Parameters):
    """The stop: rigid with a given restitution, or a rod."""

    model: Literal["rigid", "wave"] = choice("the stop: rigid, or a rod in which the blow is a wave", default="rigid")
    wave: StopRod = choice("the stop as a rod, with model wave", default=StopRod())

    @model_validator(mode="after")
    def _is_of_first_degree(self) -> StopModel:
        rod = self.wave
        if self.model == "rigid":
            return self
        for key, value, expected, holds in (
            ("face.kind", rod.face.kind, "linear", rod.face.kind == "linear"),
            ("wall.kind", rod.wall.kind, "loading or rigid", rod.wall.kind in ("loading", "rigid")),
            ("wall.threshold_n", rod.wall.threshold_n, "0", rod.wall.threshold_n == 0.0),
            ("wall.exponent", rod.wall.exponent, "1", rod.wall.exponent == 1.0),
            ("foot_gap_m", rod.foot_gap_m, "0", rod.foot_gap_m == 0.0),
        ):
            if not holds:
                raise ValueError(
                    f"wave.{key} must be {expected}, so that the restitution is the same at every speed; got {value}"
                )
        rod.grid  # noqa: B018 # refuses what cannot be led
        return self


@lru_cache(maxsize=64)
def unit_blow(rod: StopRod, mass_kg: float) -> RodBlow:
    """Return the blow of a mass on a stop at unit speed (1 m/s)."""
    return rod_blow(rod.grid, float(mass_kg), 1.0, 0.0, True, NO_CURVE, NO_FORCES)


def rod_restitution(rod: StopRod, mass_kg: float) -> float:
    """Return the coefficient of restitution of a mass on a stop.

    Raises
    ------
    ValueError
        If the head is most of the mass, the blow does not end, or the restitution is out of bounds.
    """
    head = rod.grid.head_mass_kg
    if head > LARGEST_HEAD * mass_kg:
        raise ValueError(
            f"stop.wave.head must have at most {LARGEST_HEAD:g} of mass_kg, {upper(LARGEST_HEAD * mass_kg)} kg; "
            f"got {head:.6g}"
        )
    found = unit_blow(rod, mass_kg)
    if not found.parted:
        raise ValueError(
            f"stop.wave.window_s = {rod.window_s:g} s is over before mass and stop have parted: expected a longer one, "
            "or a stiffer wall"
        )
    restitution = found.impulse_ns / mass_kg - 1.0
    if not LEAST_RESTITUTION <= restitution <= LARGEST_RESTITUTION:
        raise ValueError(
            f"stop.wave gives a restitution of {restitution:.6g}; expected {LEAST_RESTITUTION:g} to "
            f"{LARGEST_RESTITUTION:g}: a mass that rebounds"
        )
    return restitution


def blow_numbers(rod: StopRod, mass_kg: float, speed_m_per_s: float) -> dict[str, float]:
    """Return the results of a blow at a speed (m/s)."""
    unit, grid, v = unit_blow(rod, mass_kg), rod.grid, speed_m_per_s
    return {
        "incident_energy_j": unit.incident_energy_j * v * v,
        "forward_energy_j": unit.forward_energy_j * v * v,
        "reflected_energy_j": unit.reflected_energy_j * v * v,
        "transmitted_energy_j": unit.transmitted_energy_j * v * v,
        "stop_energy_j": (unit.tool_vibration_j + 0.5 * unit.tool_momentum_ns**2 / grid.tool_mass_kg) * v * v,
        "blow_efficiency": unit.transmitted_energy_j / unit.striker_energy_j,
        "penetration_m": unit.penetration_m * v,
        "peak_force_n": unit.peak_force_n * v,
        "peak_stress_pa": unit.peak_stress_pa * v,
        "stress_place_m": place_m(grid, unit.peak_stress_at_s),
        "peak_tension_pa": unit.peak_tension_pa * v,
        "tension_place_m": place_m(grid, unit.peak_tension_at_s),
        "blow_contact_time_s": unit.contact_time_s,
        "blow_contacts": float(unit.contacts),
        **_life(rod, mass_kg, v),
    }


def _life(rod: StopRod, mass_kg: float, speed_m_per_s: float) -> dict[str, float]:
    line, grid = rod.life.line, rod.grid
    if line is None or speed_m_per_s <= 0.0:
        return {}
    forces = force_room(grid)
    found = rod_blow(grid, float(mass_kg), speed_m_per_s, 0.0, True, NO_CURVE, forces)
    return life_numbers(grid, line, found, forces)


def stop_gauge(rod: StopRod, mass_kg: float) -> BlowGauge:
    """Return the strain gauge on the stop."""
    grid = rod.grid
    of_unit = gauge_numbers(grid, unit_blow(rod, mass_kg))

    def numbers(event: Event) -> tuple[float, ...]:
        v = event.pre_velocity_m_per_s
        return tuple(number * v**power for number, power in zip(of_unit, POWERS, strict=True))

    def curve(event: Event) -> GaugeCurve:
        return GaugeCurve(
            *gauge_curve(grid, partial(rod_blow, grid, float(mass_kg), event.pre_velocity_m_per_s, 0.0, True))
        )

    contacts = (KIND_CONTACTS[int(IMPACT)],)
    return BlowGauge(KIND_NAMES[int(IMPACT)], contacts, numbers, curve, contacts if rod.gauge_curve else ())
