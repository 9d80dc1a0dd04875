# SPDX-License-Identifier: Apache-2.0
"""Parameters of a tool whose blow is told as a wave, and the chain they make: head, rod, tip, foot, wall."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, choice, lower, quantity, upper
from mech_twin.parts.rod_waves.chain import wave_speed
from mech_twin.parts.rod_waves.contact_law import (
    FREE_END,
    RIGID_FACE,
    ContactLaw,
    hertz_contact,
    linear_contact,
    power_wall,
    yielding_wall,
)
from mech_twin.parts.rod_waves.fatigue import StressLine

Array = NDArray[np.float64]
STEEL_MODULUS_PA = 2.1e11
STEEL_DENSITY_KG_PER_M3 = 7850.0
MOST_STEPS = 50_000  # of a window
MOST_CELLS = 512  # of head, tool and foot together


class RodSegment(Parameters):
    """A cylindrical piece of rod; one of length 0 is not there."""

    length_m: float = quantity("m", "length; 0: the piece is not there", ge=0.0, le=10.0)
    diameter_m: float = quantity("m", "diameter", ge=1e-3, le=1.0)
    young_modulus_pa: float = quantity("Pa", "Young's modulus", ge=1e8, le=1e13, default=STEEL_MODULUS_PA)
    density_kg_per_m3: float = quantity("kg/m3", "density", ge=100.0, le=3e4, default=STEEL_DENSITY_KG_PER_M3)
    loss_factor: float = quantity("1", "loss factor of its first free vibration", ge=0.0, le=0.1, default=0.0)

    @property
    def area_m2(self) -> float:
        """Area of the section."""
        return 0.25 * math.pi * self.diameter_m**2

    @property
    def speed_m_per_s(self) -> float:
        """Speed of a longitudinal wave."""
        return wave_speed(self.young_modulus_pa, self.density_kg_per_m3)

    @property
    def impedance(self) -> float:
        """Z = rho c A, N s/m."""
        return self.density_kg_per_m3 * self.speed_m_per_s * self.area_m2

    @property
    def mass_kg(self) -> float:
        """Mass."""
        return self.density_kg_per_m3 * self.area_m2 * self.length_m

    @property
    def transit_s(self) -> float:
        """Time a wave takes along it."""
        return self.length_m / self.speed_m_per_s


class Rod(RodSegment):
    """The tool behind its struck face."""

    length_m: float = quantity("m", "length", ge=0.0, le=10.0, default=0.45)
    diameter_m: float = quantity("m", "diameter", ge=1e-3, le=1.0, default=0.06)


class Tip(RodSegment):
    """The second section of the tool."""

    length_m: float = quantity("m", "length; 0: the piece is not there", ge=0.0, le=10.0, default=0.0)
    diameter_m: float = quantity("m", "diameter", ge=1e-3, le=1.0, default=0.04)


class Head(RodSegment):
    """The striker's head, a rod in front of its rigid mass."""

    length_m: float = quantity("m", "length; 0: the striker is rigid", ge=0.0, le=10.0, default=0.0)
    diameter_m: float = quantity("m", "diameter", ge=1e-3, le=1.0, default=0.06)


class Foot(RodSegment):
    """The foot between tool and wall."""

    length_m: float = quantity("m", "length; 0: the piece is not there", ge=0.0, le=10.0, default=0.0)
    diameter_m: float = quantity("m", "diameter", ge=1e-3, le=1.0, default=0.1)


class Face(Parameters):
    """Contact of the striker with the tool."""

    kind: Literal["linear", "hertz"] = choice("linear spring, or rounded face after Hertz", default="linear")
    stiffness_n_per_m: float = quantity("N/m", "stiffness of a linear contact", ge=1e5, le=1e12, default=2e8)
    restitution: float = quantity("1", "restitution of a linear contact by itself", ge=0.05, le=1.0, default=1.0)
    radius_m: float = quantity("m", "radius of a face after Hertz", ge=1e-3, le=100.0, default=0.1)
    reduced_modulus_pa: float = quantity(
        "Pa", "1/E* of both faces after Hertz, inverted", ge=1e8, le=1e13, default=1.15e11
    )

    @property
    def law(self) -> ContactLaw:
        """Force over compression."""
        if self.kind == "hertz":
            return hertz_contact(self.reduced_modulus_pa, self.radius_m)
        return linear_contact(self.stiffness_n_per_m, self.restitution)


