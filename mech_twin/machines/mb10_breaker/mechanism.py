# SPDX-License-Identifier: Apache-2.0
"""Frames of the breaker: the body turns clockwise, everything but tool and wall is carried by it."""

from __future__ import annotations

import math

from mech_twin.capabilities.mechanism import (
    ROOT,
    Bar,
    FrameTree,
    Inertia,
    fixed,
    four_bar_chain,
    inertia_about_origin,
    turning,
)
from mech_twin.machines.mb10_breaker.dynamics import Breaker

PINS = ("crank_bearing", "crank_pin", "rocker_pin", "rocker_bearing")
TOOL_LENGTH_M = 0.12  # drawn


def mechanism(b: Breaker, striker_angle_deg: float) -> FrameTree:
    """Return body, crank, coupler and rocker, the struck face (`tool`, x along the blow) and the striker's tip.

    A pin's reaction is given in the machine's axes, the linkage's angles in the body's: each pin has a frame of
    either kind (``..._axes``: the body's).
    """
    bar, swing = b.bar, math.radians(striker_angle_deg)
    lengths, pivot = (bar.crank_m, bar.coupler_m, bar.rocker_m), (bar.pivot_x_m, bar.pivot_y_m)
    joints, loop = four_bar_chain(("crank", "coupler", "rocker"), lengths, pivot, "body")
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
            inertia_about_origin("crank", b.crank.mass_kg, (b.crank.along_m, b.crank.across_m), b.crank.inertia_kg_m2),
            Inertia("coupler", b.coupler.mass_kg, (b.coupler.along_m, b.coupler.across_m), b.coupler.inertia_kg_m2),
            Inertia("rocker", b.rocker.mass_kg, (b.rocker.along_m, b.rocker.across_m), b.rocker.inertia_kg_m2),
            Inertia("tool", b.tool_mass_kg),
        ),
        untold=(f"body: {b.body_inertia_kg_m2:g} kg m2 about the crank axis, its mass is not known",),
    )
