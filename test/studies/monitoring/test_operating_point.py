# SPDX-License-Identifier: Apache-2.0
"""A healthy machine at another operating point: told as that, with its size; faults are seen all the same."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.linalg import null_space

from mech_twin.capabilities.faults import motor_changes
from mech_twin.capabilities.variation import varied
from mech_twin.cli.monitor import Judged, show_runs
from mech_twin.files.output_file import plain
from mech_twin.parameters.load import machine_parameters
from mech_twin.parts.induction_motor import motor_constants, motor_torque
from mech_twin.studies.monitoring.baseline import Baseline, joined_runs
from mech_twin.studies.monitoring.charts import ChartLimits, Thresholds
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.diagnosis import Signature
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.operating import (
    LIMIT,
    OperatingSurface,
    OperatingTrack,
    OperatingValue,
    SurfaceVariable,
    chosen_variables,
    polynomial_terms,
    term_values,
)
from mech_twin.studies.monitoring.operating_fit import sister_surface
from mech_twin.studies.monitoring.report import Alarm, JudgedRun, healthy_features
from mech_twin.studies.monitoring.sensor_quality import ChannelQuality, SensorLimits
from mech_twin.studies.monitoring.setup_record import SETUP

SENSORS = Path(__file__).resolve().parents[3] / "benchmarks" / "monitoring" / "sensors"
Q, D = 2, 5
CYCLES = {"winding_drum": 90}  # then its package is empty


def surface() -> OperatingSurface:
    """Return a curved surface of two variables over five features."""
    random = np.random.default_rng(3)
    terms = polynomial_terms(Q)
    coefficients = random.standard_normal((len(terms), D)) * np.where(terms.sum(axis=1) == 1, 50.0, 3.0)[:, None]
    nothing = np.zeros(D - Q)
    return OperatingSurface(
        tuple("abcde"), ("supply", "load"), ("supply_frequency_range", "overload"), (0, 3), np.array([0.05, 0.1]),
        np.arange(D) + 1.0, np.eye(D), coefficients, nothing, np.full(Q, 0.01), np.full(Q, 0.1),
        np.ones((Q, D - Q)), 3, nothing,
    )  # fmt: skip


def test_the_healthy_mean_of_each_feature_is_that_of_the_machine_not_what_the_point_leaves() -> None:
    known = replace(surface(), root=np.diag([2.0, 1.0, 1.0, 4.0, 1.0]))
    left = np.array([0.1, -0.2, 0.3])
    baseline = Baseline(known.left_names, left, np.zeros((0, D - Q)), np.eye(D - Q), 1000, 0.1)
    limits = ChartLimits(Thresholds(8.0, 40.0, 40.0), Thresholds(4.0, 20.0, 20.0), 1e4, extrapolated=False)
    found = healthy_features(MonitorSetup("none", baseline, limits, operating=known))
    assert list(found) == list(known.names)
    means, sigmas = zip(*found.values(), strict=True)
    np.testing.assert_allclose(means, known.mean + np.array([0.0, 0.1, -0.2, 0.0, 0.3]))
    np.testing.assert_allclose(sigmas, [0.5, 1.0, 1.0, 0.25, 1.0])


def test_slopes_of_the_polynomial_are_its_differences() -> None:
    terms, u, small = polynomial_terms(3), np.array([0.3, -0.7, 1.1]), 1e-6
    slopes = term_values(terms, u)[1]
    for k, step in enumerate(small * np.eye(3)):
        differences = (term_values(terms, u + step)[0] - term_values(terms, u - step)[0]) / (2.0 * small)
        np.testing.assert_allclose(slopes[k], differences, atol=1e-8)


@pytest.mark.parametrize("u", [(0.0, 0.0), (0.9, -0.4), (-1.0, 1.0)])
def test_nothing_is_left_of_a_healthy_machine_at_another_point_and_the_point_is_found(u: tuple[float, float]) -> None:
    known = surface()
    left, point = known.rest(known.mean + known.response(np.array(u))[0])
    np.testing.assert_allclose(point, u, atol=2e-3)  # the prior pulls by a share of 1/50^2
    np.testing.assert_allclose(left, 0.0, atol=1e-2)
    np.testing.assert_allclose(known.annihilator(point) @ known.response(point)[1], 0.0, atol=1e-9)


def test_a_variable_that_the_sensors_hardly_show_adds_no_outliers_to_what_is_left() -> None:
    """Its effect on the pivots passes zero where the machine runs, as a fit to noise may tell."""
    known = surface()
    coefficients = np.zeros_like(known.coefficients)
    coefficients[0] = [50.0, 3.0, -2.0, 1.0, 4.0]
    coefficients[1] = [0.02, 0.04, -0.05, 0.06, 0.03]
    coefficients[3] = [0.0, 0.02, -0.01, -0.1, 0.02]  # supply times load
    weak = replace(known, coefficients=coefficients)

    def left(load: float) -> np.ndarray:
        noise = np.random.default_rng(1).standard_normal((2000, D))
        return np.array([weak.rest(weak.mean + weak.response(np.array([0.6, load]))[0] + row)[0] for row in noise])

    usual = left(0.0)
    assert np.abs(usual).max() < 5.0
    for load in (-1.0, 1.0):
        assert (np.abs((left(load) - usual).mean(axis=0)) < 0.1).all()  # standard deviations of a cycle


@pytest.mark.parametrize(("u", "far"), [((0.9, -0.9), []), ((0.2, 1.6), ["load"]), ((-2.0, 0.0), ["supply"])])
def test_a_variable_of_healthy_cycles_that_is_farther_off_than_was_simulated_is_named(
    u: tuple[float, float], far: list[str]
) -> None:
    known, numbers = surface(), range(40)
    rows = [known.mean + known.response(np.array(u if number % 4 == 0 else (0.1, 0.0)))[0] for number in numbers]
    vectors = [FeatureVector(number, number, number + 1, known.names, rows[number]) for number in numbers]
    assert [variable.name for variable in known.out_of_reach(vectors)] == far
    assert known.out_of_reach([]) == ()


@pytest.mark.slow
def test_the_noise_of_days_at_other_points_is_that_within_each_day() -> None:
    known, random = surface(), np.random.default_rng(6)

    def days(*places: float) -> list[FeatureVector]:
        runs = []
        for place in places:
            rows = known.mean + known.response(np.array((place, 0.0)))[0] + random.standard_normal((2000, D))
            runs.append([FeatureVector(i, 0.1 * i, 0.1 * i + 0.1, known.names, row) for i, row in enumerate(rows)])
        return joined_runs(runs)

    for places in ((0.0,), (-0.9, 0.9)):
        root = sister_surface(known, days(*places)).root
        np.testing.assert_allclose(np.linalg.inv(root.T @ root), np.eye(D), atol=0.1)


def test_variables_that_do_the_same_are_one_group_and_what_is_not_seen_is_left_out() -> None:
    declared = [
        SurfaceVariable("voltage", "v", 0.05),
        SurfaceVariable("resistance", "r", 0.2),
        SurfaceVariable("wall", "w", 0.1),
    ]
    effects = np.array([[3.0, -6.0, 0.0], [1.0, -2.0, 0.0], [0.0, 0.01, 0.01]])
    kept, groups, rest = chosen_variables(declared, effects, np.eye(3))
    assert kept == [0]
    assert [group.name for group in groups] == ["voltage or resistance"]
    assert [group.beyond for group in groups] == ["v or r"]
    assert groups[0].range == pytest.approx(0.05 * (1.0 + 1.0 / 3.0))
    np.testing.assert_allclose(rest, 0.0, atol=1e-12)


def test_while_the_point_moves_the_charts_allow_for_the_transient() -> None:
    track = OperatingTrack(replace(surface(), root=1e3 * np.eye(D)))
    for _ in range(60):
        still = track.advance(np.zeros(Q))
    np.testing.assert_array_equal(still, 0.0)
    moving = track.advance(np.array([0.4, 0.0]))
    np.testing.assert_allclose(moving, 0.4)
    for _ in range(60):
        settled = track.advance(np.array([0.4, 0.0]))
    np.testing.assert_array_equal(settled, 0.0)
    (value,) = track.changed()
    assert (value.name, value.share) == ("supply", pytest.approx(0.02))
    assert not value.is_outside


@pytest.mark.parametrize("noise", [1.0, 30.0, 150.0])
def test_the_variable_that_is_told_is_not_drawn_to_its_neighbour_by_the_prior_of_every_cycle(noise: float) -> None:
    """Two variables of almost the same effect: each cycle's estimate splits the change, the mean of many must not."""
    known = surface()
    linear = np.zeros_like(known.coefficients)
    linear[:Q] = 50.0 * np.array([[1.0, -1.0, 0.5, 0.3, 1.0], [1.2, -0.8, 0.4, 0.5, 0.9]])
    known = replace(known, coefficients=linear, root=np.eye(D) / noise, wander=np.zeros(Q))
    true, random = np.array([0.9, 0.0]), np.random.default_rng(5)
    track = OperatingTrack(replace(known, moved=np.full(Q, np.inf)))
    rows = known.mean + known.response(true)[0] + noise * random.standard_normal((2000, D))
    points = np.array([known.located(row) for row in rows])
    scatter = points.std(axis=0) * (0.05 / 1.95) ** 0.5
    track.surface = replace(track.surface, wander=scatter)
    inside = []
    for point in points:
        track.advance(point)
        inside.append(
            [
                value.low_95 <= share <= value.high_95
                for value, share in zip(track.values(), true * known.ranges, strict=True)
            ]
        )
    assert (np.mean(inside[100:], axis=0) > 0.9).all()


