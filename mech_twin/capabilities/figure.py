# SPDX-License-Identifier: Apache-2.0
r"""Elements of a mechanism's schematic: hatched ground, fixed bearings, guides, springs, circles.

::

    fixed bearing       ground            spring
          o            __________
         / \           / / / / /     o--/\/\/\/\--o
        /___\
        / / /
"""

from math import cos, hypot, pi, sin

from mech_twin.samples import Shape

Point = tuple[float, float]
Strip = tuple[Point, ...]
Colour = tuple[int, int, int]

# each colour has one meaning in all machines; all are legible on light and dark themes
CRANK: Colour = (200, 60, 40)
ROD: Colour = (60, 110, 180)
FOLLOWER: Colour = (80, 140, 60)
STEEL: Colour = (112, 118, 126)
GROUND: Colour = (125, 125, 125)
TOOL: Colour = (205, 133, 63)
SPRING: Colour = (150, 100, 30)
MATERIAL: Colour = (190, 155, 100)
MEASURE: Colour = (130, 130, 130)
FORCE: Colour = (213, 94, 0)
CIRCLE_POINTS = 36


def _polar(centre: Point, radius_m: float, angle: float) -> Point:
    return centre[0] + radius_m * cos(angle), centre[1] + radius_m * sin(angle)


def circle(centre: Point, radius_m: float, points: int = CIRCLE_POINTS) -> Strip:
    """Return a closed circle (m)."""
    strip = [_polar(centre, radius_m, 2.0 * pi * i / points) for i in range(points)]
    return (*strip, strip[0])


def toothed(centre: Point, radius_m: float, teeth: int, angle: float, height_m: float) -> Strip:
    """Return the closed outline of a gear about its pitch circle (m), with the middle of a tooth at an angle (rad)."""
    strip = []
    for i in range(teeth):
        for edge, out in ((-0.25, -1.0), (-0.25, 1.0), (0.25, 1.0), (0.25, -1.0)):
            strip.append(_polar(centre, radius_m + out * height_m, angle + 2.0 * pi * (i + edge) / teeth))
    return (*strip, strip[0])


def spiral(centre: Point, inner_m: float, outer_m: float, begin: float, end: float, turns: int = 2) -> Strip:
    """Return a spiral between angles on an inner and an outer circle (m, rad), with extra whole turns."""
    count = turns * CIRCLE_POINTS
    strip = []
    for i in range(count + 1):
        share = i / count
        turn = begin + share * (end - begin + 2.0 * pi * turns)
        strip.append(_polar(centre, inner_m + share * (outer_m - inner_m), turn))
    return tuple(strip)


def box(left_m: float, low_m: float, right_m: float, high_m: float) -> Strip:
    """Return a closed rectangle (m), anticlockwise from its lower left corner."""
    return ((left_m, low_m), (right_m, low_m), (right_m, high_m), (left_m, high_m), (left_m, low_m))


def hatched(begin: Point, end: Point, depth_m: float) -> Strip:
    """Return a line with hatching of this depth (m) on its right side, where the ground is."""
    length = hypot(end[0] - begin[0], end[1] - begin[1])
    count = max(2, round(length / depth_m))
    along = ((end[0] - begin[0]) / count, (end[1] - begin[1]) / count)
    unit = (along[0] * count / length, along[1] * count / length)
    foot = (depth_m * (unit[1] - 0.7 * unit[0]), depth_m * (-unit[0] - 0.7 * unit[1]))
    strip = [begin]
    for i in range(1, count + 1):
        at = (begin[0] + i * along[0], begin[1] + i * along[1])
        strip += [at, (at[0] + foot[0], at[1] + foot[1]), at]
    return tuple(strip)


def bearing(at: Point, size_m: float, *, hanging: bool = False) -> Strip:
    """Return a fixed bearing below a pin, or above it if hanging: a triangle on hatched ground."""
    up = 1.0 if hanging else -1.0
    y = at[1] + 1.5 * up * size_m
    begin, end = (at[0] + 1.6 * up * size_m, y), (at[0] - 1.6 * up * size_m, y)
    near, far = (at[0] + up * size_m, y), (at[0] - up * size_m, y)
    return (at, near, *hatched(begin, end, 0.6 * size_m), far, at)


def coil(begin: Point, end: Point, half_width_m: float, turns: int = 6) -> Strip:
    """Return a spring between two points, with a straight piece at each end."""
    x, y = end[0] - begin[0], end[1] - begin[1]
    length = hypot(x, y) or 1.0
    across = (-y / length * half_width_m, x / length * half_width_m)
    strip = [begin]
    for i in range(2 * turns + 1):
        share = 0.12 + 0.76 * i / (2.0 * turns)
        side = 0.0 if i in (0, 2 * turns) else (1.0 if i % 2 else -1.0)
        strip.append((begin[0] + share * x + side * across[0], begin[1] + share * y + side * across[1]))
    return (*strip, end)


def label(name: str, at: Point, text: str, colour: Colour = STEEL, height_m: float = 0.02) -> Shape:
    """Return a text below a point; its height is in metres in figures with lengths as text heights."""
    return Shape(name, "text", (at,), colour, height_m, text)


def measure(name: str, begin: Point, end: Point, text: str, tick_m: float) -> Shape:
    """Return a dimension line between two points, with ticks of this length (m) at its ends."""
    length = hypot(end[0] - begin[0], end[1] - begin[1]) or 1.0
    half = 0.5 * tick_m / length
    x, y = -(end[1] - begin[1]) * half, (end[0] - begin[0]) * half
    first, last = (
        ((begin[0] - x, begin[1] - y), (begin[0] + x, begin[1] + y)),
        ((end[0] - x, end[1] - y), (end[0] + x, end[1] + y)),
    )
    return Shape(name, "line", (*first, begin, end, *last), MEASURE, 0.08 * tick_m, text)


def millimetres(length_m: float) -> str:
    """Return a length as text: in millimetres with four digits, or in metres from 1 m on."""
    return f"{length_m:.3g} m" if abs(length_m) >= 1.0 else f"{1e3 * length_m:.4g} mm"