class Wall(Parameters):
    """What the tool, or its foot, stands on."""

    kind: Literal["loading", "yielding", "rigid", "free"] = choice("law of the wall", default="yielding")
    stiffness_n_per_m: float = quantity("N/m", "loading stiffness, k_l", ge=1e4, le=1e12, default=5e7)
    unloading_ratio: float = quantity("1", "unloading over loading stiffness, k_u/k_l", ge=1.0, le=1e4, default=4.0)
    threshold_n: float = quantity("N", "force up to which the wall is elastic, with k_u", ge=0.0, le=1e7, default=0.0)
    exponent: float = quantity("1", "n of a loading F = k_l u_1 (u/u_1)^n", ge=0.2, le=5.0, default=1.0)
    stiffness_at_m: float = quantity("m", "penetration u_1 at which k_l is the secant", ge=1e-6, le=1.0, default=1e-3)
    damping_ns_per_m: float = quantity("N s/m", "damping of a loading wall", ge=0.0, le=1e8, default=0.0)

    @model_validator(mode="after")
    def _law_is_passive(self) -> Wall:
        if self.exponent == 1.0:
            return self
        if self.threshold_n > 0.0:
            raise ValueError(f"threshold_n must be 0 with exponent {self.exponent:g}; got {self.threshold_n:g}")
        least = 0.5 * (self.exponent + 1.0)
        if self.unloading_ratio < least:
            raise ValueError(
                f"unloading_ratio must be at least (exponent + 1)/2 = {lower(least)}: the wall would give back more "
                f"than it took; got {self.unloading_ratio:g}"
            )
        return self

    def law(self, yielding_n: float) -> ContactLaw:
        """Return the force over compression; a yielding wall gives way at ``yielding_n`` (N)."""
        if self.kind == "free":
            return FREE_END
        if self.kind == "rigid":
            return RIGID_FACE
        steep = self.stiffness_n_per_m * self.unloading_ratio
        if self.kind == "yielding":
            return yielding_wall(yielding_n, steep)
        if self.exponent == 1.0:
            law = linear_contact(self.stiffness_n_per_m)._replace(unloading=steep, threshold_n=self.threshold_n)
        else:
            law = power_wall(self.stiffness_n_per_m, self.exponent, self.stiffness_at_m, self.unloading_ratio)
        return law._replace(damping=self.damping_ns_per_m)


class Life(Parameters):
    """S-N line of the tool's steel, and what counts with it."""

    amplitude_pa: float | None = quantity(
        "Pa",
        "stress amplitude about 0 that breaks it after so many cycles; no life is told without",
        ge=1e5,
        default=None,
    )
    cycles: float = quantity("1", "cycles at that amplitude", ge=1.0, le=1e6, default=1e6)
    slope: float = quantity("1", "slope k of the line, N ~ S^-k", ge=1.0, le=50.0, default=5.0)
    ultimate_pa: float = quantity("Pa", "ultimate strength, for mean stresses (Goodman)", ge=1e6, default=9e8)
    notch_factor: float = quantity("1", "stress at a notch over that of the section", ge=1.0, le=10.0, default=1.0)

    @property
    def line(self) -> StressLine | None:
        """The S-N line."""
        if self.amplitude_pa is None:
            return None
        return StressLine(self.amplitude_pa, self.cycles, self.slope, self.ultimate_pa, self.notch_factor)


class WaveTool(Parameters):
    """The blow as a wave: pieces from the striker to the wall."""

    cells: int = quantity("1", "cells of equal transit time along rod and tip", ge=4, le=256, default=32)
    head: Head = choice("the striker's head", default=Head())
    face: Face = choice("contact of striker and tool", default=Face())
    rod: Rod = choice("the tool", default=Rod())
    tip: Tip = choice("second section of the tool", default=Tip())
    foot: Foot = choice("foot between tool and wall", default=Foot())
    foot_stiffness_n_per_m: float = quantity("N/m", "contact of tool and foot", ge=1e5, le=1e12, default=1e9)
    foot_gap_m: float = quantity("m", "play between tool and foot", ge=0.0, le=0.05, default=0.0)
    unseated_gap_m: float = quantity(
        "m", "gap to the wall where the tool is not pressed on it", ge=0.0, le=0.05, default=1e-3
    )
    wall: Wall = choice("the wall", default=Wall())
    gauge_m: float = quantity("m", "strain gauge, from the struck face", ge=0.0, le=20.0, default=0.2)
    life: Life = choice("life of the tool", default=Life())
    gauge_curve: bool = choice("send the curve of the gauge of each blow", default=False)
    window_s: float = quantity("s", "longest blow", ge=1e-4, le=0.02, default=0.02)


