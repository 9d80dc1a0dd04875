# SPDX-License-Identifier: Apache-2.0
"""Drawing of the press in the frame of its crank bearing."""

from mech_twin.capabilities.figure import (
    CRANK,
    FOLLOWER,
    FORCE,
    GROUND,
    MATERIAL,
    MEASURE,
    ROD,
    STEEL,
    bearing,
    box,
    hatched,
    label,
    measure,
    millimetres,
)
from mech_twin.capabilities.mechanism import Bar, FrameTree, fixed, four_bar_chain, four_bar_masses
from mech_twin.machines.compaction_press.dynamics import JOINTS, Press, loaded_offset, press_reduced
from mech_twin.parts.four_bar import position
from mech_twin.samples import LinkageSample, Shape

LAYER_HALF_M = 0.13
LAYER_BELOW_M = 0.07  # drawn part of the layer below the deepest point of the stroke
ARROW_M = 0.15  # length of the layer's force at its peak


def drawing(press: Press, linkage: LinkageSample) -> tuple[Shape, ...]:
    """Return ground, layer with its stroke, crank, plate, pendulum, pins, and the layer's force where it acts."""
    angle = linkage.joint("crank").position
    at = position(press.bar, angle)
    x, y = loaded_offset(press, at)
    load = (at.a_x + x, at.a_y + y)
    o, a, b = (0.0, 0.0), (at.a_x, at.a_y), (at.b_x, at.b_y)
    c = (press.bar.pivot_x_m, press.bar.pivot_y_m)
    force = press_reduced(press, angle, linkage.regime).force
    length = ARROW_M * force / press.load.peak_n if force > 0.0 else 0.0
    name = f"layer {force:.0f} N" if length else ""
    return (
        *_layer(press, load, pressed=force > 0.0),
        Shape("frame", "line", bearing(o, 0.03), GROUND, 0.004),
        Shape("pendulum_frame", "line", bearing(c, 0.03, hanging=True), GROUND, 0.004),
        Shape("crank", "line", (o, a), CRANK, 0.02, "crank"),
        Shape("plate", "line", (a, b), ROD, 0.025, "plate"),
        Shape("pendulum", "line", (c, b), FOLLOWER, 0.015, "pendulum"),
        Shape("pins", "points", (o, a, b, c), STEEL, 0.016),
        Shape("loaded_point", "points", (load,), FORCE, 0.016),
        Shape("working_force", "arrow", ((load[0], load[1] - length), load), FORCE, 0.008, name),
    )


def _layer(press: Press, load: tuple[float, float], *, pressed: bool) -> tuple[Shape, ...]:
    """Return the layer with its free height, and the depth of the working stroke beside it."""
    top, bottom = press.load.contact_y_m, press.load.bottom_y_m
    middle, floor = press.along_m - press.bar.crank_m, bottom - LAYER_BELOW_M
    left, right = middle - LAYER_HALF_M, middle + LAYER_HALF_M
    surface = min(top, load[1]) if pressed else top
    layers = [floor + share * (surface - floor) for share in (0.25, 0.5, 0.75)]
    edge = right + 0.04
    return (
        Shape("ground", "line", hatched((left - 0.05, floor), (right + 0.05, floor), 0.02), GROUND, 0.005),
        Shape("layer", "line", box(left, floor, right, surface), MATERIAL, 0.006, "layer"),
        *(Shape(f"grain_{i}", "line", ((left, y), (right, y)), MATERIAL, 0.002) for i, y in enumerate(layers, 1)),
        measure("stroke", (edge, bottom), (edge, top), "", 0.03),
        label("stroke_name", (edge + 0.05, bottom - 0.02), f"stroke {millimetres(top - bottom)}", MEASURE),
    )


def mechanism(press: Press) -> FrameTree:
    """Return crank, plate and pendulum; ``loaded_point`` is where the layer's force acts on the plate."""
    bar = press.bar
    lengths = (bar.crank_m, bar.coupler_m, bar.rocker_m)
    joints, loop = four_bar_chain(JOINTS, lengths, (bar.pivot_x_m, bar.pivot_y_m))
    return FrameTree(
        (*joints, fixed("plate", "loaded_point", (press.along_m, press.across_m))),
        (loop,),
        (
            Bar("crank", (0.0, 0.0), (bar.crank_m, 0.0), 0.02, (200, 60, 40)),
            Bar("plate", (0.0, 0.0), (bar.coupler_m, 0.0), 0.025, (60, 90, 180)),
            Bar("pendulum", (0.0, 0.0), (bar.rocker_m, 0.0), 0.015, (90, 140, 60)),
        ),
        inertias=four_bar_masses(JOINTS, (press.crank, press.plate, press.pendulum)),
    )
