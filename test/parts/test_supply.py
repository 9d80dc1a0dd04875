# SPDX-License-Identifier: Apache-2.0
"""The supply follows what is asked at its rate, reaches it exactly and never leaves 0..1."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parameter_bounds import has_range, live_names

from mech_twin.parts.induction_motor import SupplyParameters, limited_command

fractions = st.floats(0.0, 1.0)


@settings(deadline=None)  # the first call compiles
@given(fractions, st.floats(-1.0, 2.0), st.floats(0.01, 1e6), st.floats(1e-5, 1e-2))
def test_the_change_is_limited_and_the_result_a_fraction(command, target, rate, step):
    moved = limited_command(command, target, rate, step)
    assert 0.0 <= moved <= 1.0
    assert abs(moved - command) <= rate * step * (1.0 + 1e-9) + 1e-15


def test_the_target_is_reached_exactly_and_held():
    command = 0.0
    for _ in range(11):
        command = limited_command(command, 0.7, 100.0, 0.001)
    assert command == 0.7
    assert limited_command(command, 0.7, 100.0, 0.001) == 0.7


@settings(deadline=None)
@given(fractions, fractions, st.floats(0.01, 10.0), st.floats(1e-5, 1e-2))
def test_the_supply_is_as_near_to_the_target_as_its_rate_allows(command, target, rate, step):
    moved = limited_command(command, target, rate, step)
    left = max(abs(target - command) - rate * step, 0.0)
    assert abs(target - moved) == pytest.approx(left, abs=1e-15)


def test_the_supply_starts_within_0_and_1_and_may_change_its_rate_while_it_runs():
    valid = {"initial_fraction": 0.5, "rate_per_s": 10.0}
    assert has_range(SupplyParameters, valid, "initial_fraction", 0.0, 1.0)
    assert has_range(SupplyParameters, valid, "rate_per_s", 1e-6, 1e6)
    assert live_names(SupplyParameters) == {"rate_per_s"}
