# SPDX-License-Identifier: Apache-2.0
"""Drawing of the vibration crank in the frame of its crank bearing."""

from math import cos, hypot, sin

from mech_twin.capabilities.figure import (
    CRANK,
    FOLLOWER,
    GROUND,
    MATERIAL,
    ROD,
    STEEL,
    Point,
    bearing,
    box,
    circle,
    hatched,
)
from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, Inertia, Joint, Loop, fixed, sliding, turning
from mech_twin.machines.vibration_crank.slider_crank import BOOM, FINITE_ROD, INFINITE_ROD, SliderCrank, follower
from mech_twin.samples import LinkageSample, Shape


def drawing(s: SliderCrank, linkage: LinkageSample) -> tuple[Shape, ...]:
    """Return bearing, crank with counterweight, rod, and slider in its guide or boom, with the held tree."""
    th = linkage.joint("crank").position
    at = follower(s, th)
    crank = (s.crank_m * cos(th), s.crank_m * sin(th))
    weight = (-s.counter_m * cos(th), -s.counter_m * sin(th))
    joint = (at.x, at.y)
    end = joint if s.kind >= FINITE_ROD else (crank[0], at.y)
    return (
        Shape("frame", "line", bearing((0.0, 0.0), 0.28 * s.crank_m), GROUND, 0.005),
        *(_boom(s, joint) if s.kind == BOOM else _slider(s, joint)),
        Shape("crank", "line", (weight, (0.0, 0.0), crank), CRANK, 0.024, "crank"),
        Shape("counterweight", "points", (weight,), STEEL, 0.09, "counterweight"),
        Shape("rod", "line", (crank, end), ROD, 0.018, "rod"),
        Shape("joints", "points", ((0.0, 0.0), crank, joint), STEEL, 0.030),
    )


def _slider(s: SliderCrank, joint: Point) -> list[Shape]:
    """Return the slider with the tree it holds, and its guide over the whole travel."""
    half = 0.45 * s.crank_m
    ends = [-s.crank_m, s.crank_m]  # of the joint, to the rod's length where it is infinite
    if s.kind >= FINITE_ROD:
        ends = [follower(s, 0.0174532925199433 * degree).y for degree in range(0, 360, 15)]
    low, high = min(ends), max(ends)
    left, right = s.offset_m - 1.25 * half, s.offset_m + 1.25 * half
    guide = hatched((right, high + half), (right, low - half), 0.3 * half)
    grip = joint[1] + half
    tree = box(joint[0] - 0.4 * half, grip, joint[0] + 0.4 * half, grip + 3.0 * half)
    return [
        Shape("guide_left", "line", hatched((left, low - half), (left, high + half), 0.3 * half), GROUND, 0.005),
        Shape("guide_right", "line", guide, GROUND, 0.005, "guide"),
        Shape("slider", "line", ((joint[0] - half, joint[1]), (joint[0] + half, joint[1])), FOLLOWER, 0.07, "slider"),
        Shape("tree", "line", tree, MATERIAL, 0.010, "held tree"),
    ]


def _boom(s: SliderCrank, joint: Point) -> list[Shape]:
    """Return the boom on its pivot, and the held tree in its gripper."""
    pivot = (s.pivot_x_m, s.pivot_y_m)
    load = (pivot[0] + s.load_ratio * (joint[0] - pivot[0]), pivot[1] + s.load_ratio * (joint[1] - pivot[1]))
    radius = 0.05 * max(hypot(load[0] - pivot[0], load[1] - pivot[1]), s.crank_m)
    return [
        Shape("pivot", "line", bearing(pivot, 0.28 * s.crank_m), GROUND, 0.005),
        Shape("boom", "line", (pivot, joint, load), FOLLOWER, 0.02, "boom"),
        Shape("load", "points", (load,), FOLLOWER, 0.06),
        Shape("tree", "line", circle(load, radius), MATERIAL, 0.010, "held tree"),
    ]


RED, BLUE, GREEN, GREY = (200, 60, 40), (60, 90, 180), (90, 140, 60), (60, 60, 60)
HALVES = "masses are points: half of the rod's turns with the crank pin, half of it moves with the follower"


def mechanism(s: SliderCrank) -> FrameTree:
    """Return the frames; an infinite rod has no end, so that chain is not closed.

    The masses are the model's points: at the crank pin, the counterweight, the follower.
    """
    follower_frames: tuple[Joint, ...] = (
        sliding("slider", ROOT, "slider", (0.0, 1.0), s.crank_m + s.rod_m + abs(s.offset_m), (s.offset_m, 0.0)),
        fixed("slider", "follower_pin"),
        fixed("slider", "guide"),
    )
    bars = [Bar("slider", (-0.3 * s.crank_m, 0.0), (0.3 * s.crank_m, 0.0), 0.05, GREEN)]
    masses = [Inertia("slider", s.joint_mass)]
    if s.kind == BOOM:
        load = (s.load_ratio * s.boom_m, 0.0)
        follower_frames = (
            fixed(ROOT, "boom_pivot", (s.pivot_x_m, s.pivot_y_m)),
            turning("boom", "boom_pivot", "boom"),
            turning("boom", "boom", "follower_pin", (s.boom_m, 0.0), ratio=-1.0),
            fixed("boom", "load", load),
        )
        bars = [Bar("boom", (0.0, 0.0), (max(1.0, s.load_ratio) * s.boom_m, 0.0), 0.02, GREEN)]
        masses = [Inertia("boom", s.joint_mass, (s.boom_m, 0.0)), Inertia("boom", s.load_mass, load)]
    joints = [
        fixed(ROOT, "crank_bearing"),
        turning("crank", "crank_bearing", "crank"),
        fixed("crank", "counterweight", (-s.counter_m, 0.0)),
        turning("crank", "crank", "crank_pin", (s.crank_m, 0.0), ratio=-1.0),
        turning("rod", "crank_pin", "rod"),
        *follower_frames,
    ]
    loops = []
    if s.kind != INFINITE_ROD:
        joints.append(fixed("rod", "rod_end", (s.rod_m, 0.0)))
        loops.append(Loop("rod_end", "follower_pin"))
        bars.append(Bar("rod", (0.0, 0.0), (s.rod_m, 0.0), 0.012, BLUE))
    crank = (
        Bar("crank", (0.0, 0.0), (s.crank_m, 0.0), 0.02, RED),
        Bar("crank", (0.0, 0.0), (-s.counter_m, 0.0), 0.02, RED),
        Bar("counterweight", (-0.025, 0.0), (0.025, 0.0), 0.05, GREY),
    )
    turning_masses = Inertia("crank", s.rotating_mass, (s.crank_m, 0.0)), Inertia("counterweight", s.counter_mass)
    return FrameTree(
        tuple(joints), tuple(loops), (*crank, *bars), inertias=(*turning_masses, *masses), mass_remarks=(HALVES,)
    )
