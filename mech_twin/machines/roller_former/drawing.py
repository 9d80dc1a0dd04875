# SPDX-License-Identifier: Apache-2.0
"""Drawing of the roller former: motor, shaft, cranks, rods, carts with their rollers, rails and mix."""

from math import cos, sin

from mech_twin.capabilities.figure import GROUND, MATERIAL, STEEL, Point, bearing, box, circle, hatched, label
from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, Inertia, Loop, fixed, sliding, turning
from mech_twin.machines.roller_former.dynamics import Former
from mech_twin.samples import LinkageSample, Shape

BODY_HALF_HEIGHT_M = 0.09
COLOURS = ((40, 110, 180), (200, 90, 40), (60, 150, 90), (140, 80, 170))
ROLLER_M = 0.08  # drawn radius of a forming roller
MIX_M = 0.12  # drawn thickness of the mix
MOTOR_M = 0.11  # drawn radius of the motor
MOTOR_AT: Point = (-0.42, -0.12)


def former_drawing(former: Former, sample: LinkageSample) -> tuple[Shape, ...]:
    """Return motor, shaft, cranks, rods, carts with their rollers, rails, mix; carts are drawn behind one another."""
    bank = former.bank
    _, crank, twist, *carts_and_rods = sample.position
    shapes = [*_standing(former), *_drive(former, crank + twist)]
    for index, (offset, x) in enumerate(zip(bank.offset_rad.tolist(), carts_and_rods[::2], strict=True)):
        shapes += _cart_shapes(former, index, crank + offset, x)
    shapes.append(Shape("shaft", "points", ((0.0, 0.0),), STEEL, 0.06))
    return tuple(shapes)


def _standing(former: Former) -> list[Shape]:
    """Return the rails the carts roll on, the mix below the rollers, and the shaft's bearing."""
    bank = former.bank
    left, right = bank.rod_m - bank.crank_m, bank.rod_m + bank.crank_m + bank.p_m + bank.b_m + 0.1
    surface = -bank.e_m - ROLLER_M
    rails = (("upper_rail", BODY_HALF_HEIGHT_M), ("lower_rail", -BODY_HALF_HEIGHT_M))
    return [
        *(Shape(name, "line", ((left, y), (right, y)), GROUND, 0.008) for name, y in rails),
        label("rails_name", (right - 0.1, 2.0 * BODY_HALF_HEIGHT_M), "rails", GROUND),
        Shape("mix", "line", box(left, surface - MIX_M, right, surface), MATERIAL, 0.012, "mix"),
        Shape("mix_grain", "line", ((left, surface - 0.5 * MIX_M), (right, surface - 0.5 * MIX_M)), MATERIAL, 0.004),
        Shape("form", "line", hatched((left, surface - MIX_M), (right, surface - MIX_M), 0.05), GROUND, 0.008),
        Shape("shaft_frame", "line", bearing((0.0, 0.0), 0.10), GROUND, 0.006),
    ]


def _drive(former: Former, drive_rad: float) -> list[Shape]:
    """Return the motor with a mark that turns with the drive, and the elastic drive that joins it to the shaft."""
    x, y = MOTOR_AT
    mark = (x + MOTOR_M * cos(drive_rad), y + MOTOR_M * sin(drive_rad))
    return [
        Shape("motor", "line", circle(MOTOR_AT, MOTOR_M), STEEL, 0.012),
        Shape("motor_mark", "line", (MOTOR_AT, mark), STEEL, 0.012),
        label("motor_name", (x, y - MOTOR_M), "motor and gear"),
        Shape("drive", "line", ((x + MOTOR_M, y), (0.0, 0.0)), STEEL, 0.006, "elastic drive"),
    ]


