# SPDX-License-Identifier: Apache-2.0
"""A gear never creates energy: what comes out is eta of what goes in, whichever way it goes."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parameter_bounds import has_range, live_names

from mech_twin.parts.friction_and_gear import Gear, gear_split, gear_torque

ratios = st.floats(0.01, 100.0)
efficiencies = st.floats(0.05, 1.0)
values = st.floats(-1e4, 1e4, allow_subnormal=False)  # below them a product has no relative accuracy


@settings(deadline=None)
@given(ratios, efficiencies, values, values)
def test_the_output_power_is_eta_of_the_input_power_in_either_direction(ratio, efficiency, torque, speed):
    at_crank = gear_torque(ratio, efficiency, torque, speed) * speed
    at_motor = torque * ratio * speed
    given_to_gear, taken_from_gear = (at_motor, at_crank) if at_motor >= 0.0 else (-at_crank, -at_motor)
    assert taken_from_gear == pytest.approx(efficiency * given_to_gear, rel=1e-12, abs=1e-300)


def test_swinging_back_against_the_motor_costs_energy():
    """A torque of 10 N m turned back by 1 rad and let forward again by 1 rad returns less than it took."""
    taken = -gear_torque(2.0, 0.9, 10.0, -1.0) * 1.0
    returned = gear_torque(2.0, 0.9, 10.0, 1.0) * 1.0
    assert taken == pytest.approx(-20.0 / 0.9)
    assert returned == pytest.approx(18.0)


@settings(deadline=None)
@given(ratios, efficiencies, values, st.floats(1e-3, 1e3))
def test_mean_and_friction_are_the_rule(ratio, efficiency, torque, speed):
    mean, friction = gear_split(ratio, efficiency, torque)
    scale = ratio * abs(torque) / efficiency
    for sign in (1.0, -1.0):
        split = mean - sign * friction
        assert split == pytest.approx(gear_torque(ratio, efficiency, torque, sign * speed), abs=1e-12 * scale)


def test_a_gear_without_loss_passes_on_the_torque():
    assert gear_split(5.0, 1.0, -3.0) == (-15.0, 0.0)
    assert gear_torque(5.0, 1.0, -3.0, 7.0) == -15.0


@pytest.mark.parametrize("torque", [10.0, -10.0])
def test_at_rest_the_torque_passed_on_is_that_of_a_motor_that_begins_to_drive(torque):
    assert gear_torque(2.0, 0.9, torque, 0.0) == pytest.approx(0.9 * 2.0 * torque, rel=1e-15)


def test_a_gear_neither_creates_energy_nor_keeps_all_and_its_ratio_is_fixed_while_it_runs():
    valid = {"ratio": 2.0, "efficiency": 0.9}
    assert has_range(Gear, valid, "ratio", 0.01, 1e3)
    assert has_range(Gear, valid, "efficiency", 0.05, 1.0)
    assert live_names(Gear) == {"efficiency"}
