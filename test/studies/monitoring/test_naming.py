# SPDX-License-Identifier: Apache-2.0
"""Faults named by what they do to the features: by size, as a group, or unknown."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter
from studies.monitoring.synthetic import autoregressive, vectors

from mech_twin.files.output_file import plain
from mech_twin.studies.monitoring.baseline import Baseline, fitted_baseline
from mech_twin.studies.monitoring.charts import chart_limits
from mech_twin.studies.monitoring.diagnosis import Change, Signature, candidates, estimated_change
from mech_twin.studies.monitoring.findings import Findings, alerts_of
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.report import judged_run
from mech_twin.studies.monitoring.sensor_quality import ChannelQuality, SensorLimits

COEFFICIENTS = np.array([[0.5, 0.0, 0.2, 0.7]])
COVARIANCE = np.diag([1.0, 0.25, 4.0, 1.0])
EFFECTS = {
    "soft": np.array([4.0, 0.0, 0.0, 2.0]),
    "worn": np.array([0.0, 3.0, 2.0, 0.0]),
    "twin_of_worn": np.array([0.0, 3.0, 2.1, 0.0]),
    "bent": np.array([0.0, 0.0, -9.0, 3.0]),
}


def signature(name: str, effect: np.ndarray) -> Signature:
    """Return the signature of an effect that grows with the square root of the size."""
    sizes = np.array([-0.4, -0.2, -0.1, 0.0])
    return Signature(name, name, "1", sizes, np.sqrt(-sizes)[:, None] * effect)


@pytest.fixture(scope="module")
def setup() -> MonitorSetup:
    baseline, innovations = fitted_baseline(vectors(autoregressive(4000, COEFFICIENTS, COVARIANCE, 1)))
    limits = chart_limits(baseline, innovations, 1000.0)
    signatures = tuple(signature(name, effect) for name, effect in EFFECTS.items())
    return MonitorSetup("none", baseline, limits, signatures, settling_cycles=3)


def last_of(setup: MonitorSetup, change: np.ndarray, seed: int, cycles: int = 60) -> Findings:
    rows = autoregressive(200, COEFFICIENTS, COVARIANCE, seed)
    rows[40] += 0.4 * change  # the cycle in which it happens is half a cycle
    rows[41:] += change
    monitor = Monitor(setup)
    return [monitor.observe(vector) for vector in vectors(rows[: 41 + cycles])][-1]


@pytest.mark.slow
def test_the_fault_is_named_and_its_size_lies_in_the_interval(setup: MonitorSetup) -> None:
    inside = 0
    for seed in range(40):
        found = last_of(setup, np.sqrt(0.3) * EFFECTS["soft"], 100 + seed)
        assert (found.verdict, found.finding) == ("named", "soft")
        (named,) = found.candidates
        inside += named.low_95 <= -0.3 <= named.high_95
    assert inside >= 34  # of 40, at 95 % or more by the share that a model may be off: 33 or less has a chance of 2e-3


@pytest.mark.slow
def test_faults_that_look_alike_are_a_group(setup: MonitorSetup) -> None:
    found = last_of(setup, np.sqrt(0.3) * EFFECTS["worn"], 5)
    assert (found.verdict, found.finding) == ("group", "twin_of_worn or worn")


def test_what_fits_no_fault_is_unknown(setup: MonitorSetup) -> None:
    found = last_of(setup, np.array([-6.0, 3.0, 0.0, 0.0]), 5)
    assert (found.verdict, found.finding) == ("unknown", "unknown")


def test_a_fault_that_takes_away_no_more_than_chance_does_is_not_named() -> None:
    """More noise of a sensor moves the mean anywhere: nearly every fault left little enough of it open."""
    sizes, count = np.array([-0.4, -0.2, 0.0]), 12
    change = Change(np.full(count, 1.85), np.eye(count), 40.0)
    faults = [Signature(f"{i}", "", "1", sizes, -10.0 * sizes[:, None] * each) for i, each in enumerate(np.eye(count))]
    own = Signature("own", "", "1", sizes, -5.0 * sizes[:, None] * change.delta)
    assert change.lasts
    assert candidates(change, faults) == ()
    assert [found.name for found in candidates(change, [*faults, own])] == ["own"]


def test_a_sensor_is_stuck_as_a_whole_or_not(setup: MonitorSetup) -> None:
    stuck = Signature("sensor_stuck:a", "", "1", np.array([0.0, 1.0]), np.array([np.zeros(4), [40.0, 0.0, 8.0, 0.0]]))
    with_it = replace(setup, signatures=(*setup.signatures, stuck))
    assert last_of(with_it, 0.15 * stuck.responses[1], 5).finding == "unknown"
    (found,) = last_of(with_it, stuck.responses[1], 5).candidates
    assert (found.name, found.size, found.low_95, found.high_95) == ("sensor_stuck:a", 1.0, 1.0, 1.0)


def test_an_opposite_effect_is_not_the_fault(setup: MonitorSetup) -> None:
    assert last_of(setup, -np.sqrt(0.3) * EFFECTS["soft"], 5).verdict == "unknown"


@pytest.mark.slow
def test_a_fault_whose_machine_no_longer_repeats_itself_is_named_by_its_scatter(setup: MonitorSetup) -> None:
    """The mean of some wild cycles fits nothing by the healthy scatter alone; with the scatter of the fault it does."""
    wild = np.array([9.0, 0.0, 0.0, -30.0])  # along it the cycles of the faulty machine scatter
    responses = np.sqrt([0.4, 0.2, 0.0])[:, None] * EFFECTS["soft"]
    given = ("soft", "soft", "1", np.array([-0.4, -0.2, 0.0]), responses)
    scatter = np.array([[wild], [wild], [np.zeros(4)]])
    scattering = Signature(*given, scatter=scatter)
    told = {"plain": 0, "scatter": 0}
    for seed in range(20):
        rows = autoregressive(100, COEFFICIENTS, COVARIANCE, 300 + seed)
        rows[41:] += np.sqrt(0.3) * EFFECTS["soft"]
        rows[41:] += np.random.default_rng(seed).standard_normal((59, 1)) * wild
        for name, signature in (("plain", Signature(*given)), ("scatter", scattering)):
            others = tuple(each for each in setup.signatures if each.name != "soft")
            monitor = Monitor(replace(setup, signatures=(signature, *others)))
            told[name] += [monitor.observe(vector) for vector in vectors(rows)][-1].finding == "soft"
    assert told["scatter"] >= 18
    assert told["plain"] <= 10


def test_a_signature_is_the_same_after_a_file() -> None:
    bent = Signature(
        "a", "b", "1", np.array([-1.0, 0.0]), np.ones((2, 4)), "c", np.ones((2, 1, 4)), 0.5 * np.ones((2, 4))
    )
    again = TypeAdapter(Signature).validate_json(json.dumps(plain(bent)))
    assert plain(again) == plain(bent)
    assert np.array_equal(again.uncertainty(7.0), bent.uncertainty(7.0))
    np.testing.assert_allclose(again.uncertainty(7.0), np.full((1, 4, 4), 1.0 / 7.0 + 1.0 / 60.0 + 0.25))


def test_a_fault_that_goes_is_latched_until_somebody_has_seen_it(setup: MonitorSetup) -> None:
    rows = autoregressive(400, COEFFICIENTS, COVARIANCE, 8)
    rows[40:120] += EFFECTS["soft"] * np.sqrt(0.3)
    monitor = Monitor(setup)
    states = []
    for vector in vectors(rows[:300]):
        found = monitor.observe(vector)
        states += [life.state for life in found.faults if life.name == "soft"]
    assert list(dict.fromkeys(states)) == ["pending", "active", "latched"]
    monitor.acknowledge("soft", 40.0)
    assert not [life for life in monitor.observe(vectors(rows[300:301], 300)[0]).faults if life.name == "soft"]


def test_an_alert_tells_the_size_last_seen_until_its_fault_is_cleared_and_of_a_group_whose_it_is(
    setup: MonitorSetup,
) -> None:
    rows = autoregressive(400, COEFFICIENTS, COVARIANCE, 8)
    rows[40:120] += EFFECTS["worn"] * np.sqrt(0.3)
    monitor, told = Monitor(replace(setup, sensors={"a": SensorLimits(1000.0, 0.001, 0.0, 0.1, 1.0)})), {}
    usual = ChannelQuality(100, 0.001, 0.01, 1.0)
    for vector in vectors(rows[:300]):
        spoilt = usual._replace(isolation=50.0) if vector.number == 100 else usual
        monitor.observe(vector._replace(quality={"a": spoilt}))
        alerts = {each.name: each for each in alerts_of("none", monitor.lives.values(), vector.end_s)}
        told[vector.number] = alerts.get("twin_of_worn or worn")
    for cycle, state in ((99, "active"), (100, "active"), (299, "latched")):
        alert = told[cycle]
        assert alert.state == state
        assert alert.low_95 <= -0.3 <= alert.high_95
        assert alert.size_of in ("worn", "twin_of_worn")


@pytest.mark.slow
def test_a_fault_that_has_gone_keeps_the_size_it_had(setup: MonitorSetup) -> None:
    """The charts hold on to a change; the healthy cycles meanwhile are none of the fault's."""
    sizes = []
    for seed in range(12):
        rows = autoregressive(200, COEFFICIENTS, COVARIANCE, 100 + seed)
        rows[41:101] += EFFECTS["bent"] * np.sqrt(0.3)
        alarms = judged_run(Monitor(setup), vectors(rows)).alarms
        sizes += [found.size for alarm in alarms for found in alarm.candidates if found.name == "bent"]
    assert len(sizes) >= 10
    assert np.mean(sizes) == pytest.approx(-0.3, abs=0.05)


