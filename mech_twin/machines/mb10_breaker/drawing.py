# SPDX-License-Identifier: Apache-2.0
"""The breaker drawn: body, spring, linkage, tool and wall in the machine's frame.

Frames of the breaker: the body turns clockwise, everything but tool and wall is carried by it.
"""

import math
from collections.abc import Callable

from mech_twin.capabilities.figure import (
    CRANK,
    FOLLOWER,
    GROUND,
    ROD,
    SPRING,
    STEEL,
    TOOL,
    Point,
    Strip,
    coil,
    hatched,
    label,
)
from mech_twin.capabilities.mechanism import (
    ROOT,
    Bar,
    FrameTree,
    Inertia,
    fixed,
    four_bar_chain,
    four_bar_masses,
    turning,
)
from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.machines.mb10_breaker.parameters import LINKS
from mech_twin.machines.mb10_breaker.roles import PINS
from mech_twin.parts.four_bar import position
from mech_twin.samples import BodySample, LinkageSample, Shape

TOOL_LENGTH_M = 0.12  # drawn
WALL_HALF_M = 0.10
COIL_M = 0.13  # drawn length of the spring at rest
HAMMER_HALF_M = 0.012


def drawing(b: Breaker, striker_angle_deg: float) -> Callable[[LinkageSample, BodySample | None], tuple[Shape, ...]]:
    """Return the function that draws the mechanism in the machine's frame, the body turned by its own angle."""
    swing = math.radians(striker_angle_deg)
    n: Point = (b.n_x, b.n_y)
    face = (b.bar.pivot_x_m + b.n_y * b.striker_arm_m, -b.n_x * b.striker_arm_m)  # the struck face, the tool seated
    far = _moved(face, n, TOOL_LENGTH_M)
    standing = _standing(b, face, far, n)

    def shapes(linkage: LinkageSample, body: BodySample | None) -> tuple[Shape, ...]:
        joints = dict(zip(linkage.joints, linkage.position, strict=True))
        q, rocker = joints["crank"], joints["rocker"]
        phi = joints["body"] if body is None else body.joint("body").position
        c, s = math.cos(phi), math.sin(phi)

        def seen(x: float, y: float) -> Point:
            return c * x + s * y, c * y - s * x

        at = position(b.bar, q)
        d = (b.bar.pivot_x_m, b.bar.pivot_y_m)
        lean = rocker + swing
        tip = (d[0] + b.striker_arm_m * math.cos(lean), d[1] + b.striker_arm_m * math.sin(lean))
        side = (HAMMER_HALF_M * math.cos(lean), HAMMER_HALF_M * math.sin(lean))
        hammer = (seen(tip[0] - side[0], tip[1] - side[1]), seen(tip[0] + side[0], tip[1] + side[1]))
        a, pin, bearing = seen(at.a_x, at.a_y), seen(at.b_x, at.b_y), seen(*d)
        foot = seen(b.spring_arm_m * b.n_y, -b.spring_arm_m * b.n_x)
        return (
            *standing,
            Shape("body", "line", _body(seen, d, foot, face, n), GROUND, 0.006, "body on its springs"),
            Shape("spring", "line", coil(_spring_end(b, n), foot, 0.011), SPRING, 0.003, "spring"),
            Shape("crank", "line", ((0.0, 0.0), a), CRANK, 0.012),
            label("crank_name", (0.5 * a[0] - 0.05, 0.5 * a[1] + 0.01), "crank", CRANK),
            Shape("coupler", "line", (a, pin), ROD, 0.010, "coupler"),
            Shape("rocker", "line", (pin, bearing, seen(*tip)), FOLLOWER, 0.014, "rocker with striker"),
            Shape("striker", "line", hammer, STEEL, 0.030),
            Shape("pins", "points", ((0.0, 0.0), a, pin, bearing), STEEL, 0.014),
        )

    return shapes


def _standing(b: Breaker, face: Point, far: Point, n: Point) -> tuple[Shape, ...]:
    """Return the fixed shapes: tool, wall, and the ground of the spring."""
    held = _spring_end(b, n)
    across = (n[1], -n[0])
    low, high = _moved(far, across, -WALL_HALF_M), _moved(far, across, WALL_HALF_M)
    ground = hatched(_moved(held, across, -0.025), _moved(held, across, 0.025), 0.012)
    return (
        Shape("spring_ground", "line", ground, GROUND, 0.003),
        Shape("wall", "line", hatched(high, low, 0.02), GROUND, 0.004, "wall"),
        Shape("tool", "line", (face, far), TOOL, 0.020, "tool"),
    )


def _body(seen: Callable[[float, float], Point], d: Point, foot: Point, face: Point, n: Point) -> Strip:
    """Return the outline: crank axis, rocker axis, collar about the tool, foot of the spring."""
    collar = _moved(face, n, 0.03)
    ends = [_moved(collar, (n[1], -n[0]), share) for share in (-0.03, 0.03)]
    return ((0.0, 0.0), seen(*d), *(seen(*end) for end in ends), foot, (0.0, 0.0))


def _spring_end(b: Breaker, n: Point) -> Point:
    """Return the fixed end of the spring, behind the foot it presses while the body rests."""
    rest = (b.spring_arm_m * b.n_y, -b.spring_arm_m * b.n_x)
    return _moved(rest, n, -COIL_M)


def _moved(point: Point, along: Point, by_m: float) -> Point:
    return point[0] + by_m * along[0], point[1] + by_m * along[1]


def mechanism(b: Breaker, striker_angle_deg: float) -> FrameTree:
    """Return body, crank, coupler and rocker, the struck face (`tool`, x along the blow) and the striker's tip.

    A pin's reaction is given in the machine's axes, the linkage's angles in the body's: each pin has a frame of
    either kind (``..._axes``: the body's).
    """
    bar, swing = b.bar, math.radians(striker_angle_deg)
    lengths, pivot = (bar.crank_m, bar.coupler_m, bar.rocker_m), (bar.pivot_x_m, bar.pivot_y_m)
    joints, loop = four_bar_chain(LINKS, lengths, pivot, "body")
    arm = b.striker_arm_m
    face = (bar.pivot_x_m + b.n_y * arm, -b.n_x * arm)
    tip = (arm * math.cos(swing), arm * math.sin(swing))
    return FrameTree(
        (
            turning("body", ROOT, "body", ratio=-1.0),
            *joints,
            *(turning("body", f"{pin}_axes", pin) for pin in PINS),
            fixed("rocker", "striker", tip),
            fixed(ROOT, "tool", face, math.atan2(b.n_y, b.n_x)),
        ),
        (loop,),
        (
            Bar("body", (0.0, 0.0), pivot, 0.006, (150, 150, 150)),
            Bar("crank", (0.0, 0.0), (bar.crank_m, 0.0), 0.010, (200, 60, 60)),
            Bar("coupler", (0.0, 0.0), (bar.coupler_m, 0.0), 0.008, (70, 130, 180)),
            Bar("rocker", (0.0, 0.0), (bar.rocker_m, 0.0), 0.012, (40, 40, 40)),
            Bar("rocker", (0.0, 0.0), tip, 0.012, (40, 40, 40)),
            Bar("tool", (0.0, 0.0), (TOOL_LENGTH_M, 0.0), 0.020, (205, 133, 63)),
        ),
        inertias=(
            *four_bar_masses(LINKS, (b.crank, b.coupler, b.rocker)),
            Inertia("tool", b.tool_mass_kg),
        ),
        mass_remarks=(f"body: {b.body_inertia_kg_m2:g} kg m2 about the crank axis, its mass is not known",),
    )
