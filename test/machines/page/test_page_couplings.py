# SPDX-License-Identifier: Apache-2.0
"""Gears, belts and racks of a page: their ratio, their swing, and what they lose, against closed forms."""

from __future__ import annotations

import math

import pytest
from machines.page.pages import page
from machines.page.test_page_elements import TWO_WHEELS, balanced

from mech_twin.declarations.configuration_tree import configuration_tree, merged_tree, tree_from_flat
from mech_twin.machines.page.parameters import Page
from mech_twin.parameters.live_change import live_numbers

FIRST, SECOND, SPEED = 0.2, 0.3, 2.0  # inertias of the two wheels (kg m2), speed of the first at the start (rad/s)
PINION = """
gravity_m_per_s2: [0, 0]
bodies: {pinion: {inertia_kg_m2: 0.2}, bar: {mass_kg: 4}}
joints:
  first_shaft: {kind: revolute, between: [ground, pinion], start_rad_per_s: 2}
  guide: {kind: slider, between: [ground, bar], direction_deg: 30, start_m: 0.2}
"""


def gear(kind, ratio, rate, **keys):
    return {
        "train": {"kind": kind, "joints": ["first_shaft", "second_shaft"], "ratio": ratio, "rate_nm_per_rad": rate}
        | keys
    }


@pytest.mark.parametrize(("kind", "ratio"), [("gear", -3.0), ("belt", 0.4)])
def test_a_gear_swings_about_its_ratio_at_the_frequency_of_both_inertias(kind, ratio):
    rate = 600.0
    told, _ = balanced(TWO_WHEELS, 0.3, couplings=gear(kind, ratio, rate))
    w = math.sqrt(rate * (ratio**2 / FIRST + 1.0 / SECOND))
    for frame in told[::20]:
        t = frame.linkage.time_s
        miss = ratio * SPEED / w * math.sin(w * t)
        (first, second), (v1, v2) = frame.linkage.position, frame.linkage.velocity
        assert ratio * first - second == pytest.approx(miss, abs=1e-10)
        assert v2 == pytest.approx(rate / SECOND * ratio * SPEED / w**2 * (1.0 - math.cos(w * t)), abs=1e-9)
        assert FIRST * v1 + ratio * SECOND * v2 == pytest.approx(FIRST * SPEED, abs=1e-11)
        assert frame.forces.quantities["train_moment_nm"] == pytest.approx(-rate * miss, abs=1e-7)


def test_a_rack_takes_the_slider_along_by_its_radius():
    radius, rate, mass = -0.05, 2.0e5, 4.0
    rack = {"rack": {"kind": "rack", "joints": ["first_shaft", "guide"], "radius_m": radius, "rate_n_per_m": rate}}
    told, _ = balanced(PINION, 0.3, couplings=rack)
    w = math.sqrt(rate * (radius**2 / FIRST + 1.0 / mass))
    for frame in told[::20]:
        t = frame.linkage.time_s
        miss = radius * SPEED / w * math.sin(w * t)
        first, travel = frame.linkage.position
        assert radius * first - (travel - 0.2) == pytest.approx(miss, abs=1e-11)
        v1, v2 = frame.linkage.velocity
        assert FIRST * v1 + radius * mass * v2 == pytest.approx(FIRST * SPEED, abs=1e-11)


def test_a_coupling_of_a_joint_with_itself_is_refused():
    shaft = {"kind": "shaft", "joints": ["first_shaft", "first_shaft"], "rate_nm_per_rad": 1.0}
    with pytest.raises(ValueError, match=r"couplings\.train\.joints: 'first_shaft' stands twice"):
        page(TWO_WHEELS, couplings={"train": shaft})


@pytest.mark.parametrize(("drive", "load"), [(10.0, -2.0), (-4.0, 12.0)])
def test_a_gear_loses_its_share_whichever_side_drives(drive, load):
    """Once the swing has died away both sides gather speed together: M = J a + i (J i a - W) / eta, or times eta."""
    ratio, eta = 0.5, 0.8
    train = gear("gear", ratio, 3000.0, damping_nms_per_rad=20.0, efficiency=eta)
    loads = {"drive": {"body": "first", "torque_nm": drive}, "load": {"body": "second", "torque_nm": load}}
    told, _ = balanced(TWO_WHEELS, 1.0, couplings=train, loads=loads)
    share = eta if drive > 0.0 else 1.0 / eta
    a = (drive + ratio * load / share) / (FIRST + ratio**2 * SECOND / share)
    early, late = told[600].linkage, told[1000].linkage
    assert (late.velocity[0] - early.velocity[0]) / 0.4 == pytest.approx(a, rel=1e-9)
    assert (late.velocity[1] - early.velocity[1]) / 0.4 == pytest.approx(ratio * a, rel=1e-9)
    moment = (SECOND * ratio * a - load) / share
    way = late.position[1] - early.position[1]
    lost = late.memory["train_loss_work_j"] - early.memory["train_loss_work_j"]
    assert lost == pytest.approx((share - 1.0) * moment * way, rel=1e-9)
    assert lost < 0.0


def test_a_gear_with_play_carries_nothing_across_it():
    told, simulation = balanced(TWO_WHEELS, 0.05, couplings=gear("gear", -2.0, 600.0, backlash_deg=6.0))
    met = simulation.events[0]
    assert (met.kind, met.contact) == ("contact", "train_backward")
    assert met.time_s == pytest.approx(math.radians(3.0) / (2.0 * SPEED), abs=1e-9)
    assert all(f.linkage.velocity[1] == 0.0 for f in told if f.linkage.time_s < met.time_s)


@pytest.mark.parametrize(
    ("coupling", "live"),
    [
        ({"kind": "belt", "ratio": 2, "rate_nm_per_rad": 9}, ["damping_nms_per_rad", "rate_nm_per_rad"]),
        ({"kind": "gear", "ratio": 2}, []),
        ({"kind": "rack", "radius_m": 1, "rate_n_per_m": 9}, ["damping_ns_per_m", "rate_n_per_m"]),
        ({"kind": "rack", "radius_m": 1}, []),
    ],
)
def test_each_live_key_of_a_coupling_may_change(coupling, live):
    second = {"kind": "slider", "between": ["ground", "second"]} if coupling["kind"] == "rack" else {}
    joints = {"first_shaft": {"start_rad_per_s": None}, "second_shaft": second}
    tree = page(TWO_WHEELS, joints=joints, couplings={"one": {**coupling, "joints": ["first_shaft", "second_shaft"]}})
    found = {name: value for name, value in live_numbers(tree).items() if name.startswith("couplings.")}
    assert sorted(name.removeprefix("couplings.one.") for name in found) == live
    for name, value in found.items():
        Page.model_validate(merged_tree(configuration_tree(tree), tree_from_flat({name: 1.0 + value})))
