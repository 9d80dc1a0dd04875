# SPDX-License-Identifier: Apache-2.0
"""The linkage with its masses and loads: reduced inertia and moment, energy, the working stroke."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mech_twin.kernel import kernel
from mech_twin.machines.planar_linkage.chain import (
    CRANK,
    TURN,
    Array,
    ChainMotion,
    Dyads,
    LinkPoint,
    Places,
    Travel,
    chain_motion,
    on_link,
)

IDLE, WORKING, WORKING_REVERSED, DONE, DONE_REVERSED = 0, 1, 2, 3, 4
REGIMES = ("idle", "working", "working_reversed", "done", "done_reversed")


class LinkMasses(NamedTuple):
    """Of every link, shape (links,): mass (kg), inertia about its centre (kg m2), centre in its frame (m)."""

    mass_kg: Array
    inertia_kg_m2: Array
    along_m: Array
    across_m: Array


class Loads(NamedTuple):
    """Forces that stay as they are: link, point in its frame (m), force in the machine's frame (N); shape (loads,)."""

    link: Places
    along_m: Array
    across_m: Array
    force_x_n: Array
    force_y_n: Array


class Springs(NamedTuple):
    """Springs to the ground: link, point in its frame, end on the ground (m), rate (N/m), length unloaded (m)."""

    link: Places
    along_m: Array
    across_m: Array
    ground_x_m: Array
    ground_y_m: Array
    rate_n_per_m: Array
    free_m: Array


class WorkingStroke(NamedTuple):
    """Force (N) against a point of a link (m, in its frame) on its way along a direction (a unit vector)."""

    link: int
    along_m: float
    across_m: float
    direction_x: float
    direction_y: float
    force_n: float


class Turning(NamedTuple):
    """Coordinates over one turn, shape (entries, links), the last entry a turn after the first: which turn they are in.

    ``turns`` (links,) tells whether a coordinate is an angle.
    """

    coordinates: Array
    turns: Array


class PlanarLinkage(NamedTuple):
    """Constants of the mechanism (SI)."""

    dyads: Dyads
    masses: LinkMasses
    loads: Loads
    springs: Springs
    stroke: WorkingStroke
    turning: Turning
    gravity: float


class ReducedLinkage(NamedTuple):
    """At one crank angle: inertia (kg m2), its slope (kg m2/rad), moment of weights and loads (N m) on the crank."""

    inertia: float
    slope: float
    moment: float


@kernel
def is_working(regime: int) -> bool:
    """Tell whether the force of the working stroke acts in a regime."""
    return regime in (WORKING, WORKING_REVERSED)


@kernel
def stretched(springs: Springs, i: int, at: LinkPoint) -> tuple[float, float, float]:
    """Return a spring's length less the unloaded one (m), and the unit vector from its end on the ground."""
    x, y = at.x - springs.ground_x_m[i], at.y - springs.ground_y_m[i]
    length = math.hypot(x, y)
    if length == 0.0:
        return -springs.free_m[i], 0.0, 0.0
    return length - springs.free_m[i], x / length, y / length


@kernel
def stroke_point(p: PlanarLinkage, m: ChainMotion) -> tuple[float, float]:
    """Return how far the loaded point is along the direction of its stroke (m), and the derivative."""
    stroke = p.stroke
    at = on_link(m, stroke.link, stroke.along_m, stroke.across_m)
    way = stroke.direction_x * at.x + stroke.direction_y * at.y
    return way, stroke.direction_x * at.x1 + stroke.direction_y * at.y1


