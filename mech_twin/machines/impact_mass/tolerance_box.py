# SPDX-License-Identifier: Apache-2.0
"""The worst case of a one-impact cycle over a box of tolerances of P1, P2, t1, T and R.

Every point of the box is a machine.  Its cycle must exist, be admissible and stable, and the required share of the
random starts must reach it.  Corners, middles of the faces and random points inside are tried.  From the slowest of
these a search climbs to slower points: a start that takes long to settle is near one that never does.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mech_twin.machines.impact_mass.cycle_verdict import BORDER, StartBox, basin
from mech_twin.machines.impact_mass.dynamics import PHASE_2, ImpactSystem, impact_system
from mech_twin.machines.impact_mass.impact_stop import LARGEST_RESTITUTION
from mech_twin.machines.impact_mass.metrics import admissible
from mech_twin.machines.impact_mass.one_impact_cycle import one_impact_cycle
from mech_twin.machines.impact_mass.parameters import ImpactMass

CLIMBS, CLIMB_STEPS = 6, 8  # points climbed from, steps of each
FIRST_REACH = 0.5  # of the box: the first step of a climb; it shrinks to nothing


class Deviation(NamedTuple):
    """Relative deviations of the box's quantities from their nominal values."""

    phase1_force: float
    phase2_force: float
    phase1_duration: float
    period: float
    restitution: float


NOMINAL = Deviation(0.0, 0.0, 0.0, 0.0, 0.0)


class PointOutcome(NamedTuple):
    """Result at one point of the box: margin, share of the starts that reach the cycle, periods of the slowest."""

    deviation: Deviation
    margin: float
    fraction: float
    slowest_periods: int


@dataclass(frozen=True)
class Certificate:
    """Points tried over the box, and the worst of them.

    ``tolerance`` is relative, of P1, P2, t1, T and R alike; every point was tried with ``starts`` random starts.
    ``tried`` counts the nominal point too.
    """

    tolerance: float
    corners: int
    faces: int
    inside: int
    climbed: int
    starts: int
    seed: int
    worst_fraction: float
    worst_margin: float
    worst_deviation: dict[str, float]
    slowest_periods: int
    tried: int


def deviated(parameters: ImpactMass, deviation: Deviation) -> ImpactSystem | None:
    """Return the constants of the motion at a point of the box, or None if t1 >= T or R leaves its range."""
    now, d = parameters.system, deviation
    times_s = (now.period_s * (1.0 + d.period), now.phase1_s * (1.0 + d.phase1_duration))
    restitution = now.restitution * (1.0 + d.restitution)
    if times_s[1] >= times_s[0] or restitution > LARGEST_RESTITUTION:
        return None
    accelerations = (now.acceleration1 * (1.0 + d.phase1_force), now.acceleration2 * (1.0 + d.phase2_force))
    return impact_system(times_s, accelerations, restitution, parameters.chatter_cutoff)


def outcome(parameters: ImpactMass, deviation: Deviation, starts: StartBox) -> PointOutcome:
    """Return the result at a point of the box; margin and share are 0 if it has no stable cycle off the border."""
    system = deviated(parameters, deviation)
    cycle = system and one_impact_cycle(system, int(PHASE_2))
    if system and cycle and BORDER < cycle.position_share < 1.0 - BORDER:
        largest = abs(cycle.multipliers[0])
        if largest < 1.0 and admissible(cycle, system):
            found = basin(system, cycle, starts)
            return PointOutcome(deviation, 1.0 - largest, found.fraction, found.slowest_periods)
    return PointOutcome(deviation, 0.0, 0.0, 0)


def corners(tolerance: float) -> list[Deviation]:
    """Return the 32 corners of the box."""
    return [Deviation(*signs) for signs in itertools.product((-tolerance, tolerance), repeat=len(NOMINAL))]


def faces(tolerance: float) -> list[Deviation]:
    """Return the middles of the 10 faces: one quantity off, the others nominal."""
    return [NOMINAL._replace(**{name: side}) for name in Deviation._fields for side in (-tolerance, tolerance)]


def inside(tolerance: float, count: int, seed: int) -> list[Deviation]:
    """Return uniform random points of the box from a seed."""
    random = np.random.default_rng(seed)
    return [Deviation(*row) for row in random.uniform(-tolerance, tolerance, (count, len(NOMINAL))).tolist()]


def climbed(
    parameters: ImpactMass, tolerance: float, tried: Sequence[PointOutcome], starts: StartBox
) -> list[PointOutcome]:
    """Return the points met when climbing from the slowest towards slower ones (or a smaller share), within the box."""
    random = np.random.default_rng(starts.seed + 1)
    met = []
    for begin in sorted(tried, key=_hardness, reverse=True)[:CLIMBS]:
        best = begin
        for step in range(CLIMB_STEPS):
            reach = FIRST_REACH * tolerance * (1.0 - step / CLIMB_STEPS)
            move = np.array(best.deviation) + random.uniform(-reach, reach, len(NOMINAL))
            found = outcome(parameters, Deviation(*np.clip(move, -tolerance, tolerance).tolist()), starts)
            met.append(found)
            best = max(best, found, key=_hardness)
    return met


def _hardness(point: PointOutcome) -> tuple[float, float]:
    return 1.0 - point.fraction, float(point.slowest_periods)


def certified(parameters: ImpactMass, tolerance: float, starts: StartBox, count: int) -> Certificate:
    """Return the certificate of the box: nominal point, corners, faces, ``count`` random points, and climbs."""
    points = corners(tolerance), faces(tolerance), inside(tolerance, count, starts.seed)
    at_corners, at_faces, at_inside = points if tolerance > 0.0 else ([], [], [])
    tried = [outcome(parameters, d, starts) for d in (NOMINAL, *at_corners, *at_faces, *at_inside)]
    met = climbed(parameters, tolerance, tried, starts) if tolerance > 0.0 else []
    worst = min([*tried, *met], key=lambda point: (point.fraction, point.margin))
    return Certificate(
        tolerance,
        len(at_corners),
        len(at_faces),
        len(at_inside),
        len(met),
        starts.starts,
        starts.seed,
        worst.fraction,
        min(point.margin for point in (*tried, *met)),
        worst.deviation._asdict(),
        max(point.slowest_periods for point in (*tried, *met)),
        len(tried) + len(met),
    )
