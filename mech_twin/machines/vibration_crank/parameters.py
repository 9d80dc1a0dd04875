# SPDX-License-Identifier: Apache-2.0
"""Parameters of the vibration crank, and the constants of its kernels."""

from __future__ import annotations

from math import acos, degrees, inf, isinf
from typing import Literal

from pydantic import model_validator

from mech_twin.declarations.configuration_tree import at_least
from mech_twin.declarations.quantity import Parameters, choice, quantity
from mech_twin.machines.drives import DrivenCrank
from mech_twin.machines.vibration_crank.slider_crank import (
    BOOM,
    FINITE_ROD,
    INFINITE_ROD,
    Counterweight,
    MovingMasses,
    SliderCrank,
)
from mech_twin.parts.four_bar import OPEN, FourBar, failing_inequality, smallest_transmission_angle

GRAVITY = 9.80665
LEAST_TRANSMISSION_DEG = 1.0


class Boom(Parameters):
    """Boom as a rocker: it carries the load beyond the joint of the rod."""

    pivot_x_m: float = quantity("m", "boom pivot, to the right of the crank bearing", ge=-1e4, le=1e4)
    pivot_y_m: float = quantity("m", "boom pivot, above the crank bearing", ge=-1e4, le=1e4)
    length_m: float = quantity("m", "boom from its pivot to the joint of the rod", ge=1e-3, le=1e4)
    load_ratio: float = quantity("1", "arm of the load over the length to the joint", gt=0.0, le=100.0)
    side: Literal["left", "right"] = choice("on which side of the line from pivot to crank pin the joint lies")


class VibrationCrank(DrivenCrank):
    """Parameters of the vibration crank."""

    masses: MovingMasses = choice("masses of the parts")
    crank_m: float = quantity("m", "crank radius r", ge=1e-3, le=10.0)
    rod_m: float = quantity(
        "m", "rod length (up to 1e4 m); infinite for pure harmonic motion", ge=1e-3, allow_inf_nan=True
    )
    offset_m: float = quantity("m", "offset e of the slider's line from the crank bearing", ge=-10.0, le=10.0)
    slider: Literal["above", "below"] = choice("slider above or below the crank")
    working_force_n: float = quantity("N", "working force down on the follower", ge=-1e8, le=1e8, live=True)
    boom: Boom | None = choice("boom as a rocker; a slider where absent", default=None)
    counterweight: Counterweight = choice("counterweight on the crank")

    @model_validator(mode="after")
    def _crank_turns(self) -> VibrationCrank:
        if self.masses.reciprocating <= 0.0:
            raise ValueError("masses: the reciprocating mass (tree, stand, half boom, half rod, extra) must not be 0")
        if self.rod_m != self.rod_m:
            raise ValueError("rod_m must be a length or infinite, got nan")
        if 1e4 < self.rod_m < inf:
            raise ValueError(f"rod_m must be at most 1e4 m, or infinite, got {self.rod_m:g}")
        if self.boom is None:
            if self.rod_m <= self.crank_m + abs(self.offset_m):
                least = self.crank_m + abs(self.offset_m)
                raise ValueError(
                    f"the crank cannot make a full turn: rod_m > crank_m + |offset_m| fails: {self.rod_m:g} m > "
                    f"{least:g} m; try rod_m >= {at_least(least):g}"
                )
            steepest = degrees(acos((self.crank_m + abs(self.offset_m)) / self.rod_m))
            if steepest < LEAST_TRANSMISSION_DEG:
                raise ValueError(
                    f"rod_m at least {LEAST_TRANSMISSION_DEG:g} degree off the square to the slider's line fails: "
                    f"{steepest:.3g} degrees (crank_m {self.crank_m:g}, rod_m {self.rod_m:g}, "
                    f"offset_m {self.offset_m:g})"
                )
            return self
        if isinf(self.rod_m):
            raise ValueError(f"rod_m must be finite (at most 1e4 m) where the boom is a rocker, got {self.rod_m:g}")
        rocker = FourBar(self.crank_m, self.rod_m, self.boom.length_m, self.boom.pivot_x_m, self.boom.pivot_y_m, OPEN)
        failing = failing_inequality(rocker)
        if failing is not None:
            raise ValueError(f"{failing}; rod_m is the coupler, boom.length_m the rocker, boom.pivot ends the ground")
        least = degrees(smallest_transmission_angle(rocker))
        if least < LEAST_TRANSMISSION_DEG:
            raise ValueError(
                f"transmission angle of rod_m and boom.length_m >= {LEAST_TRANSMISSION_DEG:g} degree fails: "
                f"{least:.3g} degrees"
            )
        return self

    @property
    def counterweight_kg(self) -> float:
        """Mass of the counterweight in force (kg): the given one, or that of its balancing fraction."""
        given, fraction = self.counterweight.mass_kg, self.counterweight.balancing_fraction
        return self.balancing_kg(fraction) if given is None else given

    def balancing_kg(self, fraction: float) -> float:
        """Return m_p = (m_r + kappa m_s) r/r_p (kg) for a balancing fraction kappa.

        With a boom m_j + kb m_t stands for m_s: its load moves by kb times the travel of the rod's joint.
        """
        masses, boom = self.masses, self.boom
        swinging = masses.reciprocating if boom is None else masses.at_rod_joint + boom.load_ratio * masses.carried
        return (masses.rotating + fraction * swinging) * self.crank_m / self.counterweight.radius_m


def slider_crank_constants(parameters: VibrationCrank) -> SliderCrank:
    """Return the constants of the kernels."""
    p = parameters
    kind = INFINITE_ROD if isinf(p.rod_m) else FINITE_ROD
    joint, load, arm = p.masses.reciprocating, 0.0, (0.0, 0.0, 1.0, 1.0, 1.0)
    if p.boom is not None:
        kind, joint, load = BOOM, p.masses.at_rod_joint, p.masses.carried
        side = 1.0 if p.boom.side == "left" else -1.0
        arm = (p.boom.pivot_x_m, p.boom.pivot_y_m, p.boom.length_m, p.boom.load_ratio, side)
    return SliderCrank(
        kind,
        p.crank_m,
        0.0 if isinf(p.rod_m) else p.rod_m,
        p.offset_m,
        1.0 if p.slider == "above" else -1.0,
        *arm,
        joint,
        load,
        p.masses.rotating,
        p.counterweight_kg,
        p.counterweight.radius_m,
        p.working_force_n,
        GRAVITY,
    )
