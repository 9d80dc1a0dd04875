# SPDX-License-Identifier: Apache-2.0
"""Rods of a page: a contact whose blow is a wave in a rod that stands on a wall.

The striker has the effective mass m_e of the machine at the contact, with closed contacts taken into account; a head
that is a rod is part of it.  It strikes at the closing speed v.  The impulse P of the blow acts as that of a rigid
contact with restitution P/(m_e v) - 1, at least 0: a striker that would move on after the rod is stopped, and its
remaining energy is lost.  The rod is at rest in its seat before each blow: it has followed into a yielding wall.
"""

from functools import partial
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from mech_twin.capabilities.blow_gauge import CLOSES, BlowGauge, GaugeCurve
from mech_twin.declarations.quantity import choice
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.parts.rod_waves.contact_law import LAW_COLUMNS, ContactLaw
from mech_twin.parts.rod_waves.parameters import GridPiece, Wall, WaveGrid, WaveTool, rounded_lengths, wave_grid
from mech_twin.parts.rod_waves.struck_tool import (
    NO_CURVE,
    NO_FORCES,
    BlowSimulation,
    blow_and_metrics,
    gauge_curve,
    gauge_numbers,
    rod_blow,
    with_head_within,
)
from mech_twin.samples import Event

Array = NDArray[np.float64]
PIECE_COLUMNS = len(GridPiece._fields)
FACE = 1 + 4 * PIECE_COLUMNS
REST = FACE + 3 * LAW_COLUMNS
ROD_COLUMNS = REST + 4


class RodWall(Wall):
    """The wall behind a rod."""

    kind: Literal["loading", "yielding", "rigid"] = choice("law of the wall", default="loading")

    @model_validator(mode="after")
    def _yields_at_a_force(self) -> Self:
        if self.kind == "yielding" and self.threshold_n == 0.0:
            raise ValueError("threshold_n must be above 0: a yielding wall gives way at it")
        return self


class ContactRod(WaveTool):
    """The rod of a contact, which transmits the blow to a wall; at rest in its seat before each blow."""

    wall: RodWall = choice("the wall behind the rod", default=RodWall())

    @model_validator(mode="after")
    def _can_be_simulated(self) -> Self:
        if self.unseated_gap_m != WaveTool.model_fields["unseated_gap_m"].default:
            raise ValueError("unseated_gap_m has no effect here: the rod of a page stands in its seat")
        wave_grid(self, 0.0, "")
        return self

    @property
    def grid(self) -> WaveGrid:
        """The constants of a blow; a yielding wall gives way at its threshold."""
        return wave_grid(self, self.wall.threshold_n)


def grid_row(grid: WaveGrid) -> list[float]:
    """Return a grid as numbers in a row."""
    return [float(x) for part in grid for x in (part if isinstance(part, tuple) else (part,))]


@borrowing_kernel
def piece_at(rods: Array, rod: int, place: int) -> GridPiece:
    """Return a piece of a rod from its row."""
    row = rods[rod]
    return GridPiece(int(row[place]), row[place + 1], row[place + 2], row[place + 3], row[place + 4])


@borrowing_kernel
def law_at(rods: Array, rod: int, place: int) -> ContactLaw:
    """Return a contact of a rod from its row."""
    row = rods[rod]
    return ContactLaw(int(row[place]), row[place + 1], row[place + 2], row[place + 3], row[place + 4], row[place + 5])


