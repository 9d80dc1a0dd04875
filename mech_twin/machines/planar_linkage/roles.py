# SPDX-License-Identifier: Apache-2.0
"""Where the working stroke begins and ends along the crank's turn, and the linkage role."""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from mech_twin.engine.crank_linkage import CrankLinkage
from mech_twin.engine.crank_state import Boundary, Resisting
from mech_twin.machines.planar_linkage.assembly import mechanism_constants
from mech_twin.machines.planar_linkage.chain import TURN, Array
from mech_twin.machines.planar_linkage.dynamics import TurnedLinkage
from mech_twin.machines.planar_linkage.linkage import (
    DONE,
    DONE_REVERSED,
    IDLE,
    REGIMES,
    WORKING,
    WORKING_REVERSED,
    PlanarLinkage,
    stroke_rates,
)
from mech_twin.machines.planar_linkage.parameters import PlanarLinkageParameters

LOOKED_AT = 1440
FIRST_RAD = 1.234e-4  # of the positions looked at: a dead centre at a round angle lies between two of them
ON_ZERO = 1e-9  # rad: a dead centre this near to 0 is there
SET_STROKE = {WORKING: Resisting(1.0, DONE), WORKING_REVERSED: Resisting(-1.0, DONE_REVERSED)}


class DeadCentres(NamedTuple):
    """Crank angles (rad) where the tool turns round: those from which it goes forward, those where it ends that."""

    rear: tuple[float, ...]
    front: tuple[float, ...]


def dead_centres(chain: PlanarLinkage) -> DeadCentres:
    """Return the dead centres of the tool, for a crank that turns counter-clockwise."""
    angles = FIRST_RAD + np.linspace(0.0, TURN, LOOKED_AT + 1)
    rates = stroke_rates(chain, angles)
    rear: list[float] = []
    front: list[float] = []
    for i in np.flatnonzero(rates[:-1] * rates[1:] < 0.0):
        root = float(brentq(lambda f: _rate(chain, f), angles[i], angles[i + 1], xtol=1e-14)) % TURN
        root = 0.0 if min(root, TURN - root) < ON_ZERO else root
        (rear if rates[i] < 0.0 else front).append(root)
    return DeadCentres(tuple(rear), tuple(front))


def _rate(chain: PlanarLinkage, angle: float) -> float:
    return float(stroke_rates(chain, np.array([angle]))[0])


def regimes_at(chain: PlanarLinkage, angles: Array, sense: float) -> Array:
    """Return the regime at crank angles (rad) in steady turning of this sense."""
    forward = sense * stroke_rates(chain, angles) > 0.0
    return np.where(forward, WORKING if sense > 0.0 else WORKING_REVERSED, IDLE)


def stroke_boundaries(at: DeadCentres) -> tuple[Boundary, ...]:
    """Return where the regime changes: new material is met at the rear dead centre only.

    A tool that turns back has nothing against it until it is again where it turned, or at a dead centre.
    """
    found: list[Boundary] = []
    for rear in at.rear:
        found += [Boundary(rear, 1.0, before, WORKING, "stroke_begins") for before in (IDLE, DONE_REVERSED)]
        found += [Boundary(rear, -1.0, before, WORKING_REVERSED, "stroke_begins") for before in (IDLE, DONE)]
    for front in at.front:
        found.append(Boundary(front, 1.0, WORKING, IDLE, "stroke_ends"))
        found.append(Boundary(front, -1.0, WORKING_REVERSED, IDLE, "stroke_ends"))
    found.append(Boundary(nan, 1.0, DONE, WORKING, "stroke_resumes"))
    found.append(Boundary(nan, -1.0, DONE_REVERSED, WORKING_REVERSED, "stroke_resumes"))
    return tuple(found)


def planar_linkage_role(p: PlanarLinkageParameters, chain: PlanarLinkage) -> CrankLinkage:
    """Return the linkage role of a configuration, its crank at angle 0."""
    speed, command = p.start_speed_and_command()
    _, transmission = p.drive_roles()
    boundaries: tuple[Boundary, ...] = ()
    start = IDLE
    if p.working_stroke is not None:
        boundaries = stroke_boundaries(dead_centres(chain))
        start = int(regimes_at(chain, np.array([p.direction * FIRST_RAD]), p.direction)[0])
    return CrankLinkage(
        TurnedLinkage(chain),
        p.coupling.step_s,
        0.0,
        speed,
        command,
        p.links[1:],
        "tool",
        REGIMES,
        start,
        boundaries,
        transmission,
        p.shaft_friction,
        size_m=p.size_m,
        resisting=SET_STROKE if p.working_stroke is not None else {},
    ).at_rated_speed(p.full_speed_rad_per_s)


def planar_linkage_chain(p: PlanarLinkageParameters) -> PlanarLinkage:
    """Return the constants of the kernels."""
    return mechanism_constants(p)
