# SPDX-License-Identifier: Apache-2.0
"""Drawing of the planar linkage in the frame of its crank bearing."""

from __future__ import annotations

from math import cos, radians, sin

from mech_twin.capabilities.figure import CRANK, GROUND, SPRING, STEEL, TOOL, Point, bearing, coil, hatched
from mech_twin.machines.planar_linkage.chain import GROUND as GROUND_LINK
from mech_twin.machines.planar_linkage.chain import RPR, RRP, ChainMotion, Dyads, chain_motion, on_link
from mech_twin.machines.planar_linkage.linkage import PlanarLinkage
from mech_twin.machines.planar_linkage.mechanism import COLOURS
from mech_twin.machines.planar_linkage.parameters import PlanarLinkageParameters, WorkingStrokeGroup
from mech_twin.samples import LinkageSample, Shape


def drawing(p: PlanarLinkageParameters, chain: PlanarLinkage, linkage: LinkageSample) -> tuple[Shape, ...]:
    """Return ground, crank, links, sliders with their guides, springs, tool and pins; links carry their names."""
    d = chain.dyads
    m, _ = chain_motion(d, linkage.joint("crank").position)
    width = 0.02 * p.size_m
    pins: list[Point] = [(0.0, 0.0), _spot(m, 1, p.crank.length_m, 0.0)]
    shapes = [
        Shape("frame", "line", bearing(pins[0], 1.6 * width), GROUND, 0.2 * width),
        Shape("crank", "line", (pins[0], pins[1]), CRANK, width, "crank"),
    ]
    for k, key in enumerate(p.dyads):
        made, joined = _dyad(key, k, d, m, p.size_m)
        shapes += made
        pins += joined
    shapes += _springs(p, m, width)
    if p.working_stroke is not None:
        shapes.append(_tool(p.working_stroke, _spot(m, p.links.index(p.working_stroke.link), 0.0, 0.0), width))
    shapes.append(Shape("pins", "points", tuple(pins), STEEL, width))
    return tuple(shapes)


def _dyad(key: str, k: int, d: Dyads, m: ChainMotion, size_m: float) -> tuple[list[Shape], list[Point]]:
    """Return the two links of a dyad with what holds them to the ground, and its pins."""
    first, second, width, name = 2 + 2 * k, 3 + 2 * k, 0.02 * size_m, key.replace("_", " ")
    a = _spot(m, d.from_link[k], d.from_x_m[k], d.from_y_m[k])
    b = _spot(m, d.to_link[k], d.to_x_m[k], d.to_y_m[k])
    grounded = d.to_link[k] == GROUND_LINK
    pivot = [Shape(f"{key}_frame", "line", bearing(b, 1.6 * width), GROUND, 0.2 * width)] if grounded else []
    if d.kind[k] == RPR:
        bar = (b, a, _spot(m, second, d.second_m[k], 0.0)) if d.second_m[k] > 0.0 else (b, a)
        block = _box(f"{key}_first", m, first, k, width, f"{name}, block")
        return [*pivot, Shape(f"{key}_second", "line", bar, COLOURS[k], width, f"{name}, bar"), block], [a, b]
    c = _spot(m, first, d.first_m[k], 0.0)
    rod = Shape(f"{key}_first", "line", (a, c), COLOURS[k], width, f"{name}, first")
    if d.kind[k] == RRP:
        slider = _box(f"{key}_second", m, second, k, width, f"{name}, slider")
        return [_guide(key, c, m.angle[second], size_m, grounded=grounded), rod, slider], [a, c]
    return [*pivot, rod, Shape(f"{key}_second", "line", (b, c), COLOURS[k], width, f"{name}, second")], [a, c, b]


def _guide(key: str, at: Point, angle_rad: float, size_m: float, *, grounded: bool) -> Shape:
    """Return the guide below a slider, hatched where it is the ground."""
    along = (0.3 * size_m * cos(angle_rad), 0.3 * size_m * sin(angle_rad))
    foot = (at[0] + 0.025 * size_m * sin(angle_rad), at[1] - 0.025 * size_m * cos(angle_rad))
    begin, end = (foot[0] - along[0], foot[1] - along[1]), (foot[0] + along[0], foot[1] + along[1])
    strip = hatched(begin, end, 0.03 * size_m) if grounded else (begin, end)
    return Shape(f"{key}_guide", "line", strip, GROUND, 0.005 * size_m)


def _springs(p: PlanarLinkageParameters, m: ChainMotion, width: float) -> list[Shape]:
    """Return the springs, from the ground to their links."""
    shapes = []
    for i, spring in enumerate(p.springs, 1):
        end = _spot(m, p.links.index(spring.link), spring.x_m, spring.y_m)
        begin = (spring.ground_x_m, spring.ground_y_m)
        shapes.append(Shape(f"spring_{i}", "line", coil(begin, end, width), SPRING, 0.3 * width, f"spring {i}"))
        shapes.append(Shape(f"spring_{i}_frame", "line", bearing(begin, width), GROUND, 0.2 * width))
    return shapes


def _tool(stroke: WorkingStrokeGroup, at: Point, width: float) -> Shape:
    """Return the tool, ahead of the link that carries it."""
    x, y = cos(radians(stroke.direction_deg)), sin(radians(stroke.direction_deg))
    begin, end = (at[0] + 3.0 * width * x, at[1] + 3.0 * width * y), (at[0] + 7.0 * width * x, at[1] + 7.0 * width * y)
    return Shape("tool", "line", (begin, end), TOOL, 0.8 * width, "tool")


def _spot(m: ChainMotion, link: int, along: float, across: float) -> Point:
    at = on_link(m, link, along, across)
    return at.x, at.y


def _box(name: str, m: ChainMotion, link: int, k: int, width: float, text: str) -> Shape:
    ends = (_spot(m, link, -2.0 * width, 0.0), _spot(m, link, 2.0 * width, 0.0))
    return Shape(name, "line", ends, COLOURS[k], 2.5 * width, text)
