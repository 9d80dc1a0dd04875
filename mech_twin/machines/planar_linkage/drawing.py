# SPDX-License-Identifier: Apache-2.0
"""Drawing of the planar linkage in the frame of its crank bearing."""

from __future__ import annotations

from math import cos, sin

from mech_twin.machines.planar_linkage.chain import RPR, RRP, ChainMotion, chain_motion, on_link
from mech_twin.machines.planar_linkage.linkage import PlanarLinkage
from mech_twin.machines.planar_linkage.mechanism import COLOURS, RED
from mech_twin.machines.planar_linkage.parameters import PlanarLinkageParameters
from mech_twin.samples import LinkageSample, Shape

Spot = tuple[float, float]


def drawing(p: PlanarLinkageParameters, chain: PlanarLinkage, linkage: LinkageSample) -> tuple[Shape, ...]:
    """Return crank, links, sliders with their guides, springs and pins."""
    d = chain.dyads
    m, _ = chain_motion(d, linkage.joint("crank").position)
    width = 0.02 * p.size_m
    pins: list[Spot] = [(0.0, 0.0), _spot(m, 1, p.crank.length_m, 0.0)]
    shapes = [Shape("crank", "line", ((0.0, 0.0), pins[1]), RED, width)]
    for k, key in enumerate(p.dyads):
        first, second = 2 + 2 * k, 3 + 2 * k
        a = _spot(m, d.from_link[k], d.from_x_m[k], d.from_y_m[k])
        b = _spot(m, d.to_link[k], d.to_x_m[k], d.to_y_m[k])
        pins.append(a)
        if d.kind[k] == RPR:
            bar = (b, a, _spot(m, second, d.second_m[k], 0.0)) if d.second_m[k] > 0.0 else (b, a)
            shapes += [Shape(f"{key}_second", "line", bar, COLOURS[k], width), _box(f"{key}_first", m, first, k, width)]
            pins.append(b)
            continue
        c = _spot(m, first, d.first_m[k], 0.0)
        pins.append(c)
        shapes.append(Shape(f"{key}_first", "line", (a, c), COLOURS[k], width))
        if d.kind[k] == RRP:
            angle = m.angle[second]
            along = (p.size_m * 0.3 * cos(angle), p.size_m * 0.3 * sin(angle))
            guide = ((c[0] - along[0], c[1] - along[1]), (c[0] + along[0], c[1] + along[1]))
            shapes += [
                Shape(f"{key}_guide", "line", guide, (160, 160, 160), 0.3 * width),
                _box(f"{key}_second", m, second, k, width),
            ]
        else:
            shapes.append(Shape(f"{key}_second", "line", (b, c), COLOURS[k], width))
            pins.append(b)
    for i, spring in enumerate(p.springs, 1):
        end = _spot(m, p.links.index(spring.link), spring.x_m, spring.y_m)
        shapes.append(
            Shape(f"spring_{i}", "line", ((spring.ground_x_m, spring.ground_y_m), end), (120, 120, 120), 0.4 * width)
        )
    shapes.append(Shape("pins", "points", tuple(pins), (0, 0, 0), width))
    return tuple(shapes)


def _spot(m: ChainMotion, link: int, along: float, across: float) -> Spot:
    at = on_link(m, link, along, across)
    return at.x, at.y


def _box(name: str, m: ChainMotion, link: int, k: int, width: float) -> Shape:
    ends = (_spot(m, link, -2.0 * width, 0.0), _spot(m, link, 2.0 * width, 0.0))
    return Shape(name, "line", ends, COLOURS[k], 2.5 * width)
