"""Drawing of the press in the frame of its crank bearing."""

from __future__ import annotations

from mech_twin.machines.compaction_press.dynamics import Press, loaded_height, press_reduced
from mech_twin.parts.four_bar import position
from mech_twin.samples import LinkageSample, Shape


def drawing(press: Press, linkage: LinkageSample) -> tuple[Shape, ...]:
    """Return crank, plate, pendulum, pins, and the force of the layer where it acts."""
    angle = linkage.joint("crank").position
    at = position(press.bar, angle)
    load = loaded_point(press, angle)
    o, a, b = (0.0, 0.0), (at.a_x, at.a_y), (at.b_x, at.b_y)
    c = (press.bar.pivot_x_m, press.bar.pivot_y_m)
    shapes = [
        Shape("crank", "line", (o, a), (200, 60, 40), 0.02),
        Shape("plate", "line", (a, b), (60, 90, 180), 0.025),
        Shape("pendulum", "line", (c, b), (90, 140, 60), 0.015),
        Shape("pins", "points", (o, a, b, c), (0, 0, 0), 0.012),
    ]
    force = press_reduced(press, angle, linkage.regime).force
    if force > 0.0:
        length = 0.2 * force / press.load.peak_n
        shapes.append(Shape("working_force", "arrow", ((load[0], load[1] - length), load), (220, 120, 0), 0.01))
    return tuple(shapes)


def loaded_point(press: Press, f: float) -> tuple[float, float]:
    """Return where the layer's force acts (m)."""
    at = position(press.bar, f)
    x = (press.along_m * at.u_x - press.across_m * at.u_y) / press.bar.coupler_m
    return at.a_x + x, loaded_height(press, f)[0]
