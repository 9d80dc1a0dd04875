# SPDX-License-Identifier: Apache-2.0
r"""Kinematics of a crank that drives a chain of dyads: every link's place and its derivatives in the crank angle.

::

    rrr   A o---first---o C          rrp   A o---first---o C [slider] on a guide     rpr   A o [block]
                         \                              ---+--------> u                      \\  on a bar
                        second                          (guide on a link or the ground)       \\ second
                           \                                                                   o B
                            o B

A and B are points of links before it (ground, crank, dyads before).  Each link has a frame: of the crank at its
bearing, x along the crank; of a first link at A, x towards C; of a second link of an rrr at B, x towards C; of a slider
at C, x along the guide; of a bar at B, x towards A; of a block at A, x along the bar.  The ground's is the machine's.

A derivative ends in 1 (in the crank angle) or 2 (second).  Positions solve the dyad in closed form; derivatives solve
its closure conditions, differentiated once and twice: 2 x 2 equations with the same matrix.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel

Array = NDArray[np.float64]
Places = NDArray[np.int64]
RRR, RRP, RPR = 0, 1, 2
GROUND, CRANK = 0, 1
TURN = 2.0 * math.pi


class Dyads(NamedTuple):
    """The dyads in order, one entry each: kind, links and points (m) they hang on, sizes, branch (+1, -1).

    The first and the second link of dyad ``k`` are links ``2 + 2 k`` and ``3 + 2 k``.
    """

    kind: Places
    from_link: Places
    from_x_m: Array
    from_y_m: Array
    to_link: Places
    to_x_m: Array
    to_y_m: Array
    first_m: Array
    second_m: Array
    guide_rad: Array
    branch: Array


class ChainMotion(NamedTuple):
    """Every link's frame at a crank angle: angle (rad), origin (m), and their derivatives in it; shape (links,)."""

    angle: Array
    angle1: Array
    angle2: Array
    x: Array
    x1: Array
    x2: Array
    y: Array
    y1: Array
    y2: Array


class Travel(NamedTuple):
    """Coordinate of every link but the ground (rad, or m of sliders and blocks) and its derivative; shape (links,)."""

    position: Array
    rate: Array


class LinkPoint(NamedTuple):
    """A point of a link (m) with its derivatives in the crank angle."""

    x: float
    x1: float
    x2: float
    y: float
    y1: float
    y2: float


@kernel
def on_link(m: ChainMotion, link: int, along: float, across: float) -> LinkPoint:
    """Return a point that is given in a link's frame (m)."""
    c, s = math.cos(m.angle[link]), math.sin(m.angle[link])
    r_x, r_y = c * along - s * across, s * along + c * across
    t1, t2 = m.angle1[link], m.angle2[link]
    return LinkPoint(
        m.x[link] + r_x,
        m.x1[link] - t1 * r_y,
        m.x2[link] - t2 * r_y - t1 * t1 * r_x,
        m.y[link] + r_y,
        m.y1[link] + t1 * r_x,
        m.y2[link] + t2 * r_x - t1 * t1 * r_y,
    )


@kernel
def put_frame(m: ChainMotion, link: int, at: LinkPoint, angle: float, angle1: float, angle2: float) -> None:
    """Write a link's frame."""
    m.angle[link], m.angle1[link], m.angle2[link] = angle, angle1, angle2
    m.x[link], m.x1[link], m.x2[link] = at.x, at.x1, at.x2
    m.y[link], m.y1[link], m.y2[link] = at.y, at.y1, at.y2


@kernel
def put_bar(m: ChainMotion, link: int, at: LinkPoint, end: LinkPoint) -> None:
    """Write the frame of a link from one point to another, whose distance may change."""
    x, x1, x2 = end.x - at.x, end.x1 - at.x1, end.x2 - at.x2
    y, y1, y2 = end.y - at.y, end.y1 - at.y1, end.y2 - at.y2
    square = x * x + y * y
    angle1 = (x * y1 - y * x1) / square if square > 0.0 else math.nan
    angle2 = (x * y2 - y * x2 - 2.0 * (x * x1 + y * y1) * angle1) / square if square > 0.0 else math.nan
    put_frame(m, link, at, math.atan2(y, x), angle1, angle2)


