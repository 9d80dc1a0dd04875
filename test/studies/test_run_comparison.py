# SPDX-License-Identifier: Apache-2.0
"""Two sides compared: the relative difference, what counts as differing, and what is drawn."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.errors import StudyError
from mech_twin.studies.run_comparison import (
    ComparedRun,
    at_equal_angle,
    columns_apart,
    compared,
    drawn_side_by_side,
    relative_difference,
)

numbers = st.floats(allow_nan=False, allow_infinity=False)


def side(label="A", machine="press", configuration=None, summary=None, samples=None):
    return ComparedRun(label, machine, configuration or {}, summary or {}, (), samples or {"time_s": [0.0, 1.0]})


@given(numbers, numbers)
def test_relative_difference_is_symmetric_zero_for_equals_and_at_most_two(a, b):
    apart = relative_difference(a, b)
    assert apart == relative_difference(b, a)
    assert (apart == 0.0) == (a == b) or abs(a - b) == 0.0
    assert 0.0 <= apart <= 2.0 or math.isinf(abs(a - b))


def test_numbers_that_one_side_lacks_or_that_are_words_differ_beyond_any_tolerance():
    found = compared(side(summary={"a_n": 1.0, "state": "held"}), side(summary={"b_n": 1.0, "state": "free"}), 1.0)
    assert [number.name for number in found.beyond] == ["a_n", "state", "b_n"]


def test_a_number_that_is_nan_on_both_sides_is_equal_and_on_one_side_is_not():
    nan = math.nan
    assert not compared(side(summary={"a_n": nan}), side(summary={"a_n": nan})).beyond
    assert compared(side(summary={"a_n": nan}), side(summary={"a_n": 1.0}), 1.0).beyond


@pytest.mark.parametrize(("tolerance", "beyond"), [(0.0099, 1), (0.0101, 0)])
def test_the_tolerance_is_relative_to_the_larger_number(tolerance, beyond):
    found = compared(side(summary={"a_n": 99.0}), side(summary={"a_n": 100.0}), tolerance)
    assert len(found.beyond) == beyond


@pytest.mark.parametrize("name", ["mean_nm", "work_j"])
def test_a_number_that_is_rounding_beside_others_of_its_unit_differs_by_a_share_of_their_size(name):
    first, second = (side(summary={"peak_nm": 300.0, name: value}) for value in (4.0e-10, 3.6e-10))
    assert not compared(first, second, 1e-3).beyond
    assert [number.name for number in compared(first, second).beyond] == [name]  # without a tolerance to the bit
    alone = [side(summary={name: value, "count": 1e9}) for value in (4.0e-10, 3.6e-10)]
    assert compared(*alone, 0.05).beyond


def test_residuals_are_rounding_and_not_compared():
    found = compared(side(summary={"worst_energy_balance": 1e-15}), side(summary={"worst_energy_balance": 3e-15}))
    assert not found.numbers


def test_settings_that_differ_go_by_their_dotted_keys():
    found = compared(
        side(configuration={"gear": {"ratio": 2.0, "efficiency": 0.9}}),
        side(configuration={"gear": {"ratio": 3.0, "efficiency": 0.9}, "motor": {"name": "x"}}),
    )
    assert [item[:3] for item in found.settings] == [("gear.ratio", 2.0, 3.0), ("motor.name", None, "x")]


def test_two_machines_and_a_senseless_tolerance_are_refused():
    with pytest.raises(StudyError, match="one machine"):
        compared(side(), side(machine="drum"))
    with pytest.raises(StudyError, match="tolerance"):
        compared(side(), side(), math.nan)


def test_columns_are_compared_at_common_times_whatever_their_rates():
    coarse, fine = np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 101)
    first = side(samples={"time_s": coarse, "same_n": 2.0 * coarse, "shifted_n": coarse, "scaled_n": coarse})
    second = side(samples={"time_s": fine, "same_n": 2.0 * fine, "shifted_n": fine + 0.1, "scaled_n": 3.0 * fine})
    assert columns_apart(first, second, 5)[:2] == ["scaled_n", "shifted_n"]
    assert "same_n" not in columns_apart(first, second, 2)


def test_a_picture_shows_both_sides_in_each_panel():
    first = side("A", samples={"time_s": [0.0, 1.0], "forces.drive_torque_nm": [0.0, 1.0]})
    second = side("B", samples={"time_s": [0.0, 1.0], "forces.drive_torque_nm": [0.0, 2.0]})
    figure = drawn_side_by_side(first, second, ["forces.drive_torque_nm"])
    assert [line.get_label() for line in figure.axes[0].lines] == ["A", "B"]
    assert figure.axes[0].get_ylabel() == "forces drive torque [N m]"


def test_what_is_rounding_beside_others_of_its_unit_is_not_drawn():
    times = [0.0, 1.0]
    first = side(
        samples={"time_s": times, "forces.a_n": [1e-13, 0.0], "forces.b_n": [1000.0, 0.0], "x_m": [1e-13, 0.0]}
    )
    second = side(samples={"time_s": times, "forces.a_n": [0.0, 1e-13], "forces.b_n": [990.0, 0.0], "x_m": [0.0, 0.0]})
    assert columns_apart(first, second, 9) == ["x_m", "forces.b_n"]


def test_every_panel_of_a_picture_has_its_unit() -> None:
    columns = {"time_s": [0.0, 1.0], "linkage.crank.position": [0.0, 1.0], "linkage.ram.position": [0.0, 2.0]}
    columns |= {"forces.drive_torque_nm": [0.0, 3.0]}
    first = side("first", samples=columns)._replace(
        units={"linkage.crank.position": "rad", "linkage.ram.position": "m"}
    )
    second = first._replace(units={**first.units, "linkage.ram.position": "rad"})
    figure = drawn_side_by_side(first, second, list(columns)[1:])
    titles = [axes.get_ylabel() for axes in figure.axes]
    assert titles == ["linkage crank position [rad]", "linkage ram position [m / rad]", "forces drive torque [N m]"]


def turning(omega: float, step_s: float, whole: bool) -> ComparedRun:
    """Return a run whose crank turns steadily."""
    time_s = np.arange(0.0, 1.0, step_s)
    angle = omega * time_s
    return ComparedRun("run", "m", {}, {}, (), {"time_s": time_s, "crank": angle if whole else angle % (2.0 * np.pi)})


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_at_equal_angle_a_run_twice_as_slow_takes_twice_the_time(whole, sense):
    fast, slow = turning(sense * 40.0, 1e-3, whole), turning(sense * 20.0, 7e-4, whole)
    own, of_first = at_equal_angle(fast, slow, "crank")
    assert len(own) > 1000
    assert of_first == pytest.approx(0.5 * own, abs=1e-12)


def test_what_never_turns_a_whole_cycle_has_no_equal_angle():
    assert at_equal_angle(turning(5.0, 1e-3, True), turning(40.0, 1e-3, True), "crank") is None
    assert at_equal_angle(turning(40.0, 1e-3, True), turning(40.0, 1e-3, True), "mass") is None