@kernel
def reduced_at(p: PlanarLinkage, m: ChainMotion, regime: int) -> ReducedLinkage:
    """Return inertia and moment reduced to the crank.

    I = sum of m (x'^2 + y'^2) + J t'^2;  M = sum of F . p' of weights, loads, springs and the working stroke.
    """
    inertia = slope = moment = 0.0
    for link in range(CRANK, len(p.masses.mass_kg)):
        mass, own = p.masses.mass_kg[link], p.masses.inertia_kg_m2[link]
        at = on_link(m, link, p.masses.along_m[link], p.masses.across_m[link])
        inertia += mass * (at.x1 * at.x1 + at.y1 * at.y1) + own * m.angle1[link] ** 2
        slope += 2.0 * (mass * (at.x1 * at.x2 + at.y1 * at.y2) + own * m.angle1[link] * m.angle2[link])
        moment -= mass * p.gravity * at.y1
    for i in range(len(p.loads.link)):
        at = on_link(m, p.loads.link[i], p.loads.along_m[i], p.loads.across_m[i])
        moment += p.loads.force_x_n[i] * at.x1 + p.loads.force_y_n[i] * at.y1
    for i in range(len(p.springs.link)):
        at = on_link(m, p.springs.link[i], p.springs.along_m[i], p.springs.across_m[i])
        longer, u_x, u_y = stretched(p.springs, i, at)
        moment -= p.springs.rate_n_per_m[i] * longer * (u_x * at.x1 + u_y * at.y1)
    if is_working(regime):
        moment -= p.stroke.force_n * stroke_point(p, m)[1]
    return ReducedLinkage(inertia, slope, moment)


@kernel
def reduced(p: PlanarLinkage, f: float, regime: int) -> ReducedLinkage:
    """Return inertia and moment reduced to the crank at its angle (rad)."""
    return reduced_at(p, chain_motion(p.dyads, f)[0], regime)


@kernel
def potential_at(p: PlanarLinkage, m: ChainMotion) -> float:
    """Return the potential of weights, loads and springs (J); the working stroke has none."""
    held = 0.0
    for link in range(CRANK, len(p.masses.mass_kg)):
        at = on_link(m, link, p.masses.along_m[link], p.masses.across_m[link])
        held += p.masses.mass_kg[link] * p.gravity * at.y
    for i in range(len(p.loads.link)):
        at = on_link(m, p.loads.link[i], p.loads.along_m[i], p.loads.across_m[i])
        held -= p.loads.force_x_n[i] * at.x + p.loads.force_y_n[i] * at.y
    for i in range(len(p.springs.link)):
        at = on_link(m, p.springs.link[i], p.springs.along_m[i], p.springs.across_m[i])
        longer, _, _ = stretched(p.springs, i, at)
        held += 0.5 * p.springs.rate_n_per_m[i] * longer * longer
    return held


@kernel
def drive_moment(p: PlanarLinkage, f: float, w: float, e: float, regime: int) -> float:
    """Return the torque at the crank (N m): I e + w^2/2 dI/df - M."""
    at = reduced(p, f, regime)
    return at.inertia * e + 0.5 * w * w * at.slope - at.moment


@kernel
def continued(p: PlanarLinkage, f: float, travel: Travel) -> Array:
    """Return the coordinates of the links from the crank on, angles counted on from turn to turn (rad, m).

    A link that turns with the crank goes on at its next turn; a table of one turn says in which turn an angle is.
    """
    t = p.turning
    entries = len(t.coordinates) - 1
    turns = math.floor(f / TURN)
    place = min(max((f / TURN - turns) * entries, 0.0), float(entries))
    i = min(int(place), entries - 1)
    out = travel.position[CRANK:].copy()
    out[0] = f
    for link in range(CRANK + 1, len(travel.position)):
        if t.turns[link] == 0.0:
            continue
        low, high = t.coordinates[i, link], t.coordinates[i + 1, link]
        near = low + (place - i) * (high - low) + turns * (t.coordinates[entries, link] - t.coordinates[0, link])
        out[link - CRANK] += TURN * math.floor((near - travel.position[link]) / TURN + 0.5)
    return out


@kernel
def stroke_rates(p: PlanarLinkage, angles: Array) -> Array:
    """Return the derivative (m) of the loaded point's way along its stroke at crank angles (rad)."""
    out = np.empty(len(angles))
    for i in range(len(angles)):
        out[i] = stroke_point(p, chain_motion(p.dyads, angles[i])[0])[1]
    return out


@kernel
def stroke_work(p: PlanarLinkage, before: float, after: float) -> float:
    """Return the work (J) of the working stroke's force on the way from one crank angle (rad) to another."""
    start, _ = stroke_point(p, chain_motion(p.dyads, before)[0])
    end, _ = stroke_point(p, chain_motion(p.dyads, after)[0])
    return -p.stroke.force_n * (end - start)
