# SPDX-License-Identifier: Apache-2.0
"""The linkage as a mechanism of the crank linkage: its state, what is reduced to its crank, its load."""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.engine.compiled_steps import step_of
from mech_twin.engine.crank_state import (
    mechanism_drive_moment,
    mechanism_load_speed,
    mechanism_load_work,
    mechanism_reduced,
    mechanism_state,
    under_load_share,
)
from mech_twin.machines.planar_linkage.chain import CRANK, Array, chain_motion, closure_error
from mech_twin.machines.planar_linkage.linkage import (
    PlanarLinkage,
    WorkingStroke,
    continued,
    is_working,
    potential_at,
    reduced,
    reduced_at,
    stroke_point,
    stroke_work,
)
from mech_twin.machines.planar_linkage.pins import pin_forces


class TurnedLinkage(NamedTuple):
    """The mechanism of the linkage role."""

    chain: PlanarLinkage


@step_of(mechanism_state, TurnedLinkage)
def linkage_state(
    mechanism: TurnedLinkage, f: float, w: float, e: float, regime: int
) -> tuple[Array, Array, float, float, float]:
    """Return coordinates and rates of the links, crank torque (N m), energy (J), worst miss of a link's end (m)."""
    p = mechanism.chain
    m, travel = chain_motion(p.dyads, f)
    now = reduced_at(p, m, regime)
    torque = now.inertia * e + 0.5 * w * w * now.slope - now.moment
    energy = 0.5 * now.inertia * w * w + potential_at(p, m)
    return continued(p, f, travel), travel.rate[CRANK:] * w, torque, energy, closure_error(p.dyads, m, travel)


@step_of(mechanism_load_work, TurnedLinkage)
def linkage_load_work(mechanism: TurnedLinkage, before: float, after: float, regime: int) -> float:
    """Return the work (J) of the working stroke's force on the way from one crank angle (rad) to another."""
    return stroke_work(mechanism.chain, before, after) if is_working(regime) else 0.0


@step_of(mechanism_load_speed, TurnedLinkage)
def linkage_load_speed(mechanism: TurnedLinkage, f: float, w: float) -> float:
    """Return the speed of the tool along its stroke (m/s)."""
    p = mechanism.chain
    return stroke_point(p, chain_motion(p.dyads, f)[0])[1] * w


@step_of(mechanism_drive_moment, TurnedLinkage)
def linkage_drive_moment(mechanism: TurnedLinkage, f: float, w: float, e: float, regime: int) -> float:
    """Return the moment (N m) at the crank that the pin forces give."""
    return pin_forces(mechanism.chain, f, w, e, regime).drive_nm


@step_of(mechanism_reduced, TurnedLinkage)
def linkage_reduced(mechanism: TurnedLinkage, f: float, regime: int) -> tuple[float, float, float]:
    """Return inertia (kg m2), its slope (kg m2/rad) and moment (N m) reduced to the crank."""
    now = reduced(mechanism.chain, f, regime)
    return now.inertia, now.slope, now.moment


@step_of(under_load_share, TurnedLinkage)
def with_load_share(mechanism: TurnedLinkage, share: float) -> TurnedLinkage:
    """Return the linkage under this share of the working stroke's force."""
    p = mechanism.chain
    s = p.stroke
    stroke = WorkingStroke(s.link, s.along_m, s.across_m, s.direction_x, s.direction_y, share * s.force_n)
    return TurnedLinkage(PlanarLinkage(p.dyads, p.masses, p.loads, p.springs, stroke, p.turning, p.gravity))