@kernel
def hinge(a: LinkPoint, b: LinkPoint, first: float, second: float, branch: float) -> LinkPoint:
    """Return the pin between two links: left of the line from A to B for branch +1.  nan where they do not reach.

    (C - A)^2 = first^2 and (C - B)^2 = second^2, and their first and second derivatives.
    """
    x, y = b.x - a.x, b.y - a.y
    square = x * x + y * y
    if square == 0.0:
        return LinkPoint(math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)
    distance = math.sqrt(square)
    along = (first * first - second * second + square) / (2.0 * distance)
    across = first * first - along * along
    height = branch * math.sqrt(across) if across > 0.0 else math.nan
    c_x, c_y = a.x + (along * x - height * y) / distance, a.y + (along * y + height * x) / distance
    u, v, p, q = c_x - a.x, c_y - a.y, c_x - b.x, c_y - b.y
    det = u * q - v * p
    one, two = u * a.x1 + v * a.y1, p * b.x1 + q * b.y1
    x1, y1 = (one * q - v * two) / det, (u * two - p * one) / det
    one = u * a.x2 + v * a.y2 - (x1 - a.x1) ** 2 - (y1 - a.y1) ** 2
    two = p * b.x2 + q * b.y2 - (x1 - b.x1) ** 2 - (y1 - b.y1) ** 2
    return LinkPoint(c_x, x1, (one * q - v * two) / det, c_y, y1, (u * two - p * one) / det)


@kernel
def along_guide(
    a: LinkPoint, at: LinkPoint, angle: float, angle1: float, angle2: float, first: float, branch: float
) -> tuple[LinkPoint, float, float]:
    """Return the pin of a link and its slider, the travel along the guide (m), its derivative; nan out of reach.

    C = Q + s u, (C - A)^2 = first^2: with branch +1 the slider is ahead, along u, of the foot of A on the guide.
    """
    u_x, u_y = math.cos(angle), math.sin(angle)
    w_x, w_y = a.x - at.x, a.y - at.y
    across = first * first - (u_x * w_y - u_y * w_x) ** 2
    reach = branch * math.sqrt(across) if across > 0.0 else math.nan
    s = w_x * u_x + w_y * u_y + reach
    r_x, r_y = at.x + s * u_x - a.x, at.y + s * u_y - a.y
    lean = r_x * u_x + r_y * u_y
    turned_x, turned_y = at.x1 - s * angle1 * u_y, at.y1 + s * angle1 * u_x
    s1 = -(r_x * (turned_x - a.x1) + r_y * (turned_y - a.y1)) / lean
    x1, y1 = turned_x + s1 * u_x, turned_y + s1 * u_y
    bent = 2.0 * s1 * angle1 + s * angle2
    twice_x = at.x2 - bent * u_y - s * angle1 * angle1 * u_x
    twice_y = at.y2 + bent * u_x - s * angle1 * angle1 * u_y
    swung = (x1 - a.x1) ** 2 + (y1 - a.y1) ** 2
    s2 = -(swung + r_x * (twice_x - a.x2) + r_y * (twice_y - a.y2)) / lean
    return (
        LinkPoint(at.x + s * u_x, x1, twice_x + s2 * u_x, at.y + s * u_y, y1, twice_y + s2 * u_y),
        s,
        s1,
    )