@pytest.mark.parametrize(
    ("began", "became", "size"),
    [
        (-0.1, "soft", -0.3),
        pytest.param(-0.3, "soft", -0.1, marks=pytest.mark.slow),
        pytest.param(-0.3, "bent", -0.3, marks=pytest.mark.slow),
    ],
    ids=["grows", "is made good in part", "another"],
)
def test_a_standing_alarm_tells_the_largest_that_its_fault_has_been(
    setup: MonitorSetup, began: float, became: str, size: float
) -> None:
    sizes = []
    for seed in range(8):
        rows = autoregressive(500, COEFFICIENTS, COVARIANCE, 100 + seed)
        rows[41:241] += EFFECTS["soft"] * np.sqrt(-began)
        rows[241:] += EFFECTS[became] * np.sqrt(-size)
        last = judged_run(Monitor(setup), vectors(rows)).alarms[-1]
        sizes += [found.size for found in last.candidates if found.name == became]
    assert len(sizes) >= 6
    assert np.mean(sizes) == pytest.approx(-0.3, abs=0.05)


@pytest.mark.slow
def test_a_standing_alarm_keeps_its_name(setup: MonitorSetup) -> None:
    """Whatever noise does in hundreds of cycles, and with another fault beside the first."""
    rows = autoregressive(2000, COEFFICIENTS, COVARIANCE, 100)
    rows[41:] += EFFECTS["soft"] * np.sqrt(0.3)
    rows[1500:] += EFFECTS["bent"] * np.sqrt(0.3)
    monitor = Monitor(setup)
    assert [(each.name, each.state) for each in judged_run(monitor, vectors(rows)).events] == [
        ("soft", "pending"),
        ("soft", "active"),
    ]


