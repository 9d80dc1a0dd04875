# SPDX-License-Identifier: Apache-2.0
r"""Masses of a crank vibration mechanism, and the counterweight that balances part of them.

::

        | slider: m_s = tree + stand + boom/2 + rod/2 + extra            (reciprocating)
        o
         \  rod                           m_r = rod/2 + crank + pin + bearing + lever, at the crank radius r
          \
           o  m_r at r, angle th          m_p = (m_r + kappa m_s) r/r_p, at r_p, angle th + 180 degrees
          /
         + crank bearing                   volume = m_p/density
        /
       # m_p at r_p
"""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.declarations.quantity import Parameters, quantity


class MovingMasses(Parameters):
    """Masses of the parts; ``rotating_kg`` overrides the sum of the rotating ones."""

    tree_kg: float = quantity("kg", "held tree", ge=0.0, le=1e6)
    stand_kg: float = quantity("kg", "stand of the gripping-cutting device", ge=0.0, le=1e6)
    boom_kg: float = quantity("kg", "boom; half of it reciprocates", ge=0.0, le=1e6)
    rod_kg: float = quantity("kg", "connecting rod; half of it reciprocates, half of it turns", ge=0.0, le=1e6)
    extra_kg: float = quantity("kg", "further reciprocating mass", ge=0.0, le=1e6)
    crank_kg: float = quantity("kg", "crank", ge=0.0, le=1e6)
    pin_kg: float = quantity("kg", "crank pin", ge=0.0, le=1e6)
    bearing_kg: float = quantity("kg", "bearing", ge=0.0, le=1e6)
    lever_kg: float = quantity("kg", "lever", ge=0.0, le=1e6)
    rotating_kg: float | None = quantity(
        "kg", "rotating mass at the crank pin (derived if absent)", default=None, ge=0.0, le=1e6
    )

    @property
    def reciprocating(self) -> float:
        """Reciprocating mass m_s (kg)."""
        return self.tree_kg + self.stand_kg + 0.5 * self.boom_kg + 0.5 * self.rod_kg + self.extra_kg

    @property
    def rotating_from_parts(self) -> float:
        """Rotating mass m_r as the parts add up (kg)."""
        return 0.5 * self.rod_kg + self.crank_kg + self.pin_kg + self.bearing_kg + self.lever_kg

    @property
    def rotating(self) -> float:
        """Rotating mass m_r in force (kg)."""
        return self.rotating_from_parts if self.rotating_kg is None else self.rotating_kg

    @property
    def at_rod_joint(self) -> float:
        """Mass m_j at the joint of rod and boom, where the boom is a rocker (kg)."""
        return 0.5 * self.boom_kg + 0.5 * self.rod_kg + self.extra_kg

    @property
    def carried(self) -> float:
        """Mass m_t that the boom carries, where it is a rocker (kg)."""
        return self.tree_kg + self.stand_kg


class Counterweight(Parameters):
    """Counterweight on the crank, opposite to the crank pin; ``mass_kg`` overrides the derived mass."""

    radius_m: float = quantity("m", "radius r_p of its centroid", ge=1e-3, le=10.0)
    balancing_fraction: float = quantity("1", "share kappa of the reciprocating mass it balances", ge=0.0, le=1.0)
    mass_kg: float | None = quantity("kg", "mass m_p (derived if absent)", default=None, ge=0.0, le=1e6)
    density_kg_per_m3: float = quantity("kg/m3", "density", ge=1.0, le=1e5)


class Balance(NamedTuple):
    """Masses in force: reciprocating, rotating, counterweight (kg), and the counterweight's volume (m3)."""

    reciprocating_kg: float
    rotating_kg: float
    counterweight_kg: float
    volume_m3: float


def derived_counterweight(rotating: float, reciprocating: float, fraction: float, crank: float, radius: float) -> float:
    """Return m_p = (m_r + kappa m_s) r/r_p (kg)."""
    return (rotating + fraction * reciprocating) * crank / radius


def balanced_mass(masses: MovingMasses, load_ratio: float | None) -> float:
    """Return the mass (kg) whose force at the crank pin the counterweight balances in part: m_s, or m_j + kb m_t.

    The load of a boom moves by ``load_ratio`` kb times the travel of the rod's joint, and so does its inertia force.
    """
    if load_ratio is None:
        return masses.reciprocating
    return masses.at_rod_joint + load_ratio * masses.carried


def balance(
    masses: MovingMasses, counterweight: Counterweight, crank_m: float, load_ratio: float | None = None
) -> Balance:
    """Return the masses in force; ``load_ratio`` is that of a boom."""
    mass = counterweight.mass_kg
    if mass is None:
        swinging, fraction = balanced_mass(masses, load_ratio), counterweight.balancing_fraction
        mass = derived_counterweight(masses.rotating, swinging, fraction, crank_m, counterweight.radius_m)
    return Balance(masses.reciprocating, masses.rotating, mass, mass / counterweight.density_kg_per_m3)