@pytest.mark.parametrize(("drawn", "is_outside"), [(1.05, False), (1.15, True)])
def test_a_variable_at_the_end_of_its_range_is_outside_only_where_the_drawn_point_is_too(
    drawn: float, is_outside: bool
) -> None:
    """Where features hardly tell variables, the point freed of the prior errs most; a healthy one is not named."""
    known = surface()
    linear = np.zeros_like(known.coefficients)
    linear[:Q] = np.eye(Q, linear.shape[1])
    little = np.full(Q, 1e-3)
    track = OperatingTrack(replace(known, coefficients=linear, root=5.0**0.5 * np.eye(D), wander=little, moved=little))
    for _ in range(100):
        track.advance(np.array([drawn, 0.0]))
    assert track.values()[0].share > 1.1 * track.surface.ranges[0]
    assert bool(track.outside) == is_outside


def test_a_step_of_the_point_within_a_cycle_is_no_alarm_and_another_change_is_one_a_cycle_later() -> None:
    known = replace(surface(), transient=np.full((Q, D - Q), 100.0))
    baseline = Baseline(known.left_names, np.zeros(D - Q), np.zeros((0, D - Q)), np.eye(D - Q), 1000, 0.1)
    limits = ChartLimits(Thresholds(8.0, 40.0, 40.0), Thresholds(4.0, 20.0, 20.0), 1e4, extrapolated=False)

    sensors = {"encoder": SensorLimits(1000.0, 0.001, 0.0, 0.0, 0.0)}
    sound = {"encoder": ChannelQuality(100, 0.001, 0.0, 0.0)}

    def begun(point_after: tuple[float, float], silent: int = -1) -> list[int]:
        setup = MonitorSetup("none", baseline, limits, operating=known, sensors=sensors)
        monitor, alarms = Monitor(setup), []
        for number in range(60):
            row = known.mean + known.response(np.array(point_after if number > 40 else (0.0, 0.0)))[0]
            if number == 40:  # a mixture of both, in which the point hardly moves
                row[list(known.others)] += 15.0
            quality = {} if number == silent else sound
            vector = FeatureVector(number, 0.1 * number, 0.1 * (number + 1), known.names, row, quality)
            alarms += [number] if monitor.observe(vector).alarm_begins else []
        return alarms

    assert begun((0.4, 0.0)) == []
    assert begun((0.0, 0.0)) == [41]
    assert begun((0.0, 0.0), silent=41) == []  # a sensor that fails then was the reason


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_variable_that_steps_beyond_its_range_began_in_the_cycle_of_its_step(noise: float) -> None:
    known, random = surface(), np.random.default_rng(2)
    baseline = Baseline(known.left_names, np.zeros(D - Q), np.zeros((0, D - Q)), np.eye(D - Q), 1000, 0.1)
    limits = ChartLimits(Thresholds(30.0, 80.0, 80.0), Thresholds(20.0, 60.0, 60.0), 1e4, extrapolated=False)
    monitor, begun = Monitor(MonitorSetup("none", baseline, limits, operating=known)), []
    for number in range(80):
        row = known.mean + known.response(np.array((1.25 if number >= 40 else 0.0, 0.0)))[0]
        row[list(known.others)] += noise * random.standard_normal(D - Q)
        found = monitor.observe(FeatureVector(number, 0.1 * number, 0.1 * (number + 1), known.names, row))
        begun += [found] if found.alarm_begins else []
    (alarm,) = begun
    assert 4.0 < alarm.time_s < 6.0
    assert alarm.onset_s == pytest.approx(4.0)
    assert found.onset_s == pytest.approx(4.0)
    assert [candidate.name for candidate in found.candidates] == [known.beyond[0]]


