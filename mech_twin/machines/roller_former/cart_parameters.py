# SPDX-License-Identifier: Apache-2.0
"""Carts of a roller former: geometry, masses, loads, and the constants of the kernels."""

from __future__ import annotations

from math import cos, pi, radians, sin, sqrt
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from mech_twin.declarations.configuration_tree import at_least
from mech_twin.declarations.quantity import Parameters, choice, quantity

LOADS = ("none", "reversing", "resist", "rectified", "printed")
NONE, REVERSING, RESIST, RECTIFIED, PRINTED = range(len(LOADS))
LARGEST_RATIO = 0.98  # of crank to rod: beyond it the rod stands across the travel and the cart's acceleration diverges

LoadKind = Literal["reversing", "rectified", "resist", "printed", "none"]
GuideFriction = Literal["signed", "rail_change"]
Kinematics = Literal["exact", "expanded"]
CartState = Literal["loaded", "empty", "missing"]


class CartParameters(Parameters):
    """Carts of one crank shaft, alike unless a list says otherwise (one entry per cart)."""

    count: int = quantity("1", "carts on the shaft", ge=1, le=12)
    offset_deg: float = quantity("deg", "crank angle of each cart ahead of the one before", ge=-360.0, le=360.0)
    crank_m: float = quantity("m", "crank radius r", ge=1e-3, le=10.0)
    rod_m: float = quantity("m", "connecting rod length l", ge=1e-3, le=100.0)
    mass_kg: float = quantity("kg", "mass of a cart without its half of the rod", ge=0.0, le=1e6)
    rod_mass_kg: float = quantity("kg", "mass of a rod, half of it at either end", ge=0.0, le=1e6)
    roller_force_x_n: float = quantity(
        "N", "horizontal force of one roller on the mix, F01 = F02", ge=0.0, le=1e8, live=True
    )
    roller_force_y_n: float = quantity(
        "N", "vertical force of the mix on one roller, R01 = R02", ge=0.0, le=1e8, live=True
    )
    weight_n: float = quantity("N", "weight of a cart with its half of the rod", ge=0.0, le=1e8, live=True)
    friction: float = quantity("1", "reduced friction of the guide rollers on their rails", ge=0.0, lt=0.5, live=True)
    guide_roller_m: float = quantity("m", "diameter of the guide rollers", ge=1e-3, le=10.0)
    a_m: float = quantity("m", "half distance of the forming rollers", ge=1e-3, le=100.0)
    b_m: float = quantity("m", "half distance of the guide rollers", ge=1e-3, le=100.0)
    p_m: float = quantity("m", "distance of the cart's middle from the rod pin", ge=0.0, le=100.0)
    e_m: float = quantity("m", "height of the forming rollers' contact below the rod pin", ge=0.0, le=100.0)
    crank_inertia_kg_m2: float = quantity("kg m^2", "inertia of one crank about the shaft", ge=0.0, le=1e6, default=0.0)
    gravity_m_per_s2: float = quantity(
        "m/s^2",
        "gravity on the rods' halves at the crank pins (the other halves are in weight_n); 0 as the source",
        ge=0.0,
        le=100.0,
        default=0.0,
    )
    offsets_deg: list[float] | None = choice("crank angle of each cart, instead of offset_deg", default=None)
    masses_kg: list[float] | None = choice("mass of each cart (kg), instead of mass_kg; weights follow", default=None)
    states: list[CartState] | None = choice(
        "each cart: loaded; empty (no mix under its rollers: weight and friction only); missing (nor mass nor rod)",
        default=None,
    )

    @model_validator(mode="after")
    def _possible(self) -> CartParameters:
        if self.crank_m > LARGEST_RATIO * self.rod_m:
            raise ValueError(
                f"crank_m <= {LARGEST_RATIO} rod_m needed for a full turn (the rod must not stand across the travel), "
                f"got {self.crank_m} and {self.rod_m}; try rod_m >= {at_least(self.crank_m / LARGEST_RATIO):g} m"
            )
        for key in ("offsets_deg", "masses_kg", "states"):
            entries = getattr(self, key)
            if entries is not None and len(entries) != self.count:
                raise ValueError(f"{key}: one entry per cart needed, got {len(entries)} for count {self.count}")
        if self.masses_kg is not None and not all(0.0 <= mass <= 1e6 for mass in self.masses_kg):
            raise ValueError(f"masses_kg: 0 to 1e6 kg needed, got {self.masses_kg}")
        if not all(abs(angle) <= 3600.0 for angle in self.offsets_deg or []):
            raise ValueError(f"offsets_deg: -3600 to 3600 deg needed, got {self.offsets_deg}")
        if self.states is not None and all(state == "missing" for state in self.states):
            raise ValueError(f"states: at least 1 cart must be there, loaded or empty; got {self.states}")
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

    def weight_of(self, cart: int) -> float:
        """Weight of one cart (N); for a cart of its own mass it follows from its mass at the pin."""
        common = self.mass_kg + 0.5 * self.rod_mass_kg
        return self.weight_n * (self.pin_mass_of(cart) / common if common > 0.0 else 1.0)

    def pin_mass_of(self, cart: int) -> float:
        """Mass of one cart with its half of the rod, m_B (kg)."""
        return (self.masses_kg[cart] if self.masses_kg is not None else self.mass_kg) + 0.5 * self.rod_mass_kg


