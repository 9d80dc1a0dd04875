# SPDX-License-Identifier: Apache-2.0
"""Numbers are reported in the digits that do not depend on the coupling step."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from itertools import islice
from typing import Any

import pytest
from command_line import mech_twin
from hypothesis import given
from hypothesis import strategies as st

from mech_twin import simulate
from mech_twin.capabilities.variation import varied
from mech_twin.cli.study import constraint_rows
from mech_twin.engine.run import frames
from mech_twin.errors import MotionError
from mech_twin.machines.mb10_breaker.sizing import seating
from mech_twin.parameters.load import catalogue_entry
from mech_twin.parameters.load import machine as built
from mech_twin.roles import Machine
from mech_twin.samples import Frame
from mech_twin.studies import search_runs, size
from mech_twin.studies.shorter_steps import (
    RunInShorterSteps,
    checked_numbers,
    common_digits,
    in_common_digits,
    in_shorter_steps,
)
from mech_twin.studies.simulation import Simulation

FINER = 3.7  # times shorter than the step of the run, so that samples of all three fall elsewhere
NUMBERS = st.floats(1e-9, 1e9) | st.floats(-1e9, -1e-9)


def last_digit(text: str) -> float:
    """Return what a one in the last digit of a number as text is worth; zeros that end a whole one count for none."""
    digits, _, power = text.partition("e")
    whole, dot, part = digits.partition(".")
    worth = -len(part) if dot else len(whole) - len(whole.rstrip("0"))
    return float(10.0 ** (worth + int(power or 0)))


def bounds(shown: float | str, run: float) -> tuple[float, float]:
    """Return between what a number told says that it lies: a unit of its last digit, or the way between both."""
    if not isinstance(shown, str):
        shown = f"{run:.6g}"
    first, apart, second = shown.partition(" to ")
    if apart:
        low, high = sorted((float(first), float(second)))
        return low - (high - low), high + (high - low)
    return float(shown) - last_digit(shown), float(shown) + last_digit(shown)


@given(NUMBERS, st.floats(-1.0, 1.0), st.integers(0, 12))
def test_both_numbers_are_the_one_told_but_for_a_unit_of_its_last_digit(value: float, apart: float, by: int) -> None:
    other = value * (1.0 + apart * 10.0**-by)
    low, high = bounds(common_digits("of_run", value, {"of_run": other}), value)
    slack = 1e-5 * abs(value) + 5e-3 * (abs(value) + abs(other)) * (by < 3)  # of an interval three digits are told
    assert low - slack <= min(value, other)
    assert max(value, other) <= high + slack


def test_a_count_that_differs_is_told_as_both() -> None:
    assert common_digits("unseated_blows", 20.0, {"unseated_blows": 21.0}) == "20 to 21"
    assert common_digits("stall_events", 2.0, {"stall_events": math.nan}) == "2 to none"
    assert common_digits("rest_force_n", 740.87, {}) == 740.87


def ending_frames(*run: Any) -> Iterator[Frame]:
    """Give the first frames of a run, then an error."""
    yield from islice(frames(*run), 5)
    raise MotionError("no step is small enough")


def test_an_error_in_the_second_run_ends_neither_the_first_nor_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mech_twin.studies.shorter_steps.frames", ending_frames)
    ended = mech_twin("simulate", "compaction_press", "--duration", "0.05")
    assert ended.code == 0, ended.err
    assert "failed (" in ended.out and "checks within their limits" in ended.out
    document = json.loads(mech_twin("simulate", "compaction_press", "--duration", "0.05", "--json").out)
    assert document["shorter_steps"]["failure"] and document["shorter_steps"]["summary"] == {}


def unbuildable(*_: Any) -> Machine:
    raise MotionError("no such machine")


def test_a_machine_that_cannot_be_built_in_shorter_steps_still_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mech_twin.studies.shorter_steps.varied", unbuildable)
    ended = mech_twin("simulate", "compaction_press", "--duration", "0.05")
    assert ended.code == 0, ended.err
    assert "no run in shorter steps: no such machine" in ended.err


def test_values_of_both_runs_stand_in_the_table() -> None:
    rows = list(
        csv.DictReader(mech_twin("simulate", "compaction_press", "--duration", "0.05", "--csv").out.splitlines())
    )
    both = [(float(row["value"]), float(row["in shorter steps"])) for row in rows if row["in shorter steps"]]
    assert any(first != second for first, second in both)


def test_a_run_in_python_tells_the_digits_that_shorter_steps_have_too() -> None:
    run = simulate("compaction_press", 0.05)
    document = json.loads(mech_twin("simulate", "compaction_press", "--duration", "0.05", "--json").out)
    confirmed = document["shorter_steps"]["summary"]
    assert dict(run.in_shorter_steps) == pytest.approx(confirmed, nan_ok=True)
    told = {name: common_digits(name, value, run.in_shorter_steps) for name, value in run.summary.items()}
    assert {name: run.digits[name] for name in told if told[name] != run.digits[name]} == {}
    assert any(isinstance(value, str) for value in run.digits.values())


def test_the_work_of_a_lossless_turn_is_told_as_zero_and_small_real_numbers_are_kept() -> None:
    """A crank at constant speed takes and returns its power: what is left over is the rounding of 4566 W."""
    digits = simulate("vibration_crank", 2.0).digits
    assert (digits["turn_power_mean_w"], digits["run_drive_work_j"]) == (0.0, 0.0)
    numbers = {"power_max_w": 4566.0, "power_mean_w": 3e-8, "leak_w": 3e-5, "drift": 1e-12, "gap_m": 1e-9}
    beside = {"power_max_w": 4566.0, "power_mean_w": -1e-7, "leak_w": 9e-5, "drift": 2e-12, "gap_m": 2e-9}
    told = in_common_digits(numbers, beside)
    assert told == {
        "power_max_w": 4566.0, "power_mean_w": 0.0, "leak_w": "3e-05 to 9e-05", "drift": "1e-12 to 2e-12",
        "gap_m": "1e-09 to 2e-09",
    }  # fmt: skip


BREAKER = pytest.param("mb10_breaker", marks=pytest.mark.slow)


@pytest.mark.parametrize("name", ["compaction_press", "roller_former", "vibration_crank", BREAKER])
def test_a_third_step_agrees_with_every_number_told(name: str) -> None:
    duration_s = 2.5
    machine = built(name)
    run = Simulation(machine)
    shorter = in_shorter_steps(machine, duration_s)
    assert shorter is not None
    beside = RunInShorterSteps(shorter, duration_s)
    for frame in frames(machine, duration_s):
        run.observe(frame)
        beside.follow(frame)
    third_machine = built(name, None, {"coupling.step_s": machine.coupling_step_s / FINER})
    finer = Simulation(third_machine)
    for frame in frames(third_machine, duration_s):
        finer.observe(frame)
    numbers, third = run.numbers(), finer.numbers()
    confirmed = beside.numbers(numbers)
    outside = {}
    for key, value in numbers.items():
        if key.startswith("worst_") or not math.isfinite(value):
            continue
        low, high = bounds(common_digits(key, value, confirmed), value)
        if not low <= third[key] <= high:
            outside[key] = (value, confirmed[key], common_digits(key, value, confirmed), third[key])
    assert outside == {}


def test_what_no_run_gave_is_told_as_it_is_and_a_difference_of_rounding_is_none() -> None:
    assert common_digits("motor", "4A80A4U3", {}) == "4A80A4U3"
    assert common_digits("length_m", 1.25, {"rod_m": 2.0}) == 1.25
    value = 0.949653225548074
    assert common_digits("share", value, {"share": value * (1.0 + 9e-15)}) == value
    assert common_digits("share", value, {"share": value * (1.0 + 1e-9)}) == "0.94965"


@pytest.mark.slow
def test_figures_of_a_sizing_by_runs_are_told_in_digits_that_a_third_step_has_too() -> None:
    answer = size("mb10_breaker", tolerance=0.0)
    shorter = answer.in_shorter_steps
    assert shorter is not None and shorter.step_s < 0.5 * shorter.beside_s
    third = seating(varied(answer.parameters, {"coupling.step_s": shorter.beside_s / FINER}))
    for key in shorter.numbers:
        low, high = bounds(common_digits(key, answer.metrics[key], shorter.numbers), answer.metrics[key])
        assert low <= getattr(third, key) <= high, key
    flight = answer.metrics["flight_share"]
    assert common_digits("flight_share", flight, shorter.numbers) == flight, "all of its digits"
    assert f"flight_share <= 0.95 (has {flight:.6g})" in {row[0] for row in constraint_rows(answer)}


@pytest.mark.slow
def test_a_design_found_by_runs_is_told_in_digits_that_a_third_step_has_too() -> None:
    limits = {"speed_max_rad_per_s": (0.0, 1e3)}
    found = search_runs(
        "winding_drum", "shaft_force_max_n", {"package_radius_m": (0.1, 0.2)}, limits=limits, duration_s=0.1, cores=1
    )
    shorter = found.in_shorter_steps
    assert shorter is not None and set(shorter.numbers) > {"shaft_force_max_n", *found.margins}
    finer = varied(found.parameters, {"coupling.step_s": shorter.beside_s / FINER})
    third = checked_numbers(catalogue_entry("winding_drum").build(finer), 0.1, {"shaft_force_max_n"})
    value = found.objectives["shaft_force_max_n"]
    low, high = bounds(common_digits("shaft_force_max_n", value, shorter.numbers), value)
    assert low <= third.numbers["shaft_force_max_n"] <= high


@pytest.mark.slow
def test_a_design_of_a_number_of_the_configuration_has_no_run_to_check() -> None:
    found = search_runs("winding_drum", "package_mass_kg", {"package_radius_m": (0.1, 0.2)}, cores=1)
    assert found.in_shorter_steps is None
