# SPDX-License-Identifier: Apache-2.0
"""Frames of the vibration crank: crank with counterweight, rod, and slider or boom."""

from __future__ import annotations

from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, Inertia, Joint, Loop, fixed, sliding, turning
from mech_twin.machines.vibration_crank.slider_crank import BOOM, INFINITE_ROD, SliderCrank

RED, BLUE, GREEN, GREY = (200, 60, 40), (60, 90, 180), (90, 140, 60), (60, 60, 60)
HALVES = "masses are points: half of the rod's turns with the crank pin, half of it moves with the follower"


def mechanism(s: SliderCrank) -> FrameTree:
    """Return the frames; an infinite rod has no end, so that chain is not closed."""
    joints = (
        fixed(ROOT, "crank_bearing"),
        turning("crank", "crank_bearing", "crank"),
        fixed("crank", "counterweight", (-s.counter_m, 0.0)),
        turning("crank", "crank", "crank_pin", (s.crank_m, 0.0), ratio=-1.0),
        turning("rod", "crank_pin", "rod"),
        *(_boom(s) if s.kind == BOOM else _slider(s)),
    )
    crank = (
        Bar("crank", (0.0, 0.0), (s.crank_m, 0.0), 0.02, RED),
        Bar("crank", (0.0, 0.0), (-s.counter_m, 0.0), 0.02, RED),
        Bar("counterweight", (-0.025, 0.0), (0.025, 0.0), 0.05, GREY),
    )
    bars = (*crank, *_follower_bars(s))
    if s.kind == INFINITE_ROD:
        return FrameTree(joints, (), bars, inertias=_masses(s), untold=(HALVES,))
    rod = Bar("rod", (0.0, 0.0), (s.rod_m, 0.0), 0.012, BLUE)
    return FrameTree(
        (*joints, fixed("rod", "rod_end", (s.rod_m, 0.0))), (Loop("rod_end", "follower_pin"),), (*bars, rod),
        inertias=_masses(s), untold=(HALVES,),
    )  # fmt: skip


def _masses(s: SliderCrank) -> tuple[Inertia, ...]:
    """Return the points that the machine counts its masses in: at the crank pin, the counterweight, the follower."""
    turning_masses = (Inertia("crank", s.rotating_mass, (s.crank_m, 0.0)), Inertia("counterweight", s.counter_mass))
    if s.kind == BOOM:
        joint, load = (s.boom_m, 0.0), (s.load_ratio * s.boom_m, 0.0)
        return (*turning_masses, Inertia("boom", s.joint_mass, joint), Inertia("boom", s.load_mass, load))
    return (*turning_masses, Inertia("slider", s.joint_mass))


def _slider(s: SliderCrank) -> tuple[Joint, ...]:
    travel_m = s.crank_m + s.rod_m + abs(s.offset_m)
    return (
        sliding("slider", ROOT, "slider", (0.0, 1.0), travel_m, (s.offset_m, 0.0)),
        fixed("slider", "follower_pin"),
        fixed("slider", "guide"),
    )


def _boom(s: SliderCrank) -> tuple[Joint, ...]:
    return (
        fixed(ROOT, "boom_pivot", (s.pivot_x_m, s.pivot_y_m)),
        turning("boom", "boom_pivot", "boom"),
        turning("boom", "boom", "follower_pin", (s.boom_m, 0.0), ratio=-1.0),
        fixed("boom", "load", (s.load_ratio * s.boom_m, 0.0)),
    )


def _follower_bars(s: SliderCrank) -> tuple[Bar, ...]:
    if s.kind == BOOM:
        return (Bar("boom", (0.0, 0.0), (max(1.0, s.load_ratio) * s.boom_m, 0.0), 0.02, GREEN),)
    return (Bar("slider", (-0.3 * s.crank_m, 0.0), (0.3 * s.crank_m, 0.0), 0.05, GREEN),)
