# SPDX-License-Identifier: Apache-2.0
"""Rods of a page: a contact whose blow is a wave in a rod that stands on a wall.

The striker is rigid, with the effective mass m_e that the machine has at the contact, those that are closed taking
part; it strikes at the closing speed v.  The impulse P of the blow acts as that of a rigid contact does, whose
restitution is P/(m_e v) - 1.  The rod is at rest in its seat before each blow.
"""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from mech_twin.capabilities.blow_gauge import BlowGauge, GaugeCurve
from mech_twin.kernel import borrowing_kernel, kernel
from mech_twin.parts.rod_waves.blow import RodBlow
from mech_twin.parts.rod_waves.contact_law import LAW_COLUMNS, ContactLaw
from mech_twin.parts.rod_waves.parameters import GridPiece, Wall, WaveGrid, WaveTool, rounded_lengths, wave_grid
from mech_twin.parts.rod_waves.struck_tool import (
    force_room,
    gauge_numbers,
    gauge_room,
    life_numbers,
    rod_blow,
    rod_numbers,
    strain_per_n,
)
from mech_twin.quantity import choice
from mech_twin.samples import Event

Array = NDArray[np.float64]
PIECE_COLUMNS = len(GridPiece._fields)
FACE = 1 + 4 * PIECE_COLUMNS
REST = FACE + 3 * LAW_COLUMNS
ROD_COLUMNS = REST + 4
NO_ROOM = np.empty((0, 2))


class RodWall(Wall):
    """The wall behind a rod."""

    kind: Literal["loading", "rigid"] = choice("law of the wall", default="loading")


class ContactRod(WaveTool):
    """The rod that a contact strikes through: it stands on a wall, at rest in its seat before each blow."""

    wall: RodWall = choice("the wall behind the rod", default=RodWall())

    @model_validator(mode="after")
    def _can_be_led(self) -> Self:
        if self.head.length_m > 0.0:
            raise ValueError(
                f"head.length_m must be 0: the striker of a page is rigid, with the mass that its mechanism has at the "
                f"contact; got {self.head.length_m:g}"
            )
        if self.unseated_gap_m != WaveTool.model_fields["unseated_gap_m"].default:
            raise ValueError("unseated_gap_m has no effect here: the rod of a page stands in its seat")
        wave_grid(self, 0.0, "")
        return self


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
    found = rod_blow(grid, striker_kg, closing, 0.0, True, none, none)
    return float(min(max(found.impulse_ns / (striker_kg * closing) - 1.0, 0.0), 1.0))


class PageRods:
    """The rods of a page by their contacts: what a blow on one gives.

    Parameters
    ----------
    rods : dict
        Rod of each contact that has one.
    """

    def __init__(self, rods: dict[str, ContactRod]) -> None:
        self.rods = rods
        self.grids = {name: wave_grid(rod, 0.0) for name, rod in rods.items()}

    @property
    def rows(self) -> Array:
        """A row of numbers for each rod."""
        return np.array([grid_row(grid) for grid in self.grids.values()]).reshape(len(self.grids), ROD_COLUMNS)

    def tells(self, event: Event) -> bool:
        """Return whether an event is a blow on a rod."""
        return event.kind == "impact" and event.contact in self.rods and event.impulse_ns > 0.0

    def _led(self, event: Event, gauge: Array, forces: Array) -> tuple[RodBlow, float]:
        """Return the blow of an event, led once more, and the striker's mass (kg)."""
        closing = event.pre_velocity_m_per_s
        mass = event.impulse_ns / (closing - event.post_velocity_m_per_s)
        return rod_blow(self.grids[event.contact], mass, closing, 0.0, True, gauge, forces), mass

    def numbers(self, event: Event) -> dict[str, float]:
        """Return what the blow of an event gives."""
        grid, line = self.grids[event.contact], self.rods[event.contact].life.line
        forces = NO_ROOM if line is None else force_room(grid)
        found, mass = self._led(event, NO_ROOM, forces)
        return {
            **rod_numbers(grid, found),
            "striker_mass_kg": mass,
            "striker_rebound_m_per_s": -event.post_velocity_m_per_s,
            "restitution_effective": -event.post_velocity_m_per_s / event.pre_velocity_m_per_s,
            **({} if line is None else life_numbers(grid, line, found, forces)),
        }

    def gauge(self) -> BlowGauge | None:
        """Return the strain gauges on the rods; None where there is no rod."""
        if not self.rods:
            return None

        def numbers(event: Event) -> tuple[float, ...]:
            return gauge_numbers(self.grids[event.contact], self._led(event, NO_ROOM, NO_ROOM)[0])

        def curve(event: Event) -> GaugeCurve:
            grid = self.grids[event.contact]
            room = gauge_room(grid)
            found, _ = self._led(event, room, NO_ROOM)
            force = room[: found.steps].sum(axis=1)
            return GaugeCurve(grid.span_s, force, strain_per_n(grid) * force)

        curves = tuple(name for name, rod in self.rods.items() if rod.gauge_curve)
        return BlowGauge("impact", tuple(self.rods), numbers, curve, curves)

    def roundings(self) -> dict[str, tuple[float, float]]:
        """Return the length asked for and the one on the grid (m), by its key."""
        found: dict[str, tuple[float, float]] = {}
        for name, rod in self.rods.items():
            found |= rounded_lengths(rod, f"contacts.{name}.rod")
        return found