def test_a_fault_outlives_a_cycle_that_a_sensor_spoils(setup: MonitorSetup) -> None:
    """An acknowledged fault is no new one after it, and its alarm no second one."""
    rows = autoregressive(200, COEFFICIENTS, COVARIANCE, 108)
    rows[41:] += EFFECTS["bent"] * np.sqrt(0.3)
    monitor = Monitor(replace(setup, sensors={"a": SensorLimits(1000.0, 0.001, 0.0, 0.1, 1.0)}))
    usual = ChannelQuality(100, 0.001, 0.01, 1.0)
    cycles = [each._replace(quality={"a": usual}) for each in vectors(rows)]
    cycles[120] = cycles[120]._replace(quality={"a": usual._replace(isolation=50.0)})
    seen = judged_run(monitor, cycles[:100])
    monitor.acknowledge("bent", 10.0)
    later = judged_run(monitor, cycles[100:])
    assert len(seen.alarms) == 1
    assert later.alarms == ()
    assert {event.name for event in later.events} == {"sensor_spikes:a"}
    assert [(life.state, life.is_acknowledged) for life in later.faults] == [("active", True)]


def test_an_alarm_that_a_sensor_ends_has_ended(setup: MonitorSetup) -> None:
    rows = autoregressive(200, COEFFICIENTS, COVARIANCE, 108)
    rows[41:] += EFFECTS["bent"] * np.sqrt(0.3)
    monitor = Monitor(replace(setup, sensors={"a": SensorLimits(1000.0, 0.001, 0.0, 0.1, 1.0)}))
    usual = ChannelQuality(100, 0.001, 0.01, 1.0)
    cycles = [each._replace(quality={"a": usual}) for each in vectors(rows[:60])]
    cycles[46:] = [each._replace(quality={"a": usual._replace(isolation=50.0)}) for each in cycles[46:]]
    (alarm,) = judged_run(monitor, cycles).alarms
    assert (alarm.alarm_s, alarm.ended_s) == pytest.approx((4.5, 4.7))


