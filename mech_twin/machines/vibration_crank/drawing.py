"""Drawing of the vibration crank in the frame of its crank bearing."""

from __future__ import annotations

from math import cos, sin

from mech_twin.machines.vibration_crank.slider_crank import BOOM, FINITE_ROD, SliderCrank, follower
from mech_twin.samples import LinkageSample, Shape


def drawing(s: SliderCrank, linkage: LinkageSample) -> tuple[Shape, ...]:
    """Return crank with counterweight, rod, and slider or boom with its load."""
    th = linkage.joint("crank").position
    at = follower(s, th)
    crank = (s.crank_m * cos(th), s.crank_m * sin(th))
    weight = (-s.counter_m * cos(th), -s.counter_m * sin(th))
    joint = (at.x, at.y)
    shapes = [
        Shape("crank", "line", (weight, (0.0, 0.0), crank), (200, 60, 40), 0.02),
        Shape("counterweight", "points", (weight,), (60, 60, 60), 0.05),
        Shape("joints", "points", ((0.0, 0.0), crank, joint), (0, 0, 0), 0.015),
    ]
    if s.kind >= FINITE_ROD:
        shapes.append(Shape("rod", "line", (crank, joint), (60, 90, 180), 0.012))
    else:
        shapes.append(Shape("rod", "line", (crank, (crank[0], at.y)), (60, 90, 180), 0.012))
    if s.kind == BOOM:
        pivot = (s.pivot_x_m, s.pivot_y_m)
        load = (pivot[0] + s.load_ratio * (at.x - pivot[0]), pivot[1] + s.load_ratio * (at.y - pivot[1]))
        shapes.append(Shape("boom", "line", (pivot, joint, load), (90, 140, 60), 0.02))
        shapes.append(Shape("load", "points", (load,), (90, 140, 60), 0.06))
    else:
        half = 0.3 * s.crank_m
        shapes.append(Shape("slider", "line", ((at.x - half, at.y), (at.x + half, at.y)), (90, 140, 60), 0.05))
    return tuple(shapes)