@pytest.mark.parametrize(("left", "name"), [(0.05, "supply_frequency_range"), (0.3, "unknown")])
def test_a_variable_beyond_its_range_is_named_only_for_a_change_that_moving_it_on_explains(
    left: float, name: str
) -> None:
    known, random = surface(), np.random.default_rng(2)
    baseline = Baseline(known.left_names, np.zeros(D - Q), np.zeros((0, D - Q)), np.eye(D - Q), 1000, 0.1)
    limits = ChartLimits(Thresholds(30.0, 80.0, 80.0), Thresholds(20.0, 60.0, 60.0), 1e4, extrapolated=False)
    monitor = Monitor(MonitorSetup("none", baseline, limits, operating=known))
    far, slope = known.response(np.array((1.3, 0.0)))
    far = far + 0.8 * slope[:, 0]  # farther than was simulated
    other = np.zeros(D)
    other[known.others[0]] = left / (1.0 - left**2) ** 0.5 * np.linalg.norm(far)
    for number in range(80):
        row = known.mean + (far + other if number >= 20 else 0.0) + random.standard_normal(D)
        found = monitor.observe(FeatureVector(number, 0.1 * number, 0.1 * (number + 1), known.names, row))
    assert found.finding == name
    assert [value.is_outside for value in found.operating] == ([True] if name != "unknown" else [])