@kernel
def rod_restitution(rods: Array, rod: int, striker_kg: float, closing: float) -> float:
    """Return the restitution of a rigid contact that gives the impulse of the blow, 0 to 1."""
    row, pieces = rods[rod], PIECE_COLUMNS
    grid = WaveGrid(
        row[0],
        piece_at(rods, rod, 1),
        piece_at(rods, rod, 1 + pieces),
        piece_at(rods, rod, 1 + 2 * pieces),
        piece_at(rods, rod, 1 + 3 * pieces),
        law_at(rods, rod, FACE),
        law_at(rods, rod, FACE + LAW_COLUMNS),
        law_at(rods, rod, FACE + 2 * LAW_COLUMNS),
        row[REST],
        row[REST + 1],
        int(row[REST + 2]),
        row[REST + 3],
    )
    none = np.empty((0, 2))
    found = rod_blow(with_head_within(grid, striker_kg), striker_kg, closing, 0.0, True, none, none)
    return float(min(max(found.impulse_ns / (striker_kg * closing) - 1.0, 0.0), 1.0))


class PageRods:
    """The rods of a page by their contacts, and the results of blows on them.

    Parameters
    ----------
    rods : dict
        Rod of each contact that has one.
    """

    def __init__(self, rods: dict[str, ContactRod]) -> None:
        self.rods = rods
        self.grids = {name: rod.grid for name, rod in rods.items()}

    @property
    def rows(self) -> Array:
        """A row of numbers for each rod."""
        return np.array([grid_row(grid) for grid in self.grids.values()]).reshape(len(self.grids), ROD_COLUMNS)

    def has_reading(self, event: Event) -> bool:
        """Return whether an event is a blow on a rod."""
        return self.meets(event) and event.pre_velocity_m_per_s > CLOSES

    def meets(self, event: Event) -> bool:
        """Return whether an event is an impulse on a rod: a blow, or one that a body at rest on it passes on."""
        return event.kind == "impact" and event.contact in self.rods and event.impulse_ns > 0.0

    def _simulation_of(self, event: Event) -> tuple[WaveGrid, float, BlowSimulation]:
        """Return the grid of an event's blow, the striker's mass (kg), and what simulates it again."""
        closing = event.pre_velocity_m_per_s
        mass = event.impulse_ns / (closing - event.post_velocity_m_per_s)
        grid = with_head_within(self.grids[event.contact], mass)
        return grid, mass, partial(rod_blow, grid, mass, closing, 0.0, True)

    def numbers(self, event: Event) -> dict[str, float]:
        """Return the numbers of an event's blow."""
        rod = self.rods[event.contact]
        grid, mass, simulate = self._simulation_of(event)
        found, metrics = blow_and_metrics(grid, rod.life.line, simulate)
        if rod.wall.kind == "yielding":
            metrics["overtravel_m"] = metrics["tool_energy_j"] / rod.wall.threshold_n
        if rod.head.length_m > 0.0:
            metrics["head_too_heavy"] = 1.0 if grid.head.cells == 0 else 0.0
        return {
            **metrics,
            "striker_mass_kg": mass,
            "striker_rebound_m_per_s": -event.post_velocity_m_per_s,
            "restitution_effective": -event.post_velocity_m_per_s / event.pre_velocity_m_per_s,
            "striker_stopped_m_per_s": max(0.0, event.pre_velocity_m_per_s - found.impulse_ns / mass),
        }

    def gauge(self) -> BlowGauge | None:
        """Return the strain gauges on the rods; None where there is no rod."""
        if not self.rods:
            return None

        def numbers(event: Event) -> tuple[float, ...]:
            grid, _, simulate = self._simulation_of(event)
            return gauge_numbers(grid, simulate(NO_CURVE, NO_FORCES))

        def curve(event: Event) -> GaugeCurve:
            grid, _, simulate = self._simulation_of(event)
            return GaugeCurve(*gauge_curve(grid, simulate))

        curves = tuple(name for name, rod in self.rods.items() if rod.gauge_curve)
        return BlowGauge("impact", tuple(self.rods), numbers, curve, curves)

    def roundings(self) -> dict[str, tuple[float, float]]:
        """Return the configured length and the length on the grid (m), by key."""
        found: dict[str, tuple[float, float]] = {}
        for name, rod in self.rods.items():
            found |= rounded_lengths(rod, f"contacts.{name}.rod")
        return found