def _cart_shapes(former: Former, index: int, psi: float, x: float) -> list[Shape]:
    bank, colour = former.bank, COLOURS[index % len(COLOURS)]
    pin = (bank.crank_m * cos(psi), bank.crank_m * sin(psi))
    left, right, middle = x, x + bank.p_m + bank.b_m + 0.05, x + bank.p_m
    top = 0.8 * BODY_HALF_HEIGHT_M
    number = index + 1
    rollers = [(middle + side * bank.a_m, -bank.e_m) for side in (-1.0, 1.0)]
    guides = ((middle - bank.b_m, 0.0), (middle + bank.b_m, 0.0))
    hangers = ((rollers[0][0], -top), rollers[0], (rollers[0][0], -top), (rollers[1][0], -top), rollers[1])
    return [
        Shape(f"crank_{number}", "line", ((0.0, 0.0), pin), colour, 0.03, f"crank {number}"),
        Shape(f"rod_{number}", "line", (pin, (x, 0.0)), colour, 0.018, f"rod {number}"),
        Shape(f"cart_{number}", "line", box(left, -top, right, top), colour, 0.010),
        label(f"cart_name_{number}", (middle, 0.05), f"cart {number}", colour),
        Shape(f"hangers_{number}", "line", hangers, colour, 0.010),
        *(
            Shape(f"roller_{number}_{place}", "line", circle(at, ROLLER_M, 24), colour, 0.012)
            for place, at in enumerate(rollers, 1)
        ),
        Shape(f"guide_rollers_{number}", "points", guides, STEEL, 0.06),
        Shape(f"forming_rollers_{number}", "points", tuple(rollers), (90, 90, 90), 0.03),
    ]


def mechanism(former: Former) -> FrameTree:
    """Return the frames; each cart's chain is opened at its pin.

    A rod's angle is counted clockwise from +x, from its pin to the cart.  Its mass is as the machine counts it: half of
    it at either end.
    """
    bank, bars, masses = former.bank, list[Bar](), list[Inertia]()
    joints = [fixed(ROOT, "shaft"), turning("drive", "shaft", "drive"), turning("crank", "shaft", "crank")]
    carts = range(1, bank.offset_rad.size + 1)
    for i, offset in zip(carts, bank.offset_rad.tolist(), strict=True):
        pin, colour = (bank.crank_m * cos(offset), bank.crank_m * sin(offset)), COLOURS[(i - 1) % len(COLOURS)]
        joints += [
            turning("crank", "crank", f"crank_pin_{i}", pin, ratio=-1.0),
            turning(f"rod_{i}", f"crank_pin_{i}", f"rod_{i}", ratio=-1.0),
            fixed(f"rod_{i}", f"rod_end_{i}", (bank.rod_m, 0.0)),
            sliding(f"cart_{i}", ROOT, f"cart_{i}", (1.0, 0.0), bank.crank_m + bank.rod_m),
            fixed(f"cart_{i}", f"cart_pin_{i}"),
            fixed(f"cart_{i}", f"guide_front_{i}", (bank.p_m - bank.b_m, 0.0)),
            fixed(f"cart_{i}", f"guide_rear_{i}", (bank.p_m + bank.b_m, 0.0)),
        ]
        bars += [
            Bar("crank", (0.0, 0.0), pin, 0.012, colour),
            Bar(f"rod_{i}", (0.0, 0.0), (bank.rod_m, 0.0), 0.008, colour),
            Bar(f"cart_{i}", (0.0, 0.0), (bank.p_m + bank.b_m + 0.05, 0.0), 1.6 * BODY_HALF_HEIGHT_M, colour),
        ]
        half, pin_mass = float(bank.rod_half_kg[i - 1]), float(bank.mass_kg[i - 1])
        rod = Inertia(f"rod_{i}", 2.0 * half, (0.5 * bank.rod_m, 0.0), 0.5 * half * bank.rod_m**2)
        masses += [Inertia(f"cart_{i}", pin_mass - half), rod]
    return FrameTree(
        tuple(joints),
        tuple(Loop(f"rod_end_{i}", f"cart_pin_{i}") for i in carts),
        tuple(bars),
        inertias=tuple(masses),
        mass_remarks=(
            f"drive: {former.motor_inertia_kg_m2:g} kg m2 at the crank, its mass is not known",
            f"crank: {len(carts)} times {bank.crank_inertia_kg_m2:g} kg m2 about the shaft, no mass known",
        ),
    )
