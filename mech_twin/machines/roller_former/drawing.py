"""Drawing of the roller former: shaft, cranks, rods, carts with their rollers, and rails."""

from __future__ import annotations

from math import cos, sin

from mech_twin.machines.roller_former.dynamics import Former
from mech_twin.machines.roller_former.roles import joints_of
from mech_twin.samples import LinkageSample, Shape

BODY_HALF_HEIGHT_M = 0.09
COLOURS = ((40, 110, 180), (200, 90, 40), (60, 150, 90), (140, 80, 170))


def former_drawing(former: Former, sample: LinkageSample) -> tuple[Shape, ...]:
    """Return shaft, cranks, rods, carts with their rollers, and rails; carts are drawn one behind the other."""
    bank = former.bank
    reach = bank.crank_m + bank.rod_m
    rail = bank.p_m + bank.b_m + 0.1
    shapes = [
        Shape("shaft", "points", ((0.0, 0.0),), (0, 0, 0), 0.02),
        *(
            Shape(name, "line", ((bank.rod_m - bank.crank_m, y), (reach + rail, y)), (120, 120, 120), 0.006)
            for name, y in (("upper_rail", BODY_HALF_HEIGHT_M), ("lower_rail", -BODY_HALF_HEIGHT_M))
        ),
    ]
    joints = joints_of(sample.position)
    for index, (offset, x) in enumerate(zip(bank.offset_rad.tolist(), joints.carts, strict=True)):
        shapes += _cart_shapes(former, index, joints.crank + offset, x)
    return tuple(shapes)


def _cart_shapes(former: Former, index: int, psi: float, x: float) -> list[Shape]:
    bank, colour = former.bank, COLOURS[index % len(COLOURS)]
    pin = (bank.crank_m * cos(psi), bank.crank_m * sin(psi))
    left, right, middle = x, x + bank.p_m + bank.b_m + 0.05, x + bank.p_m
    top = 0.8 * BODY_HALF_HEIGHT_M
    box = ((left, -top), (right, -top), (right, top), (left, top), (left, -top))
    number = index + 1
    return [
        Shape(f"crank_{number}", "line", ((0.0, 0.0), pin), colour, 0.012),
        Shape(f"rod_{number}", "line", (pin, (x, 0.0)), colour, 0.008),
        Shape(f"cart_{number}", "line", box, colour, 0.006),
        Shape(
            f"guide_rollers_{number}",
            "points",
            ((middle - bank.b_m, 0.0), (middle + bank.b_m, 0.0)),
            (60, 60, 60),
            0.023,
        ),
        Shape(
            f"forming_rollers_{number}",
            "points",
            ((middle - bank.a_m, -bank.e_m), (middle + bank.a_m, -bank.e_m)),
            (90, 90, 90),
            0.05,
        ),
    ]
