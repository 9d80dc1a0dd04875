# SPDX-License-Identifier: Apache-2.0
"""Every pin force of the linkage, by equilibrium of its links, dyad by dyad from the last to the crank.

A second route to the drive torque: nothing of the reduced inertia and moment enters it.  Each dyad is statically
determinate, so its pin between the two links follows from 2 x 2 equations; then the links it hangs on are loaded by it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mech_twin.kernel import kernel
from mech_twin.machines.planar_linkage.chain import (
    CRANK,
    RPR,
    RRP,
    Array,
    ChainMotion,
    LinkPoint,
    chain_motion,
    on_link,
)
from mech_twin.machines.planar_linkage.linkage import PlanarLinkage, is_working, stretched

PINS_OF_DYAD = 3  # from: on the first link; between: of the first on the second; to: on the second


class Wrenches(NamedTuple):
    """Force (N) and moment about the machine's origin (N m) on every link; shape (links,).

    ``size`` is the sum of the sizes of what the moment is a difference of (N m).
    """

    x: Array
    y: Array
    moment: Array
    size: Array


class ChainReactions(NamedTuple):
    """At pins (crank bearing, then three of each dyad) force (N) and moment (N m), shape (pins,); and what follows.

    Drive torque (N m), and the force that the moving masses leave on the frame (N), weights and loads apart; and how
    large the parts are, in moment at the crank (N m), of which the drive torque is what remains: by virtual work.
    """

    x: Array
    y: Array
    moment: Array
    drive_nm: float
    shaking_x: float
    shaking_y: float
    balanced_nm: float


@kernel
def add_force(loads: Wrenches, link: int, x: float, y: float, at_x: float, at_y: float, moment: float) -> None:
    """Add a force (N) at a point (m) and a moment (N m) to what loads a link."""
    loads.x[link] += x
    loads.y[link] += y
    loads.moment[link] += at_x * y - at_y * x + moment
    loads.size[link] += abs(at_x * y) + abs(at_y * x) + abs(moment)


@kernel
def about(loads: Wrenches, link: int, x: float, y: float) -> float:
    """Return the moment (N m) of what loads a link about a point (m)."""
    return float(loads.moment[link] - x * loads.y[link] + y * loads.x[link])


@kernel
def add_loads(p: PlanarLinkage, m: ChainMotion, regime: int, loads: Wrenches) -> None:
    """Add working force, loads and springs."""
    if is_working(regime):
        s = p.stroke
        at = on_link(m, s.link, s.along_m, s.across_m)
        add_force(loads, s.link, -s.force_n * s.direction_x, -s.force_n * s.direction_y, at.x, at.y, 0.0)
    for i in range(len(p.loads.link)):
        at = on_link(m, p.loads.link[i], p.loads.along_m[i], p.loads.across_m[i])
        add_force(loads, p.loads.link[i], p.loads.force_x_n[i], p.loads.force_y_n[i], at.x, at.y, 0.0)
    for i in range(len(p.springs.link)):
        at = on_link(m, p.springs.link[i], p.springs.along_m[i], p.springs.across_m[i])
        longer, u_x, u_y = stretched(p.springs, i, at)
        pull = p.springs.rate_n_per_m[i] * longer
        add_force(loads, p.springs.link[i], -pull * u_x, -pull * u_y, at.x, at.y, 0.0)


@kernel
def add_inertia(p: PlanarLinkage, m: ChainMotion, w: float, e: float, loads: Wrenches) -> tuple[float, float]:
    """Add weights and the inertia of every link; return the sum of the inertia forces (N)."""
    shaking_x = shaking_y = 0.0
    for link in range(CRANK, len(p.masses.mass_kg)):
        mass = p.masses.mass_kg[link]
        at = on_link(m, link, p.masses.along_m[link], p.masses.across_m[link])
        x, y = -mass * (at.x1 * e + at.x2 * w * w), -mass * (at.y1 * e + at.y2 * w * w)
        spin = -p.masses.inertia_kg_m2[link] * (m.angle1[link] * e + m.angle2[link] * w * w)
        add_force(loads, link, x, y - mass * p.gravity, at.x, at.y, spin)
        shaking_x, shaking_y = shaking_x + x, shaking_y + y
    return shaking_x, shaking_y


@kernel
def between_links(
    p: PlanarLinkage, k: int, m: ChainMotion, a: LinkPoint, b: LinkPoint, loads: Wrenches
) -> tuple[float, float, float, float, float]:
    """Return force (N) and moment (N m) of a dyad's first link on its second, and the point (m) they act in."""
    d, first, second = p.dyads, 2 + 2 * k, 3 + 2 * k
    own = about(loads, first, a.x, a.y)
    if d.kind[k] == RPR:
        x, y = a.x - b.x, a.y - b.y
        square = x * x + y * y
        normal = -(about(loads, second, b.x, b.y) + own) / square
        return -normal * y, normal * x, own, a.x, a.y
    if d.kind[k] == RRP:
        c_x, c_y = m.x[second], m.y[second]
        u_x, u_y = np.cos(m.angle[second]), np.sin(m.angle[second])
        r_x, r_y = c_x - a.x, c_y - a.y
        push, det = -(loads.x[second] * u_x + loads.y[second] * u_y), u_x * r_x + u_y * r_y
        return (push * r_x - u_y * own) / det, (u_x * own + push * r_y) / det, 0.0, c_x, c_y
    c = on_link(m, first, d.first_m[k], 0.0)
    r_x, r_y, s_x, s_y = c.x - a.x, c.y - a.y, c.x - b.x, c.y - b.y
    other, det = -about(loads, second, b.x, b.y), r_x * s_y - r_y * s_x
    return (own * s_x - other * r_x) / det, (own * s_y - other * r_y) / det, 0.0, c.x, c.y


