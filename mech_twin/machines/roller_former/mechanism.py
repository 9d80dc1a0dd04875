# SPDX-License-Identifier: Apache-2.0
"""Frames of the roller former: drive and crank shaft, and of each cart its crank pin, rod, cart and guide rollers."""

from __future__ import annotations

from math import cos, sin

from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, Inertia, Joint, Loop, fixed, sliding, turning
from mech_twin.machines.roller_former.drawing import BODY_HALF_HEIGHT_M, COLOURS
from mech_twin.machines.roller_former.dynamics import Former


def mechanism(former: Former) -> FrameTree:
    """Return the frames; each cart's chain is opened at its pin."""
    offsets = former.bank.offset_rad.tolist()
    carts = [_cart(former, number, offset) for number, offset in enumerate(offsets, 1)]
    return FrameTree(
        (
            fixed(ROOT, "shaft"),
            turning("drive", "shaft", "drive"),
            turning("crank", "shaft", "crank"),
            *(joint for joints in carts for joint in joints),
        ),
        tuple(Loop(f"rod_end_{number}", f"cart_pin_{number}") for number in range(1, len(offsets) + 1)),
        tuple(bar for number, offset in enumerate(offsets, 1) for bar in _bars(former, number, offset)),
        inertias=tuple(mass for number in range(1, len(offsets) + 1) for mass in _masses(former, number)),
        untold=(
            f"drive: {former.motor_inertia_kg_m2:g} kg m2 at the crank, its mass is not known",
            f"crank: {len(offsets)} times {former.bank.crank_inertia_kg_m2:g} kg m2 about the shaft, no mass known",
        ),
    )


def _masses(former: Former, number: int) -> tuple[Inertia, ...]:
    """Return a cart, and its rod as the machine counts it: half of its mass at either end."""
    bank = former.bank
    half, pin_mass = float(bank.rod_half_kg[number - 1]), float(bank.mass_kg[number - 1])
    rod = Inertia(f"rod_{number}", 2.0 * half, (0.5 * bank.rod_m, 0.0), 0.5 * half * bank.rod_m**2)
    return (Inertia(f"cart_{number}", pin_mass - half), rod)


def _cart(former: Former, number: int, offset_rad: float) -> tuple[Joint, ...]:
    bank = former.bank
    pin = (bank.crank_m * cos(offset_rad), bank.crank_m * sin(offset_rad))
    # the rod's angle is counted clockwise from +x, from its pin to the cart
    return (
        turning("crank", "crank", f"crank_pin_{number}", pin, ratio=-1.0),
        turning(f"rod_{number}", f"crank_pin_{number}", f"rod_{number}", ratio=-1.0),
        fixed(f"rod_{number}", f"rod_end_{number}", (bank.rod_m, 0.0)),
        sliding(f"cart_{number}", ROOT, f"cart_{number}", (1.0, 0.0), bank.crank_m + bank.rod_m),
        fixed(f"cart_{number}", f"cart_pin_{number}"),
        fixed(f"cart_{number}", f"guide_front_{number}", (bank.p_m - bank.b_m, 0.0)),
        fixed(f"cart_{number}", f"guide_rear_{number}", (bank.p_m + bank.b_m, 0.0)),
    )


def _bars(former: Former, number: int, offset_rad: float) -> tuple[Bar, ...]:
    bank, colour = former.bank, COLOURS[(number - 1) % len(COLOURS)]
    pin = (bank.crank_m * cos(offset_rad), bank.crank_m * sin(offset_rad))
    return (
        Bar("crank", (0.0, 0.0), pin, 0.012, colour),
        Bar(f"rod_{number}", (0.0, 0.0), (bank.rod_m, 0.0), 0.008, colour),
        Bar(f"cart_{number}", (0.0, 0.0), (bank.p_m + bank.b_m + 0.05, 0.0), 1.6 * BODY_HALF_HEIGHT_M, colour),
    )
