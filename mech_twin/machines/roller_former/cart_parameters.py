"""Carts of a roller former: geometry, masses, loads, and the table the kernels work on."""

from __future__ import annotations

from math import cos, radians, sin
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from mech_twin.quantity import Parameters, choice, quantity

LOADS = ("none", "reversing", "resist", "rectified", "printed")
NONE, REVERSING, RESIST, RECTIFIED, PRINTED = range(5)
OFFSET, COSINE, SINE, MASS, FORCE_X, FORCE_Y, WEIGHT, ABSOLUTE, PULL = range(9)

LoadKind = Literal["reversing", "rectified", "resist", "printed", "none"]
GuideFriction = Literal["signed", "rail_change"]
Kinematics = Literal["exact", "expanded"]
CartState = Literal["loaded", "empty", "missing"]


class CartParameters(Parameters):
    """Carts of one crank shaft, alike unless a list says otherwise (one entry per cart)."""

    count: int = quantity("1", "carts on the shaft", ge=1, le=12)
    offset_deg: float = quantity("deg", "crank angle of each cart ahead of the one before")
    crank_m: float = quantity("m", "crank radius r", gt=0.0)
    rod_m: float = quantity("m", "connecting rod length l", gt=0.0)
    mass_kg: float = quantity("kg", "mass of a cart without its half of the rod", ge=0.0)
    rod_mass_kg: float = quantity("kg", "mass of a rod, half of it at either end", ge=0.0)
    roller_force_x_n: float = quantity("N", "horizontal force of one roller on the mix, F01 = F02", ge=0.0, live=True)
    roller_force_y_n: float = quantity("N", "vertical force of the mix on one roller, R01 = R02", ge=0.0, live=True)
    weight_n: float = quantity("N", "weight of a cart with its half of the rod", ge=0.0, live=True)
    friction: float = quantity("1", "reduced friction of the guide rollers on their rails", ge=0.0, lt=0.5, live=True)
    guide_roller_m: float = quantity("m", "diameter of the guide rollers", gt=0.0)
    a_m: float = quantity("m", "half distance of the forming rollers", gt=0.0)
    b_m: float = quantity("m", "half distance of the guide rollers", gt=0.0)
    p_m: float = quantity("m", "distance of the cart's middle from the rod pin", ge=0.0)
    e_m: float = quantity("m", "height of the forming rollers' contact below the rod pin", ge=0.0)
    crank_inertia_kg_m2: float = quantity("kg m^2", "inertia of one crank about the shaft", ge=0.0, default=0.0)
    offsets_deg: list[float] | None = choice("crank angle of each cart, instead of offset_deg", default=None)
    masses_kg: list[float] | None = choice("mass of each cart (kg), instead of mass_kg; weights follow", default=None)
    states: list[CartState] | None = choice(
        "each cart: loaded; empty (no mix under its rollers: weight and friction only); missing (nor mass nor rod)",
        default=None,
    )

    @model_validator(mode="after")
    def _possible(self) -> CartParameters:
        if self.crank_m >= self.rod_m:
            raise ValueError(f"crank_m < rod_m needed for a full turn, got {self.crank_m} and {self.rod_m}")
        for key in ("offsets_deg", "masses_kg", "states"):
            entries = getattr(self, key)
            if entries is not None and len(entries) != self.count:
                raise ValueError(f"{key}: one entry per cart needed, got {len(entries)} for count {self.count}")
        if self.masses_kg is not None and min(self.masses_kg) < 0.0:
            raise ValueError(f"masses_kg >= 0 needed, got {min(self.masses_kg)}")
        if not np.all(np.isfinite(self.offsets_deg or [self.offset_deg])):
            raise ValueError("offsets_deg must be finite")
        if self.states is not None and all(state == "missing" for state in self.states):
            raise ValueError("states: at least one cart must not be missing")
        return self

    @property
    def offsets_rad(self) -> tuple[float, ...]:
        """Crank angle of each cart ahead of the shaft's (rad)."""
        degrees = self.offsets_deg or [i * self.offset_deg for i in range(self.count)]
        return tuple(radians(angle) for angle in degrees)

    @property
    def cart_states(self) -> tuple[CartState, ...]:
        """State of each cart."""
        loaded: CartState = "loaded"
        return tuple(self.states or [loaded] * self.count)


class CartBank(NamedTuple):
    """What the kernels need of all carts; ``carts`` is one row per cart.

    Columns: offset (rad), its cosine and sine, mass at the rod pin m_B (kg), F01 + F02 (N), R01 + R02 (N), weight (N),
    1 where guide friction is taken on the size of each reaction, and the numerator of (12), (N).
    """

    carts: NDArray[np.float64]
    crank_m: float
    rod_m: float
    ratio: float
    friction: float
    roller_radius_m: float
    a_m: float
    b_m: float
    p_m: float
    e_m: float
    crank_inertia_kg_m2: float
    rod_half_kg: float
    expanded: bool
    plain: bool
    load: int


def cart_bank(
    parameters: CartParameters, load: LoadKind, guide_friction: GuideFriction, kinematics: Kinematics
) -> CartBank:
    """Return the carts as the kernels want them.

    An empty cart has no roller forces; as its weight then presses the guide rollers on the other rail, its friction is
    always taken on the size of the reactions.  The weight of a cart of another mass follows its mass at the pin.
    """
    p = parameters
    rows = [
        _row(p, index, guide_friction) if state != "missing" else _missing(p.offsets_rad[index])
        for index, state in enumerate(p.cart_states)
    ]
    present = sum(state != "missing" for state in p.cart_states)
    rotating = p.count * p.crank_inertia_kg_m2 + present * 0.5 * p.rod_mass_kg * p.crank_m**2
    return CartBank(
        carts=np.array(rows, dtype=np.float64),
        crank_m=p.crank_m,
        rod_m=p.rod_m,
        ratio=p.crank_m / p.rod_m,
        friction=p.friction,
        roller_radius_m=0.5 * p.guide_roller_m,
        a_m=p.a_m,
        b_m=p.b_m,
        p_m=p.p_m,
        e_m=p.e_m,
        crank_inertia_kg_m2=rotating,
        rod_half_kg=0.5 * p.rod_mass_kg,
        expanded=kinematics == "expanded",
        plain=kinematics == "exact" and not any(row[ABSOLUTE] for row in rows),
        load=LOADS.index(load),
    )


def _row(p: CartParameters, index: int, guide_friction: GuideFriction) -> list[Any]:
    offset = p.offsets_rad[index]
    common = p.mass_kg + 0.5 * p.rod_mass_kg
    mass = (p.masses_kg[index] if p.masses_kg is not None else p.mass_kg) + 0.5 * p.rod_mass_kg
    weight = p.weight_n * (mass / common if common > 0.0 else 1.0)
    empty = p.cart_states[index] == "empty"
    force_x, force_y = (0.0, 0.0) if empty else (2.0 * p.roller_force_x_n, 2.0 * p.roller_force_y_n)
    absolute = 1.0 if empty or guide_friction == "rail_change" else 0.0
    pull = (force_y - weight) * p.friction + force_x
    return [offset, cos(offset), sin(offset), mass, force_x, force_y, weight, absolute, pull]


def _missing(offset: float) -> list[float]:
    return [offset, cos(offset), sin(offset), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
