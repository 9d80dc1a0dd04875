# SPDX-License-Identifier: Apache-2.0
"""Constants of the kernels from the parameters, and whether the crank makes a full turn."""

from __future__ import annotations

from collections.abc import Sequence
from math import asin, cos, degrees, isnan, nan, radians, sin
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from mech_twin.machines.planar_linkage.chain import (
    CRANK,
    RPR,
    RRP,
    RRR,
    TURN,
    Array,
    Dyads,
    Places,
    coordinates,
    transmissions,
)
from mech_twin.machines.planar_linkage.linkage import (
    LinkMasses,
    Loads,
    PlanarLinkage,
    Springs,
    Turning,
    WorkingStroke,
)

if TYPE_CHECKING:
    from mech_twin.machines.planar_linkage.parameters import Dyad, PlanarLinkageParameters

KINDS = {"rrr": RRR, "rrp": RRP, "rpr": RPR}
POSITIONS = 720  # of a turn, at which the assembly is looked at
LEAST_TRANSMISSION_DEG = 1.0
LEAST_BAR_SHARE = 0.01  # of the largest distance between block and pivot of a bar
NO_STROKE = WorkingStroke(CRANK, 0.0, 0.0, 1.0, 0.0, 0.0)


def _floats(values: Sequence[float]) -> Array:
    return np.array(values, dtype=np.float64)


def _places(values: Sequence[int]) -> Places:
    return np.array(values, dtype=np.int64)


def chain_dyads(p: PlanarLinkageParameters) -> Dyads:
    """Return the dyads for the kernels."""
    dyads, place = list(p.dyads.values()), p.links.index

    def start(dyad: Dyad) -> float:
        return p.length_m(dyad.from_link) if dyad.from_x_m is None else dyad.from_x_m

    return Dyads(
        _places([KINDS[dyad.kind] for dyad in dyads]),
        _places([place(dyad.from_link) for dyad in dyads]),
        _floats([start(dyad) for dyad in dyads]),
        _floats([dyad.from_y_m for dyad in dyads]),
        _places([place(dyad.to_link) for dyad in dyads]),
        _floats([dyad.to_x_m for dyad in dyads]),
        _floats([dyad.to_y_m for dyad in dyads]),
        _floats([dyad.first_m or 0.0 for dyad in dyads]),
        _floats([dyad.second_m or 0.0 for dyad in dyads]),
        _floats([radians(dyad.guide_deg) for dyad in dyads]),
        _floats([1.0 if dyad.branch == "plus" else -1.0 for dyad in dyads]),
    )


def turn_angles(count: int = POSITIONS) -> Array:
    """Return ``count`` + 1 crank angles (rad) over a turn, both ends."""
    return np.asarray(np.linspace(0.0, TURN, count + 1), dtype=np.float64)