class CartBank(NamedTuple):
    """Kernel constants of all carts; the arrays have one entry per cart.

    ``force_x_n`` and ``force_y_n`` are F01 + F02 and R01 + R02.  ``on_either_rail``: guide friction is proportional to
    the magnitude of each reaction.  ``pull_n`` is the numerator of (12).  ``rod_weight_cosine_nm`` and ``_sine_nm``
    give the moment of the rods' halves at the crank pins, ``cosine_nm cos phi2 - sine_nm sin phi2``.
    """

    offset_rad: NDArray[np.float64]
    offset_cosine: NDArray[np.float64]
    offset_sine: NDArray[np.float64]
    mass_kg: NDArray[np.float64]
    force_x_n: NDArray[np.float64]
    force_y_n: NDArray[np.float64]
    weight_n: NDArray[np.float64]
    on_either_rail: NDArray[np.bool_]
    pull_n: NDArray[np.float64]
    rod_half_kg: NDArray[np.float64]
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
    gravity_m_per_s2: float
    rod_weight_cosine_nm: float
    rod_weight_sine_nm: float
    expanded: bool
    plain: bool
    load: int


def check_guides(parameters: CartParameters, load: LoadKind, guide_friction: GuideFriction) -> None:
    """Raise for guides whose friction would drive the carts, or that are self-locking.

    With ``signed`` friction (12) drives where ``(R01 + R02 - G) f + F01 + F02 < 0``.  Guides lock where the friction
    due to the rod's side force exceeds the rod's pull along the travel, however large that is:
    ``f tan beta >= 1`` for signed friction, ``f tan beta max(1, (p + f d/2)/b) >= 1`` for friction by the magnitude of
    each reaction.

    Raises
    ------
    ValueError
        With the inequality and the numbers that break it.
    """
    p = parameters
    if load == "none":
        return
    ratio = p.crank_m / p.rod_m
    tangent = ratio / sqrt(1.0 - ratio * ratio)
    for cart, state in enumerate(p.cart_states):
        if state == "missing":
            continue
        signed = guide_friction == "signed" and state == "loaded"
        weight = p.weight_of(cart)
        pull = (2.0 * p.roller_force_y_n - weight) * p.friction + 2.0 * p.roller_force_x_n
        if signed and pull < 0.0:
            raise ValueError(
                f"(2 roller_force_y_n - weight_n) friction + 2 roller_force_x_n >= 0 needed, got {pull:.6g} N for cart "
                f"{cart + 1} (weight {weight:.6g} N): signed guide friction would drive it; "
                "guide_friction: rail_change opposes the travel"
            )
        overhang = 1.0 if signed else max(1.0, (p.p_m + 0.5 * p.friction * p.guide_roller_m) / p.b_m)
        if p.friction * tangent * overhang >= 1.0:
            raise ValueError(
                f"the guides lock themselves: friction {p.friction:g} times tan beta {tangent:.4g} times "
                f"max(1, (p_m + friction guide_roller_m/2)/b_m) {overhang:.4g} must be below 1"
            )