@kernel
def put_dyad(d: Dyads, k: int, m: ChainMotion, travel: Travel) -> None:
    """Write the frames and the coordinates of a dyad's two links."""
    first, second = 2 + 2 * k, 3 + 2 * k
    a = on_link(m, d.from_link[k], d.from_x_m[k], d.from_y_m[k])
    b = on_link(m, d.to_link[k], d.to_x_m[k], d.to_y_m[k])
    if d.kind[k] == RPR:
        put_bar(m, second, b, a)
        put_frame(m, first, a, m.angle[second], m.angle1[second], m.angle2[second])
        x, y = a.x - b.x, a.y - b.y
        apart = math.hypot(x, y)
        travel.position[first] = apart
        travel.rate[first] = (x * (a.x1 - b.x1) + y * (a.y1 - b.y1)) / apart if apart > 0.0 else math.nan
        travel.position[second], travel.rate[second] = m.angle[second], m.angle1[second]
        return
    if d.kind[k] == RRR:
        c = hinge(a, b, d.first_m[k], d.second_m[k], d.branch[k])
        put_bar(m, second, b, c)
        travel.position[second], travel.rate[second] = m.angle[second], m.angle1[second]
    else:
        host = d.to_link[k]
        angle, angle1, angle2 = m.angle[host] + d.guide_rad[k], m.angle1[host], m.angle2[host]
        c, s, s1 = along_guide(a, b, angle, angle1, angle2, d.first_m[k], d.branch[k])
        put_frame(m, second, c, angle, angle1, angle2)
        travel.position[second], travel.rate[second] = s, s1
    put_bar(m, first, a, c)
    travel.position[first], travel.rate[first] = m.angle[first], m.angle1[first]


@kernel
def chain_motion(d: Dyads, f: float) -> tuple[ChainMotion, Travel]:
    """Return every link's frame and coordinate at a crank angle ``f`` (rad); angles of links in (-pi, pi]."""
    links = 2 + 2 * len(d.kind)
    t = np.zeros((9, links))
    m = ChainMotion(t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8])
    travel = Travel(np.zeros(links), np.zeros(links))
    m.angle[CRANK], m.angle1[CRANK] = f, 1.0
    travel.position[CRANK], travel.rate[CRANK] = f, 1.0
    for k in range(len(d.kind)):
        put_dyad(d, k, m, travel)
    return m, travel


@kernel
def transmission(d: Dyads, k: int, m: ChainMotion) -> float:
    """Return how well a dyad is led: |sin| of its transmission angle, or distance of block and bar's pivot (m).

    The transmission angle is that between the two links of an rrr, and between the link and the guide's normal of an
    rrp; nan where the dyad cannot be assembled.
    """
    first, second = 2 + 2 * k, 3 + 2 * k
    if d.kind[k] == RPR:
        return math.hypot(m.x[first] - m.x[second], m.y[first] - m.y[second])
    between = m.angle[first] - m.angle[second]
    return abs(math.sin(between)) if d.kind[k] == RRR else abs(math.cos(between))


@kernel
def transmissions(d: Dyads, k: int, angles: Array) -> Array:
    """Return `transmission` of a dyad at crank angles (rad)."""
    out = np.empty(len(angles))
    for i in range(len(angles)):
        m, _ = chain_motion(d, angles[i])
        out[i] = transmission(d, k, m)
    return out


@kernel
def coordinates(d: Dyads, angles: Array) -> Array:
    """Return the coordinates of all links at crank angles (rad), shape (angles, links)."""
    out = np.empty((len(angles), 2 + 2 * len(d.kind)))
    for i in range(len(angles)):
        out[i] = chain_motion(d, angles[i])[1].position
    return out


@kernel
def closure_error(d: Dyads, m: ChainMotion, travel: Travel) -> float:
    """Return by how much the ends of a dyad's links miss each other (m), the worst of all, from their coordinates."""
    worst = 0.0
    for k in range(len(d.kind)):
        first, second = 2 + 2 * k, 3 + 2 * k
        if d.kind[k] == RPR:
            length, angle = travel.position[first], travel.position[second]
            x = m.x[second] + length * math.cos(angle) - m.x[first]
            y = m.y[second] + length * math.sin(angle) - m.y[first]
        else:
            x = m.x[first] + d.first_m[k] * math.cos(travel.position[first])
            y = m.y[first] + d.first_m[k] * math.sin(travel.position[first])
            host = d.to_link[k]
            if d.kind[k] == RRR:
                length, angle = d.second_m[k], travel.position[second]
                x, y = x - m.x[second] - length * math.cos(angle), y - m.y[second] - length * math.sin(angle)
            else:
                at = on_link(m, host, d.to_x_m[k], d.to_y_m[k])
                angle, s = m.angle[host] + d.guide_rad[k], travel.position[second]
                x, y = x - at.x - s * math.cos(angle), y - at.y - s * math.sin(angle)
        worst = max(worst, math.hypot(x, y))
    return worst
