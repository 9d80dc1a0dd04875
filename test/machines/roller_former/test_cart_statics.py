# SPDX-License-Identifier: Apache-2.0
"""Laws of one cart: equilibrium, kinematics, the load kinds, missing and empty carts."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from mech_twin.machines.roller_former.cart_parameters import CartBank, CartParameters, cart_bank
from mech_twin.machines.roller_former.cart_statics import (
    cart_load,
    cart_motion,
    load_moment,
    load_moments,
    shaft_terms,
    sides_of_travel,
)

GEOMETRY = {
    "count": 1,
    "offset_deg": 0.0,
    "crank_m": 0.2,
    "rod_m": 0.8,
    "mass_kg": 197.3333,
    "rod_mass_kg": 64.0,
    "roller_force_x_n": 7962.0 / 4.5,
    "roller_force_y_n": 9740.0 / 4.5,
    "weight_n": 10124.9 / 4.5,
    "friction": 0.008,
    "guide_roller_m": 0.046,
    "a_m": 0.27,
    "b_m": 0.37,
    "p_m": 0.52,
    "e_m": 0.21,
}
ANGLES = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
ROUNDING_NM = 1e-9  # at a dead centre the moment is zero but for the last digit of pi
angles = st.floats(-20.0, 20.0)
compiled = settings(deadline=None)


def bank(load: str = "reversing", friction: str = "signed", kinematics: str = "exact", **changes: Any) -> CartBank:
    return cart_bank(CartParameters(**{**GEOMETRY, **changes}), load, friction, kinematics)


def unbalance(psi: float, sense: float, rail: bool = False) -> tuple[float, float, float]:
    """Return the three sums of (10) for the forces the twin gives, s f and s F0 for f and F0."""
    g = GEOMETRY
    load = cart_load(
        bank(friction="rail_change" if rail else "signed"), 0, psi, sense * (1.0 if math.sin(psi) >= 0.0 else -1.0)
    )
    f, force, n1, n2 = sense * g["friction"], load.rod_force_n, load.front_n, load.rear_n
    fx, fy, weight = sense * 2.0 * g["roller_force_x_n"], 2.0 * g["roller_force_y_n"], g["weight_n"]
    beta = math.asin(0.25 * math.sin(psi))
    grip = abs(n1) + abs(n2) if rail else n1 + n2
    b, p, a = g["b_m"], g["p_m"], g["a_m"]
    along = -force * math.cos(beta) + f * grip + fx
    across = force * math.sin(beta) - n1 - n2 - weight + fy
    moment = -n1 * (p - b) - n2 * (p + b) - weight * p - (n1 + n2) * f * g["guide_roller_m"] / 2.0
    moment += fx * g["e_m"] + 0.5 * fy * (p - a) + 0.5 * fy * (p + a)
    return along, across, moment


@compiled
@given(angles, st.sampled_from([1.0, -1.0]), st.booleans())
def test_the_cart_is_in_equilibrium(psi, sense, rail):
    if abs(math.sin(psi)) < 1e-6:
        return
    assert unbalance(psi, sense, rail) == pytest.approx((0.0, 0.0, 0.0), abs=1e-8)


@compiled
@given(angles)
def test_friction_on_long_arms_is_in_equilibrium_to_rounding(psi):
    """Rollers 100 m below the pin press the guides, 2 cm apart, with thousands of times the process force."""
    long_arms = {"e_m": 100.0, "b_m": 0.0108, "p_m": 0.0138, "guide_roller_m": 0.0034}
    load = cart_load(
        bank("rectified", "rail_change", **long_arms, roller_force_x_n=7e7, roller_force_y_n=0.0), 0, psi, 1.0
    )
    sine = 0.25 * math.sin(psi)
    grip = 0.008 * (abs(load.front_n) + abs(load.rear_n))
    along = 1.4e8 + grip - load.rod_force_n * math.sqrt(1.0 - sine * sine)
    assert load.rod_force_n > 1e9
    assert along == pytest.approx(0.0, abs=1e-12 * load.rod_force_n)


@compiled
@given(angles)
def test_transfer_functions_are_derivatives_of_the_position(psi):
    for kinematics in ("exact", "expanded"):
        one = bank(kinematics=kinematics)
        before, here, after = (cart_motion(one, math.sin(psi + d), math.cos(psi + d)) for d in (-1e-4, 0.0, 1e-4))
        assert here.x1 == pytest.approx((after.x - before.x) / 2e-4, abs=1e-8)
        assert here.x2 == pytest.approx((after.x1 - before.x1) / 2e-4, abs=1e-8)


@compiled
@given(angles)
def test_exact_kinematics_close_the_slider_crank(psi):
    motion = cart_motion(bank(), math.sin(psi), math.cos(psi))
    assert math.hypot(motion.x - 0.2 * math.cos(psi), 0.2 * math.sin(psi)) == pytest.approx(0.8, rel=1e-14)
    assert motion.x1 == pytest.approx(-0.2 * math.sin(psi + math.asin(motion.rod_sine)) / motion.rod_cosine, abs=1e-15)


def test_the_expansion_leaves_a_fourth_power_of_the_ratio():
    errors = []
    for rod in (0.8, 1.6):
        exact, expanded = bank(rod_m=rod), bank(rod_m=rod, kinematics="expanded")
        errors.append(
            max(abs(cart_motion(exact, s, 0.0).x - cart_motion(expanded, s, 0.0).x) / rod for s in (0.5, 1.0))
        )
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.05)


@pytest.mark.parametrize("load", ["reversing", "resist"])
@pytest.mark.parametrize("offset_deg", [0.0, 120.0, 180.0, -360.0])
def test_a_load_that_holds_drives_at_no_angle(load, offset_deg):
    """On a dead centre the sine is rounding, and has another sign 720 degrees back."""
    several = bank(load, count=3, offset_deg=offset_deg)
    assert np.all(load_moments(several, ANGLES, 1.0) >= 0.0)
    assert np.all(load_moments(several, ANGLES, -1.0) <= 0.0)


def test_resist_is_the_rectified_moment_against_the_motion():
    rectified = load_moments(bank("rectified"), ANGLES, 1.0)
    assert np.array_equal(load_moments(bank("resist"), ANGLES, 1.0), rectified)
    assert load_moments(bank("resist"), ANGLES, -1.0) == pytest.approx(-rectified, abs=ROUNDING_NM)
    assert rectified == pytest.approx(np.abs(load_moments(bank("printed"), ANGLES, 1.0)), abs=1e-9)


def test_the_printed_load_drives_the_shaft_half_the_time():
    moments = load_moments(bank("printed"), ANGLES, 1.0)
    assert np.count_nonzero(moments < -1e-9) == pytest.approx(1800, abs=2)


def test_no_load_is_no_moment_and_guides_that_carry_the_weight_alone():
    load = cart_load(bank("none"), 0, 1.0, 1.0)
    assert (load.moment_nm, load.rod_force_n) == (0.0, 0.0)
    assert load.front_n + load.rear_n == pytest.approx(-GEOMETRY["weight_n"], rel=1e-12)


def test_the_moment_is_the_virtual_work_of_the_rod_force():
    one = bank()
    for psi in ANGLES[1::97]:
        load, motion = cart_load(one, 0, psi, 1.0), cart_motion(one, math.sin(psi), math.cos(psi))
        assert load.moment_nm == pytest.approx(-load.rod_force_n * motion.rod_cosine * motion.x1, rel=1e-12)


@pytest.mark.parametrize("load", ["none", "reversing", "resist", "rectified", "printed"])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_fast_sum_is_the_sum_of_the_carts(load, direction):
    three = bank(load, count=3, offset_deg=120.0)
    sides = np.empty(3)
    for angle in np.linspace(0.01, 6.27, 61):
        sides_of_travel(three, angle, sides)
        inertia, slope, moment = shaft_terms(three, angle, sides, direction)
        slow = shaft_terms(three._replace(plain=False), angle, sides, direction)
        assert moment == pytest.approx(load_moment(three, angle, direction), rel=1e-12, abs=1e-9)
        assert (inertia, slope, moment) == pytest.approx(slow, rel=1e-12, abs=1e-9)


def test_half_the_slope_of_the_inertia():
    four = bank("none", count=4, offset_deg=37.0)
    sides = np.ones(4)
    for angle in np.linspace(0.0, 6.0, 13):
        before, here, after = (shaft_terms(four, angle + d, sides, 1.0) for d in (-1e-5, 0.0, 1e-5))
        assert here[1] == pytest.approx((after[0] - before[0]) / 4e-5, abs=1e-6)


def test_a_missing_cart_is_as_if_it_were_not_there():
    both = bank(count=2, offset_deg=90.0, states=["loaded", "missing"])
    alone = bank()
    assert load_moments(both, ANGLES, 1.0) == pytest.approx(load_moments(alone, ANGLES, 1.0), rel=1e-12)
    assert both.crank_inertia_kg_m2 == alone.crank_inertia_kg_m2


def test_an_empty_cart_asks_for_the_friction_of_its_weight_alone():
    empty = bank(states=["empty"])
    moments = load_moments(empty, ANGLES, 1.0)
    assert np.all(moments >= -ROUNDING_NM)
    assert 0.0 < float(np.max(moments)) < 0.02 * 734.5


def test_mass_and_weight_of_each_cart_of_its_own():
    pair = bank(count=2, offset_deg=90.0, masses_kg=[197.3333, 2.0 * 197.3333 + 32.0])
    for one, other in (pair.mass_kg, pair.weight_n):
        assert other == pytest.approx(2.0 * one, rel=1e-12)


def test_changing_the_rail_costs_a_little_more():
    signed, rail = (
        float(np.mean(load_moments(bank(friction=kind), ANGLES, 1.0))) for kind in ("signed", "rail_change")
    )
    assert signed < rail < 1.01 * signed


def test_a_rod_too_short_for_a_turn_is_refused_with_its_numbers():
    with pytest.raises(ValidationError, match=r"crank_m <= 0.98 rod_m needed for a full turn .*, got 0.8 and 0.8"):
        CartParameters(**{**GEOMETRY, "crank_m": 0.8})


def test_a_list_of_the_wrong_length_is_refused():
    with pytest.raises(ValidationError, match="offsets_deg: one entry per cart needed, got 2 for count 1"):
        CartParameters(**GEOMETRY, offsets_deg=[0.0, 90.0])