@pytest.mark.parametrize(
    ("taken_for", "size", "name", "outside"),
    [
        (0.0, 0.0, "supply_frequency_range", True),  # the variable alone
        (0.0, 0.1, "supply_frequency_range", True),  # the fault may as well be absent
        (0.0, 2.0, "worn", True),  # two at once: the fault does not move the variable
        (1.3, 2.0, "worn", False),  # the fault alone, which is taken for the variable too
    ],
)
def test_a_fault_is_named_in_place_of_a_variable_outside_its_range_only_where_it_moves_it(
    taken_for: float, size: float, name: str, outside: bool
) -> None:
    known, random = surface(), np.random.default_rng(2)
    baseline = Baseline(known.left_names, np.zeros(D - Q), np.zeros((0, D - Q)), np.eye(D - Q), 1000, 0.1)
    limits = ChartLimits(Thresholds(30.0, 80.0, 80.0), Thresholds(20.0, 60.0, 60.0), 1e4, extrapolated=False)
    outer = np.array((1.3, 0.0))
    far, slope = known.response(outer)
    whole = 40.0 * null_space(slope.T)[:, 0]  # of the fault: the point stays where it is
    sizes, effect = np.array([0.0, 1.0, 2.0, 3.0]), known.annihilator(outer) @ whole
    points = np.zeros((len(sizes), Q))
    points[1:, 0] = taken_for
    worn = Signature("worn", "", "1", sizes, sizes[:, None] * effect, points=points)
    monitor = Monitor(MonitorSetup("none", baseline, limits, (worn,), operating=known))
    far = far + size * whole
    for number in range(80):
        row = known.mean + (far if number >= 20 else 0.0) + random.standard_normal(D)
        found = monitor.observe(FeatureVector(number, 0.1 * number, 0.1 * (number + 1), known.names, row))
    assert found.finding == name
    assert [value.is_outside for value in found.operating] == ([True] if outside else [])


def test_a_variable_stays_outside_its_range_until_the_point_is_known_again() -> None:
    track = OperatingTrack(surface())
    for _ in range(60):
        track.advance(np.array([1.25, 0.0]))
    assert [value.name for value in track.outside] == ["supply"]
    track.advance(np.array([1.25, 0.5]))  # a movement: the point is not known for some cycles
    assert track.changed() == ()
    assert [value.name for value in track.outside] == ["supply"]
    for _ in range(60):
        track.advance(np.array([0.5, 0.5]))
    assert track.outside == ()


def test_only_a_variable_within_its_range_is_told_as_an_operating_point(capsys: pytest.CaptureFixture[str]) -> None:
    limits = ChartLimits(Thresholds(8.0, 40.0, 40.0), Thresholds(4.0, 20.0, 20.0), 1e4, extrapolated=False)
    baseline = Baseline(("a",), np.zeros(1), np.zeros((0, 1)), np.eye(1), 1000, 0.1)
    far = OperatingValue("load", -0.13, -1.0, -0.129, 0.1, "boom_load")
    near = OperatingValue("supply", 0.04, 0.039, 0.041, 0.05, "supply_frequency_range")
    show_runs(
        MonitorSetup("none", baseline, limits),
        {},
        [Judged("today", JudgedRun(9, 0, (), (), (far, near)))],
        as_json=False,
    )
    told = capsys.readouterr().err
    assert "today: beyond its range: load -13 %" in told
    assert "today: operating_point: supply +4 %" in told