@kernel
def pin_forces(p: PlanarLinkage, f: float, w: float, e: float, regime: int) -> ChainReactions:
    """Return every pin force at crank angle, speed and acceleration (rad, rad/s, rad/s2)."""
    d, links = p.dyads, len(p.masses.mass_kg)
    m, _ = chain_motion(d, f)
    t = np.zeros((4, links))
    loads = Wrenches(t[0], t[1], t[2], t[3])
    add_loads(p, m, regime, loads)
    shaking_x, shaking_y = add_inertia(p, m, w, e, loads)
    pins = np.zeros((3, 1 + PINS_OF_DYAD * len(d.kind)))
    out = ChainReactions(pins[0], pins[1], pins[2], 0.0, shaking_x, shaking_y, 0.0)
    balanced = 0.0
    for k in range(len(d.kind) - 1, -1, -1):
        first, second, pin = 2 + 2 * k, 3 + 2 * k, 1 + PINS_OF_DYAD * k
        a = on_link(m, d.from_link[k], d.from_x_m[k], d.from_y_m[k])
        b = on_link(m, d.to_link[k], d.to_x_m[k], d.to_y_m[k])
        x, y, moment, c_x, c_y = between_links(p, k, m, a, b, loads)
        from_x, from_y = x - loads.x[first], y - loads.y[first]
        to_x, to_y, to_moment, at_x, at_y = -x - loads.x[second], -y - loads.y[second], 0.0, b.x, b.y
        if d.kind[k] == RRP:
            at_x, at_y = c_x, c_y
            to_moment = -about(loads, second, c_x, c_y)
        out.x[pin], out.y[pin] = from_x, from_y
        out.x[pin + 1], out.y[pin + 1], out.moment[pin + 1] = x, y, moment
        out.x[pin + 2], out.y[pin + 2], out.moment[pin + 2] = to_x, to_y, to_moment
        balanced += abs(from_x * a.x1) + abs(from_y * a.y1) + abs(to_x * b.x1) + abs(to_y * b.y1)
        add_force(loads, d.from_link[k], -from_x, -from_y, a.x, a.y, 0.0)
        add_force(loads, d.to_link[k], -to_x, -to_y, at_x, at_y, -to_moment)
    for link in range(CRANK, links):
        balanced += loads.size[link] * abs(m.angle1[link])
    out.x[0], out.y[0] = -loads.x[CRANK], -loads.y[CRANK]
    return ChainReactions(out.x, out.y, out.moment, -loads.moment[CRANK], shaking_x, shaking_y, balanced)