def cart_bank(
    parameters: CartParameters, load: LoadKind, guide_friction: GuideFriction, kinematics: Kinematics
) -> CartBank:
    """Return the kernel constants of the carts.

    An empty cart has no roller forces.  Its weight then presses the guide rollers on the other rail, so its friction
    is always by the magnitude of the reactions.
    """
    p = parameters
    carts = range(p.count)
    present = np.array([state != "missing" for state in p.cart_states])
    rolling = np.array([state == "loaded" for state in p.cart_states])
    offsets = np.array(p.offsets_rad)
    force_x = np.where(rolling, 2.0 * p.roller_force_x_n, 0.0)
    force_y = np.where(rolling, 2.0 * p.roller_force_y_n, 0.0)
    weight = np.where(present, [p.weight_of(cart) for cart in carts], 0.0)
    either_rail = present & (~rolling | (guide_friction == "rail_change"))
    halves = np.where(present, 0.5 * p.rod_mass_kg, 0.0)
    cosines = np.array([cos(offset) for offset in p.offsets_rad])
    sines = np.array([sin(offset) for offset in p.offsets_rad])
    rod_moments = halves * p.gravity_m_per_s2 * p.crank_m
    return CartBank(
        offset_rad=offsets,
        offset_cosine=cosines,
        offset_sine=sines,
        mass_kg=np.where(present, [p.pin_mass_of(cart) for cart in carts], 0.0),
        force_x_n=force_x,
        force_y_n=force_y,
        weight_n=weight,
        on_either_rail=either_rail,
        pull_n=(force_y - weight) * p.friction + force_x,
        rod_half_kg=halves,
        crank_m=p.crank_m,
        rod_m=p.rod_m,
        ratio=p.crank_m / p.rod_m,
        friction=p.friction,
        roller_radius_m=0.5 * p.guide_roller_m,
        a_m=p.a_m,
        b_m=p.b_m,
        p_m=p.p_m,
        e_m=p.e_m,
        crank_inertia_kg_m2=p.count * p.crank_inertia_kg_m2 + int(present.sum()) * 0.5 * p.rod_mass_kg * p.crank_m**2,
        gravity_m_per_s2=p.gravity_m_per_s2,
        rod_weight_cosine_nm=float(rod_moments @ cosines),
        rod_weight_sine_nm=float(rod_moments @ sines),
        expanded=kinematics == "expanded",
        plain=kinematics == "exact" and not bool(either_rail.any()),
        load=LOADS.index(load),
    )


def inertia_range_kg_m2(bank: CartBank) -> tuple[float, float]:
    """Return minimum and maximum over a turn of the reduced inertia J_p2 of crank shaft and carts (kg m^2)."""
    angles = np.concatenate([np.linspace(0.0, 2.0 * pi, 720, endpoint=False), -bank.offset_rad, pi - bank.offset_rad])
    psi = angles[:, None] + bank.offset_rad
    sine, cosine = np.sin(psi), np.cos(psi)
    secant = 1.0 if bank.expanded else 1.0 / np.sqrt(1.0 - (bank.ratio * sine) ** 2)
    travel = bank.crank_m * sine * (1.0 + bank.ratio * cosine * secant)
    inertia = bank.crank_inertia_kg_m2 + travel**2 @ bank.mass_kg
    return float(inertia.min()), float(inertia.max())