def test_the_interval_of_a_variable_farther_off_than_was_simulated_is_open() -> None:
    track = OperatingTrack(surface())
    for _ in range(60):
        track.advance(np.array([-LIMIT, 0.4]))
    far, near = track.values()
    assert far.low_95 == -1.0
    assert far.high_95 == pytest.approx(-LIMIT * far.range, abs=0.01)
    assert far.candidate[:4] == (far.beyond, far.share, far.low_95, far.high_95)
    assert near.low_95 <= near.share <= near.high_95 < 0.1


def test_times_are_told_to_a_hundredth_of_a_second_also_late_in_a_day(capsys: pytest.CaptureFixture[str]) -> None:
    limits = ChartLimits(Thresholds(8.0, 40.0, 40.0), Thresholds(4.0, 20.0, 20.0), 1e4, extrapolated=False)
    baseline = Baseline(("a",), np.zeros(1), np.zeros((0, 1)), np.eye(1), 1000, 0.1)
    value = OperatingValue("supply", 0.03998, 0.03996, 0.04, 0.05, "supply_frequency_range")
    alarm = Alarm(40001.234, 40005.678, np.nan, 45, {}, "unknown", "unknown", ())
    found = JudgedRun(400000, 0, (alarm,), (), (value,))
    show_runs(MonitorSetup("none", baseline, limits), {}, [Judged("today", found)], as_json=False)
    told = capsys.readouterr()
    assert all(word in told.out for word in ("40005.68", "40001.23"))
    assert "+3.998 % (+3.996 % to +4 %)" in told.err


def test_a_motor_at_another_supply_has_the_torque_that_the_supply_gives_at_every_speed() -> None:
    parameters = machine_parameters("roller_former")
    healthy = motor_constants(parameters.motor)
    other = motor_constants(varied(parameters, motor_changes(parameters, torque=0.9, slip=1.2, field=0.95)).motor)
    for slip in np.linspace(-0.2, 0.8, 11) * healthy.synchronous_speed_rad_per_s:
        later = motor_torque(other, other.synchronous_speed_rad_per_s - 1.2 * slip, 1.0)
        before = motor_torque(healthy, healthy.synchronous_speed_rad_per_s - slip, 1.0)
        assert later == pytest.approx(0.9 * before, rel=1e-12)


@pytest.mark.parametrize(
    ("place", "value", "told"),
    [
        (("baseline", "mean"), [1, 2], "baseline.mean: expected numbers of the shape"),
        (("baseline", "mean"), ["1", "2", "3"], "expected lists of numbers"),
        (("baseline", "covariance"), [[1, 2, 0], [2, 1, 0], [0, 0, 1]], "positive definite"),
        (("limits", "alarm", "cusum"), -1.0, "greater than or equal to 0"),
        (("operating", "pivots"), [0, 0], "pivots below 5"),
        (("operating", "root"), [1], "operating.root: expected numbers of the shape"),
        (("operating", "coefficients"), np.ones((9, D)).tolist(), "pivots that tell the variables apart"),
        (("signatures", 0, "sizes"), [1.0, 0.0, 2.0], "expected ascending ones, with 0"),
    ],
)
def test_a_setup_is_the_same_after_a_file_and_what_does_not_fit_in_it_is_named(
    place: tuple[Any, ...], value: Any, told: str
) -> None:
    known = surface()
    baseline = Baseline(known.left_names, np.zeros(D - Q), np.zeros((0, D - Q)), np.eye(D - Q), 1000, 0.1)
    limits = ChartLimits(Thresholds(8.0, 40.0, 40.0), Thresholds(4.0, 20.0, 20.0), 1e4, extrapolated=False)
    worn = Signature("worn", "", "1", np.array([-0.5, -0.2, 0.0]), np.zeros((3, D - Q)), points=np.zeros((3, Q)))
    setup = MonitorSetup("none", baseline, limits, (worn,), operating=known)
    record: Any = json.loads(json.dumps(plain(setup)))
    assert plain(SETUP.validate_json(json.dumps(record))) == plain(setup)
    inside = record
    for name in place[:-1]:
        inside = inside[name]
    inside[place[-1]] = value
    with pytest.raises(ValidationError, match=told):
        SETUP.validate_json(json.dumps(record))
