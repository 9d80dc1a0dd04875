# SPDX-License-Identifier: Apache-2.0
"""What a page draws of its gears and turning springs moves as they do."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from machines.page.pages import page

from mech_twin.machines.page import build

GEARS = """
ground: {points_m: {a: [0, 0], b: [0.3, 0.1], c: [0.5, 0.5], d: [0, -0.3]}}
bodies:
  pinion: {inertia_kg_m2: 0.1}
  wheel: {inertia_kg_m2: 0.3}
  fan: {inertia_kg_m2: 0.2}
  bar: {mass_kg: 1}
joints:
  first: {kind: revolute, between: [ground.a, pinion], start_deg: 7}
  second: {kind: revolute, between: [ground.b, wheel], start_deg: 0.0}
  third: {kind: revolute, between: [ground.c, fan], start_deg: 0.0}
  guide: {kind: slider, between: [ground.d, bar], start_m: 0.0}
couplings:
  mesh: {kind: gear, joints: [first, second], ratio: -0.5}
  belt: {kind: belt, joints: [second, third], ratio: 2.0}
  teeth: {kind: rack, joints: [first, guide], radius_m: 0.1}
springs: {coil: {joint: third, rate_nm_per_rad: 2.0, free_deg: 0.0}}
"""


def drawn(turned, ratio=-0.5):
    """Return the drawing with the first gear turned further from its start (rad)."""
    machine = build(page(GEARS, couplings={"mesh": {"ratio": ratio}}))
    start = machine.linkage.start()
    by = {"first": turned, "second": ratio * turned, "third": 2.0 * ratio * turned, "guide": 0.1 * turned}
    moved = tuple(at + by[name] for name, at in zip(start.joints, start.position, strict=True))
    return {shape.name: shape.points_m for shape in machine.draw(start._replace(position=moved), None)}


def inside(point, strip):
    """Return whether a closed strip surrounds a point."""
    x, y = point
    found = False
    for (ax, ay), (bx, by) in pairwise(strip):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            found = not found
    return found


@pytest.mark.parametrize("turned", [0.0, 0.13, 0.61, 2.9, -1.7])
def test_no_tooth_of_a_gear_stands_in_the_other(turned):
    shapes = drawn(turned)
    first, second = shapes["mesh_first"], shapes["mesh_second"]
    middle = math.hypot(0.3, 0.1) / 3.0
    assert max(math.hypot(x, y) for x, y in first) > middle > min(math.hypot(x, y) for x, y in first)
    # of the profile at the pitch point: where one has its tooth, the other has its gap
    spot = 0.1, 0.1 / 3.0
    edge = min(math.dist(spot, (0.5 * (ax + bx), 0.5 * (ay + by))) for (ax, ay), (bx, by) in pairwise(first))
    if edge > 1e-3:
        assert inside(spot, first) != inside(spot, second)


def turn_of(before, after, centre):
    """Return by which angle the first point of a strip has turned about a centre (rad)."""
    (ax, ay), (bx, by) = before[0], after[0]
    change = math.atan2(by - centre[1], bx - centre[0]) - math.atan2(ay - centre[1], ax - centre[0])
    return math.remainder(change, 2.0 * math.pi)


@pytest.mark.parametrize("ratio", [-0.5, 0.5, 3.0])
def test_drawn_gears_turn_by_their_ratio(ratio):
    before, after = drawn(0.0, ratio), drawn(0.2, ratio)
    assert turn_of(before["mesh_first"], after["mesh_first"], (0.0, 0.0)) == pytest.approx(0.2, abs=1e-12)
    assert turn_of(before["mesh_second"], after["mesh_second"], (0.3, 0.1)) == pytest.approx(0.2 * ratio, abs=1e-12)


def test_a_rack_moves_with_its_pinion_and_a_spiral_with_its_body():
    before, after = drawn(0.0), drawn(0.05)
    moved = after["teeth_rack"][0][0] - before["teeth_rack"][0][0] - 0.1 * 0.05
    pitch = 2.0 * math.pi * 0.1 / 20  # the part that is drawn stays at the pinion
    assert math.remainder(moved, pitch) == pytest.approx(0.0, abs=1e-12)
    assert turn_of(before["coil"], after["coil"], (0.5, 0.5)) == pytest.approx(-0.05, abs=1e-12)
    assert before["coil"][-1] == pytest.approx(after["coil"][-1], abs=1e-12)
    assert len({"belt_0", "belt_1", "belt_upper", "belt_lower"} & set(before)) == 4