def least_transmission(dyads: Dyads, k: int) -> tuple[float, float]:
    """Return the least `transmission` of a dyad over a turn and the crank angle (rad) where it is.

    nan where it cannot be assembled; the worst of 720 positions, refined between its neighbours.
    """
    angles = turn_angles()
    found = transmissions(dyads, k, angles)
    if np.isnan(found).any():
        return nan, float(angles[np.isnan(found).argmax()])
    worst = int(found.argmin())

    def at(angle: float) -> float:
        value = float(transmissions(dyads, k, _floats([angle]))[0])
        return -1.0 if isnan(value) else value

    step = TURN / POSITIONS
    bounds = (angles[worst] - step, angles[worst] + step)
    best = minimize_scalar(at, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    if best.fun < 0.0:
        return nan, float(best.x)
    return (float(best.fun), float(best.x)) if best.fun < found[worst] else (float(found[worst]), float(angles[worst]))


def check_turn(p: PlanarLinkageParameters) -> None:
    """Refuse a linkage whose crank cannot make a full turn, or nearly jams in it.

    Raises
    ------
    ValueError
        Naming the dyad, its sizes and the crank angle.
    """
    dyads = chain_dyads(p)
    for k, (key, dyad) in enumerate(p.dyads.items()):
        least, angle = least_transmission(dyads, k)
        where = f"at a crank angle of {degrees(angle) % 360.0:.4g} degrees"
        if isnan(least):
            raise ValueError(f"{key}: the crank cannot make a full turn: {where} {_out_of_reach(dyad)}")
        if dyad.kind == "rpr":
            longest = float(transmissions(dyads, k, turn_angles()).max())
            if least < LEAST_BAR_SHARE * longest:
                raise ValueError(
                    f"{key}: {where} the block comes within {least:.3g} m of the bar's pivot; expected at least "
                    f"{LEAST_BAR_SHARE * longest:.3g} m, {LEAST_BAR_SHARE:g} of the most: move to_x_m, to_y_m"
                )
        elif least < sin(radians(LEAST_TRANSMISSION_DEG)):
            raise ValueError(
                f"{key}: {where} its transmission angle is {degrees(asin(least)):.3g} degrees; expected at least "
                f"{LEAST_TRANSMISSION_DEG:g} all round: the dyad nearly jams"
            )


def _out_of_reach(dyad: Dyad) -> str:
    if dyad.kind == "rrp":
        return f"first_m = {dyad.first_m:g} m does not reach the guide: make it longer, or bring the guide nearer"
    return (
        f"the links first_m = {dyad.first_m:g} m and second_m = {dyad.second_m:g} m do not meet: "
        "change them, or to_x_m and to_y_m"
    )


def mechanism_constants(p: PlanarLinkageParameters) -> PlanarLinkage:
    """Return the constants of the kernels."""
    dyads, place = chain_dyads(p), p.links.index
    return PlanarLinkage(
        dyads,
        _masses(p),
        Loads(
            _places([place(load.link) for load in p.loads]),
            _floats([load.x_m for load in p.loads]),
            _floats([load.y_m for load in p.loads]),
            _floats([load.force_x_n for load in p.loads]),
            _floats([load.force_y_n for load in p.loads]),
        ),
        Springs(
            _places([place(spring.link) for spring in p.springs]),
            _floats([spring.x_m for spring in p.springs]),
            _floats([spring.y_m for spring in p.springs]),
            _floats([spring.ground_x_m for spring in p.springs]),
            _floats([spring.ground_y_m for spring in p.springs]),
            _floats([spring.rate_n_per_m for spring in p.springs]),
            _floats([spring.free_m for spring in p.springs]),
        ),
        _stroke(p),
        _turning(dyads),
        p.gravity_m_per_s2,
    )


def _masses(p: PlanarLinkageParameters) -> LinkMasses:
    rows = [(0.0, 0.0, 0.0, 0.0)]
    for link, of in p.masses.items():
        own = (0.0, 0.0, 0.0, 0.0) if of is None else (of.mass_kg, of.inertia_kg_m2, of.centre_x_m, of.centre_y_m)
        extra = p.crank.flywheel_kg_m2 if link == "crank" else 0.0
        rows.append((own[0], own[1] + extra, own[2], own[3]))
    table = _floats([number for row in rows for number in row]).reshape(-1, 4)
    return LinkMasses(*(np.ascontiguousarray(column) for column in table.T))


def _stroke(p: PlanarLinkageParameters) -> WorkingStroke:
    if p.working_stroke is None:
        return NO_STROKE
    s, angle = p.working_stroke, radians(p.working_stroke.direction_deg)
    return WorkingStroke(p.links.index(s.link), s.x_m, s.y_m, cos(angle), sin(angle), s.force_n)


def _turning(dyads: Dyads) -> Turning:
    """Return the coordinates over one turn, angles continued, and which coordinates are angles."""
    table = coordinates(dyads, turn_angles())
    turns = np.ones(table.shape[1])
    for k, kind in enumerate(dyads.kind):
        if kind == RRP:
            turns[3 + 2 * k] = 0.0
        elif kind == RPR:
            turns[2 + 2 * k] = 0.0
    angles = turns > 0.0
    table[:, angles] = np.unwrap(table[:, angles], axis=0)
    return Turning(np.ascontiguousarray(table), turns)