class GridPiece(NamedTuple):
    """A segment on the grid; its length is the rounded one."""

    cells: int
    impedance: float
    area_m2: float
    loss: float
    length_m: float


class WaveGrid(NamedTuple):
    """Constants of a blow as numbers: pieces of head, rod, tip and foot, contacts, gauge, window."""

    span_s: float
    head: GridPiece
    rod: GridPiece
    tip: GridPiece
    foot: GridPiece
    face: ContactLaw
    seat: ContactLaw
    wall: ContactLaw
    foot_gap_m: float
    unseated_gap_m: float
    gauge: int  # cell of the tool, from the struck face
    window_s: float

    @property
    def tool_mass_kg(self) -> float:
        """Mass of rod, tip and foot on the grid: Z h in each cell."""
        pieces = (self.rod, self.tip, self.foot)
        return sum(piece.cells * piece.impedance for piece in pieces) * self.span_s

    @property
    def head_mass_kg(self) -> float:
        """Mass of the striker's head on the grid."""
        return self.head.cells * self.head.impedance * self.span_s


def _on_grid(segment: RodSegment, span_s: float) -> GridPiece:
    cells = max(1, round(segment.transit_s / span_s)) if segment.length_m > 0.0 else 0
    loss = math.pi * segment.loss_factor / max(cells, 1)
    return GridPiece(cells, segment.impedance, segment.area_m2, loss, cells * span_s * segment.speed_m_per_s)


def wave_grid(p: WaveTool, yielding_n: float, where: str = "wave.") -> WaveGrid:
    """Return the constants of a blow on a grid of equal transit time; ``where`` stands before a key that is refused.

    Raises
    ------
    ValueError
        No tool, a gauge beyond it, more cells than `MOST_CELLS`, or more steps than `MOST_STEPS`.
    """
    if p.rod.length_m == 0.0:
        raise ValueError(f"{where}rod.length_m must be above 0: there is no tool to strike")
    span = (p.rod.transit_s + p.tip.transit_s) / p.cells
    head, rod, tip, foot = (_on_grid(piece, span) for piece in (p.head, p.rod, p.tip, p.foot))
    cells = head.cells + rod.cells + tip.cells + foot.cells
    if cells > MOST_CELLS:
        raise ValueError(
            f"{where}cells = {p.cells} makes {cells} cells of head, tool and foot; at most {MOST_CELLS}: head "
            "or foot is long against the tool"
        )
    if p.window_s > MOST_STEPS * span:
        raise ValueError(
            f"{where}window_s must be at most {upper(MOST_STEPS * span, 4)} s, {MOST_STEPS} times the transit time of "
            f"a cell; got {p.window_s:g}: take fewer cells"
        )
    along = p.gauge_m
    if along > p.rod.length_m + p.tip.length_m:
        raise ValueError(
            f"{where}gauge_m must be at most {upper(p.rod.length_m + p.tip.length_m)} m, the length of the tool; "
            f"got {along:g}"
        )
    in_rod = min(along, p.rod.length_m)
    transit = in_rod / p.rod.speed_m_per_s + (along - in_rod) / p.tip.speed_m_per_s
    gauge = min(int(transit / span), rod.cells + tip.cells - 1)
    seat = linear_contact(p.foot_stiffness_n_per_m)
    return WaveGrid(
        span,
        head,
        rod,
        tip,
        foot,
        p.face.law,
        seat,
        p.wall.law(yielding_n),
        p.foot_gap_m,
        p.unseated_gap_m,
        gauge,
        p.window_s,
    )


def rounded_lengths(p: WaveTool, where: str) -> dict[str, tuple[float, float]]:
    """Return the length asked for and the one on the grid (m), of each piece that is there, by its key."""
    grid = wave_grid(p, 0.0)
    return {
        f"{where}.{name}.length_m": (getattr(p, name).length_m, getattr(grid, name).length_m)
        for name in ("head", "rod", "tip", "foot")
        if getattr(p, name).length_m > 0.0
    }
