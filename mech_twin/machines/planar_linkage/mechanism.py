# SPDX-License-Identifier: Apache-2.0
"""Frames of the planar linkage: each link, the pins at its ends, and the loops that the dyads close."""

from __future__ import annotations

from math import radians

from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, Joint, Loop, Point, fixed, sliding, turning
from mech_twin.machines.planar_linkage.parameters import Dyad, PlanarLinkageParameters

COLOURS = ((75, 115, 205), (90, 140, 60), (200, 140, 40), (150, 95, 185))
RED = (200, 60, 40)


class _Orientation:
    """Which joint gives a link's angle (empty: none), and by how much the link is turned against it (rad)."""

    def __init__(self, joint: str, turned_rad: float = 0.0) -> None:
        self.joint, self.turned_rad = joint, turned_rad


def mechanism(p: PlanarLinkageParameters) -> FrameTree:
    """Return the frames; every pin has the axes of the machine."""
    angles = {"ground": _Orientation(""), "crank": _Orientation("crank")}
    joints: list[Joint] = [fixed(ROOT, "crank_bearing"), turning("crank", "crank_bearing", "crank")]
    loops: list[Loop] = []
    for key, dyad in p.dyads.items():
        made, loop = _dyad(key, dyad, p, angles)
        joints += made
        loops.append(loop)
    return FrameTree(tuple(joints), tuple(loops), _bars(p))


def _pin(name: str, link: str, at: Point, angles: dict[str, _Orientation]) -> Joint:
    """Return the frame of a pin on a link, turned back to the axes of the machine."""
    parent, host = ROOT if link == "ground" else link, angles[link]
    if not host.joint:
        return fixed(parent, name, at, -host.turned_rad)
    return turning(host.joint, parent, name, at, ratio=-1.0, turned_rad=-host.turned_rad)


def _dyad(
    key: str, dyad: Dyad, p: PlanarLinkageParameters, angles: dict[str, _Orientation]
) -> tuple[list[Joint], Loop]:
    first, second = f"{key}_first", f"{key}_second"
    a = (p.length_m(dyad.from_link) if dyad.from_x_m is None else dyad.from_x_m, dyad.from_y_m)
    b, reach = (dyad.to_x_m, dyad.to_y_m), p.size_m
    start = _pin(f"{key}_from", dyad.from_link, a, angles)
    if dyad.kind == "rpr":
        angles[first] = angles[second] = _Orientation(second)
        return [
            start,
            _pin(f"{key}_to", dyad.to_link, b, angles),
            turning(second, f"{key}_to", second),
            sliding(first, second, first, (1.0, 0.0), reach),
            _pin(f"{key}_between", first, (0.0, 0.0), angles),
        ], Loop(f"{key}_from", f"{key}_between")
    angles[first] = _Orientation(first)
    joints = [start, turning(first, f"{key}_from", first)]
    joints.append(_pin(f"{key}_between", first, (dyad.first_m or 0.0, 0.0), angles))
    if dyad.kind == "rrr":
        angles[second] = _Orientation(second)
        joints += [_pin(f"{key}_to", dyad.to_link, b, angles), turning(second, f"{key}_to", second)]
        joints.append(fixed(second, f"{second}_end", (dyad.second_m or 0.0, 0.0)))
        return joints, Loop(f"{key}_between", f"{second}_end")
    host, turned = angles[dyad.to_link], radians(dyad.guide_deg)
    angles[second] = _Orientation(host.joint, host.turned_rad + turned)
    parent = ROOT if dyad.to_link == "ground" else dyad.to_link
    joints += [
        fixed(parent, f"{key}_guide", b, turned),
        sliding(second, f"{key}_guide", second, (1.0, 0.0), reach),
        _pin(f"{key}_to", second, (0.0, 0.0), angles),
    ]
    return joints, Loop(f"{key}_between", f"{key}_to")


def _bars(p: PlanarLinkageParameters) -> tuple[Bar, ...]:
    width = 0.03 * p.size_m
    bars = [Bar("crank", (0.0, 0.0), (p.crank.length_m, 0.0), width, RED)]
    for k, (key, dyad) in enumerate(p.dyads.items()):
        colour = COLOURS[k]
        block = (-2.0 * width, 0.0), (2.0 * width, 0.0)
        ends = (
            (block if dyad.kind == "rpr" else ((0.0, 0.0), (dyad.first_m or 0.0, 0.0))),
            (block if dyad.kind == "rrp" else ((0.0, 0.0), (dyad.second_m or 4.0 * width, 0.0))),
        )
        for name, (tail, head) in zip((f"{key}_first", f"{key}_second"), ends, strict=True):
            bars.append(Bar(name, tail, head, width, colour))
    return tuple(bars)