def test_the_operator_is_called_at_most_once_in_ten_minutes(setup: MonitorSetup) -> None:
    rows = autoregressive(900, COEFFICIENTS, COVARIANCE, 8)
    for start in range(40, 900, 200):
        rows[start : start + 80] += EFFECTS["soft"] * np.sqrt(0.3)
    monitor = Monitor(setup)
    findings = [monitor.observe(vector) for vector in vectors(rows)]
    assert sum(found.alarm_begins for found in findings) >= 4
    assert sum(found.announce for found in findings) == 1


@pytest.mark.slow
def test_the_estimated_change_is_unbiased_and_its_covariance_is_that_of_its_scatter(setup: MonitorSetup) -> None:
    baseline: Baseline = setup.baseline
    change, found = np.array([1.0, 2.0, -3.0, 0.5]), []
    for seed in range(300):
        rows = autoregressive(60, COEFFICIENTS, COVARIANCE, 1000 + seed)
        rows[20:23] += np.random.default_rng(seed).normal(0.0, 30.0, (3, 4))  # the machine settles
        rows[23:] += change
        estimate = estimated_change(baseline, baseline.innovations(rows)[19:], 3)
        assert estimate is not None
        found.append(estimate.delta)
    scatter = np.array(found) - change
    assert np.abs(scatter.mean(axis=0) / (scatter.std(axis=0) / np.sqrt(300.0))).max() < 4.0
    np.testing.assert_allclose(np.linalg.solve(estimate.covariance, np.cov(scatter.T)), np.eye(4), atol=0.35)


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(
    size=st.floats(min_value=200.0, allow_infinity=False),
    sign=st.sampled_from([-1.0, 1.0]),
    places=st.sets(st.integers(0, 3), min_size=1),
    cycles=st.integers(1, 3),
)
def test_a_cycle_of_any_size_is_judged_names_no_fault_and_is_forgotten(
    setup: MonitorSetup, size: float, sign: float, places: set[int], cycles: int
) -> None:
    rows = autoregressive(40 + 400, COEFFICIENTS, COVARIANCE, 7)
    rows[40 : 40 + cycles, sorted(places)] = sign * size
    monitor = Monitor(setup)
    found = [monitor.observe(vector) for vector in vectors(rows)]
    assert found[40].alarm
    assert not any(each.verdict in ("named", "group") for each in found)
    assert found[-1].verdict == "healthy"
    assert all(np.isfinite(each.standard).all() for each in found if each.charts is not None)


@pytest.mark.parametrize(("size", "low", "high"), [(0.15, 0.0, 0.3), (0.25, 0.1, 0.4), (0.38, 0.2, np.inf)])
def test_a_fault_beyond_its_largest_simulated_size_is_named_in_proportion_with_an_interval_that_holds_it(
    setup: MonitorSetup, size: float, low: float, high: float
) -> None:
    sizes = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    leaking = Signature("leaking", "", "N", sizes, 20.0 * sizes[:, None] * EFFECTS["soft"])
    found = last_of(replace(setup, signatures=(leaking,)), 20.0 * size * EFFECTS["soft"], 5)
    (named,) = found.candidates
    assert named.size == pytest.approx(size, rel=0.05)
    assert low < named.low_95 <= size <= named.high_95
    assert named.high_95 <= high and (named.high_95 == np.inf) == (high == np.inf)


def test_a_size_is_not_continued_beyond_all_of_a_share_nor_where_there_is_one_alone() -> None:
    effect = np.array([1.0, -2.0])
    lost = Signature(
        "lost", "", "1", np.array([-0.6, -0.3, 0.0, 1.0]), np.array([-0.6, -0.3, 0.0, 1.0])[:, None] * effect
    )
    np.testing.assert_allclose(lost.reaching.sizes, [-1.0, -0.6, -0.3, 0.0, 1.0])
    np.testing.assert_allclose(lost.reaching.responses[0], -effect)
    np.testing.assert_allclose(lost.reaching.doubt, 0.0, atol=1e-12)
    bent = replace(lost, responses=np.array([-1.2, -0.3, 0.0, 1.0])[:, None] * effect)
    assert (bent.reaching.doubt[0] > 0.3 * np.abs(effect)).all()
