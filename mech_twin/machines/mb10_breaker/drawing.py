"""The breaker drawn: body, spring, linkage, tool and wall in the machine's frame."""

from __future__ import annotations

import math
from collections.abc import Callable

from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.parts.four_bar import position
from mech_twin.samples import BodySample, LinkageSample, Shape

STEEL, DARK, BRASS, RED, GREY = (70, 130, 180), (40, 40, 40), (205, 133, 63), (200, 60, 60), (150, 150, 150)


def drawing(b: Breaker, striker_angle_deg: float) -> Callable[[LinkageSample, BodySample | None], tuple[Shape, ...]]:
    """Return the function that draws the mechanism in the machine's frame, the body turned by its own angle."""
    swing = math.radians(striker_angle_deg)
    face = (b.bar.pivot_x_m + b.n_y * b.striker_arm_m, -b.n_x * b.striker_arm_m)  # the struck face, the tool seated

    def shapes(linkage: LinkageSample, body: BodySample | None) -> tuple[Shape, ...]:
        joints = dict(zip(linkage.joints, linkage.position, strict=True))
        q, rocker = joints["crank"], joints["rocker"]
        phi = joints["body"] if body is None else body.joint("body").position
        c, s = math.cos(phi), math.sin(phi)

        def seen(x: float, y: float) -> tuple[float, float]:
            return c * x + s * y, c * y - s * x

        at = position(b.bar, q)
        d = (b.bar.pivot_x_m, b.bar.pivot_y_m)
        tip = (d[0] + b.striker_arm_m * math.cos(rocker + swing), d[1] + b.striker_arm_m * math.sin(rocker + swing))
        far = (face[0] + 0.12 * b.n_x, face[1] + 0.12 * b.n_y)
        across = (-0.15 * b.n_y, 0.15 * b.n_x)
        collar = tuple(
            seen(face[0] + 0.03 * b.n_x + w * across[0], face[1] + 0.03 * b.n_y + w * across[1]) for w in (-0.3, 0.3)
        )
        a, pin, bearing = seen(at.a_x, at.a_y), seen(at.b_x, at.b_y), seen(*d)
        return (
            Shape("body", "line", ((0.0, 0.0), bearing, collar[0], collar[1], (0.0, 0.0)), GREY, 0.006),
            Shape(
                "spring",
                "line",
                _coil(seen(b.spring_arm_m * b.n_y, -b.spring_arm_m * b.n_x), (b.n_x, b.n_y)),
                BRASS,
                0.002,
            ),
            Shape("crank", "line", ((0.0, 0.0), a), RED, 0.010),
            Shape("coupler", "line", (a, pin), STEEL, 0.008),
            Shape("rocker", "line", (pin, bearing, seen(*tip)), DARK, 0.012),
            Shape("tool", "line", (face, far), BRASS, 0.020),
            Shape("wall", "line", _wall(far, across), GREY, 0.010),
            Shape("pins", "points", ((0.0, 0.0), a, pin, bearing), DARK, 0.012),
        )

    return shapes


def _wall(far: tuple[float, float], across: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    return ((far[0] - across[0], far[1] - across[1]), (far[0] + across[0], far[1] + across[1]))


def _coil(foot: tuple[float, float], n: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    """Return a zigzag from a fixed point behind the body to the foot of the spring."""
    behind = (foot[0] - 0.10 * n[0], foot[1] - 0.10 * n[1])
    points = [behind]
    for i in range(1, 8):
        side = 0.01 if i % 2 else -0.01
        points.append((behind[0] + 0.0125 * i * n[0] - side * n[1], behind[1] + 0.0125 * i * n[1] + side * n[0]))
    return (*points, foot)
