# SPDX-License-Identifier: Apache-2.0
"""Firm gears, belts and racks of a page: their ratio to rounding, their force, and what they lead, by closed forms."""

from __future__ import annotations

import math

import pytest
from machines.page.pages import page
from machines.page.test_page_couplings import FIRST, PINION, SECOND, SPEED
from machines.page.test_page_elements import TWO_WHEELS, balanced

FOUR_BAR = """
gravity_m_per_s2: [0, 0]
ground: {points_m: {far: [0.3, 0], beside: [0.6, 0]}}
bodies:
  crank: {inertia_kg_m2: 0.01, points_m: {pin: [0.1, 0]}}
  rod: {mass_kg: 1, inertia_kg_m2: 0.01, centre_m: [0.15, 0], points_m: {end: [0.3, 0]}}
  rocker: {inertia_kg_m2: 0.02, points_m: {pin: [0.2, 0]}}
  wheel: {inertia_kg_m2: 0.03}
joints:
  shaft: {kind: revolute, between: [ground, crank], start_deg: 60}
  pin: {kind: revolute, between: [crank.pin, rod]}
  pivot: {kind: revolute, between: [ground.far, rocker], start_deg: 110}
  end: {kind: revolute, between: [rod.end, rocker.pin]}
  bearing: {kind: revolute, between: [ground.beside, wheel], start_deg: 20}
drives: {motor: {kind: constant_speed, joint: shaft, speed_rpm: 120}}
"""


def train(kind, ratio, joints=("first_shaft", "second_shaft"), **keys):
    return {"train": {"kind": kind, "joints": list(joints), "ratio": ratio} | keys}


@pytest.mark.parametrize(("kind", "ratio"), [("gear", -3.0), ("belt", 0.4)])
def test_a_firm_gear_adds_the_inertia_behind_it_by_the_square_of_its_ratio(kind, ratio):
    loads = {"drive": {"body": "first", "torque_nm": 5.0}}
    told, _ = balanced(TWO_WHEELS, 0.5, couplings=train(kind, ratio), loads=loads)
    a = 5.0 / (FIRST + ratio**2 * SECOND)
    begun = told[0].linkage.position
    for frame in told[::20]:
        t, (first, second), (v1, v2) = frame.linkage.time_s, frame.linkage.position, frame.linkage.velocity
        assert v1 == pytest.approx(SPEED + a * t, rel=1e-12)
        assert v2 == pytest.approx(ratio * v1, rel=1e-13)
        assert second - begun[1] == pytest.approx(ratio * (first - begun[0]), abs=1e-12)
        assert frame.forces.quantities["train_moment_nm"] == pytest.approx(-SECOND * ratio * a, rel=1e-9)


def test_a_firm_rack_carries_the_mass_of_its_slider_on_the_pinion():
    radius, mass, force = -0.05, 4.0, 30.0
    rack = {"rack": {"kind": "rack", "joints": ["first_shaft", "guide"], "radius_m": radius}}
    loads = {"push": {"joint": "guide", "table_m_per_s_n": [[-100.0, force], [100.0, force]]}}
    told, _ = balanced(PINION, 0.3, couplings=rack, loads=loads)
    a = radius * force / (FIRST + radius**2 * mass)
    for frame in told[::20]:
        t, (first, travel), (v1, v2) = frame.linkage.time_s, frame.linkage.position, frame.linkage.velocity
        assert v1 == pytest.approx(SPEED + a * t, rel=1e-12)
        assert v2 == pytest.approx(radius * v1, rel=1e-13)
        assert travel - 0.2 == pytest.approx(radius * first, abs=1e-13)
        assert frame.forces.quantities["rack_force_n"] == pytest.approx(force - mass * radius * a, rel=1e-9)


def test_a_stiff_gear_comes_to_the_firm_one():
    """What both miss falls with the rate: they are two routes to one motion."""
    still = TWO_WHEELS.replace("start_rad_per_s: 2", "start_rad_per_s: 0")
    loads = {"drive": {"body": "first", "torque_nm": 5.0}}
    firm, _ = balanced(still, 0.2, couplings=train("gear", 0.5), loads=loads)
    misses = []
    for rate in (1e4, 1e6):
        keys = {"rate_nm_per_rad": rate, "damping_nms_per_rad": 2.0 * math.sqrt(rate * 0.1)}
        stiff, _ = balanced(still, 0.2, couplings=train("gear", 0.5, **keys), loads=loads)
        misses.append(abs(stiff[-1].linkage.position[1] - firm[-1].linkage.position[1]))
    assert misses[1] == pytest.approx(0.01 * misses[0], rel=0.05)


def test_a_firm_gear_on_the_rocker_of_a_four_bar_turns_its_wheel():
    """The wheel meshes as it starts, and adds its inertia to the rocker by the square of the ratio."""
    ratio = -2.5
    geared, _ = balanced(FOUR_BAR, 1.0, couplings=train("gear", ratio, ("pivot", "bearing")))
    heavy = FOUR_BAR.replace("inertia_kg_m2: 0.02", f"inertia_kg_m2: {0.02 + ratio**2 * 0.03}")
    alone, _ = balanced(heavy, 1.0)
    begun = geared[0].linkage.position
    assert begun[4] == pytest.approx(math.radians(20.0), abs=1e-13)
    for one, other in zip(geared[::25], alone[::25], strict=True):
        place = one.linkage.position
        assert place[:4] == pytest.approx(other.linkage.position[:4], abs=1e-11)
        assert place[4] - begun[4] == pytest.approx(ratio * (place[2] - begun[2]), abs=1e-12)
        torque = one.forces.quantities["motor_torque_nm"]
        assert torque == pytest.approx(other.forces.quantities["motor_torque_nm"], abs=1e-8)


def test_play_and_loss_of_a_firm_gear_are_refused_with_the_key_they_need():
    with pytest.raises(ValueError, match="need the key rate_nm_per_rad; without it a gear is firm"):
        page(TWO_WHEELS, couplings=train("gear", 0.5, efficiency=0.9))


def test_a_gear_between_joints_that_a_loop_leads_already_is_named():
    with pytest.raises(
        ValueError, match=r"couplings\.again: the joints before it hold its bodies already.*take a coupling away"
    ):
        balanced(FOUR_BAR.partition("drives:")[0], 0.1, couplings=train("gear", 2.0, ("shaft", "pivot")) | {
            "again": {"kind": "gear", "joints": ["shaft", "pivot"], "ratio": 2.0}})  # fmt: skip
