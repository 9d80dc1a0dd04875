# SPDX-License-Identifier: Apache-2.0
"""Prewhitening, thresholds from a stated run length, and the life of a fault."""

from __future__ import annotations

import json
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.stats import poisson
from studies.monitoring.synthetic import autoregressive, vectors

from mech_twin.errors import StudyError
from mech_twin.files.output_file import plain
from mech_twin.studies.monitoring.baseline import Baseline, fitted_baseline
from mech_twin.studies.monitoring.charts import ALLOWANCE, WINDOW, advance_cusum, chart_limits, chart_rows
from mech_twin.studies.monitoring.findings import FaultLife, LifeRules, acknowledged, after_cycle, shelved
from mech_twin.studies.monitoring.monitor import SILENT, Monitor, MonitorSetup
from mech_twin.studies.monitoring.setup_record import SETUP

COVARIANCE = np.array([[1.0, 0.6, 0.0], [0.6, 2.0, -0.3], [0.0, -0.3, 0.5]])
COEFFICIENTS = np.array([[0.6, 0.3, 0.0], [-0.2, 0.1, 0.0]])


@cache
def healthy_baseline(cycles: int, seed: int = 1) -> tuple[Baseline, list[np.ndarray]]:
    rows = autoregressive(cycles, COEFFICIENTS, COVARIANCE, seed) + np.array([10.0, -3.0, 0.5])
    return fitted_baseline(vectors(rows))


@cache
def healthy_setup(cycles: int, arl0_cycles: float, seed: int = 1) -> MonitorSetup:
    baseline, innovations = healthy_baseline(cycles, seed)
    return MonitorSetup("none", baseline, chart_limits(baseline, innovations, arl0_cycles))


def test_the_autoregression_and_covariance_of_the_features_are_found() -> None:
    baseline, _ = healthy_baseline(20_000)
    assert baseline.order == 2
    np.testing.assert_allclose(baseline.coefficients, COEFFICIENTS, atol=0.03)
    np.testing.assert_allclose(baseline.covariance, COVARIANCE, atol=0.06)
    np.testing.assert_allclose(baseline.mean, [10.0, -3.0, 0.5], atol=0.1)


def test_innovations_are_independent_and_whitened_ones_of_unit_covariance() -> None:
    baseline, _ = healthy_baseline(20_000)
    rows = autoregressive(20_000, COEFFICIENTS, COVARIANCE, 9) + np.array([10.0, -3.0, 0.5])
    white = baseline.whitened(baseline.innovations(rows))
    np.testing.assert_allclose(white.T @ white / len(white), np.eye(3), atol=0.05)
    for lag in (1, 2, 3):
        assert np.abs((white[lag:] * white[:-lag]).mean(axis=0)).max() < 0.03


@pytest.mark.parametrize(("coefficient", "run_length"), [(0.0, 466.0), (0.2, 149.0), (0.5, 52.0), (0.8, 30.0)])
def test_without_prewhitening_false_alarms_come_many_times_as_often(coefficient: float, run_length: float) -> None:
    charts = 4000
    random = np.random.default_rng(2)
    up, down, found = np.zeros(charts), np.zeros(charts), np.zeros(charts)
    value = random.standard_normal(charts)
    cycle = 0
    while (found == 0.0).any():
        cycle += 1
        value = coefficient * value + np.sqrt(1.0 - coefficient**2) * random.standard_normal(charts)
        advance_cusum(value, ALLOWANCE, 1e300, up, down)
        found[(found == 0.0) & (np.maximum(up, down) > 5.0)] = cycle
    assert found.mean() == pytest.approx(run_length, rel=0.07)


def begun_alarms(setup: MonitorSetup, rows: np.ndarray) -> tuple[int, int]:
    """Return the alarms of healthy rows, and the cycles outside of them."""
    monitor, begun, in_alarm = Monitor(setup), 0, 0
    for vector in vectors(rows):
        findings = monitor.observe(vector)
        begun += findings.alarm_begins
        in_alarm += findings.alarm
    return begun, len(rows) - in_alarm


@pytest.mark.slow
def test_false_alarms_come_as_often_as_stated() -> None:
    run_length, begun, judged = 400.0, 0, 0
    for seed in range(3):  # a baseline has errors of its own: the statement holds over several
        rows = autoregressive(8000, COEFFICIENTS, COVARIANCE, 50 + seed) + np.array([10.0, -3.0, 0.5])
        alarms, cycles = begun_alarms(healthy_setup(3000, run_length, 20 + seed), rows)
        begun, judged = begun + alarms, judged + cycles
    low, high = poisson.interval(0.999, judged / run_length)
    assert low <= begun <= high


def echoing(cycles: int, seed: int) -> np.ndarray:
    """Return rows whose shocks come again every twelve cycles: no autoregression of a few cycles can hold that."""
    shocks = np.random.default_rng(seed).standard_normal((cycles + 48, 3))
    return np.asarray(sum(shocks[48 - late : cycles + 48 - late] for late in range(0, 60, 12)) / np.sqrt(5.0))


@pytest.mark.slow
def test_false_alarms_come_as_often_as_stated_where_slow_dependence_is_left() -> None:
    run_length, begun, judged = 400.0, 0, 0
    for seed in range(3):
        baseline, innovations = fitted_baseline(vectors(echoing(5000, 30 + seed)))
        setup = MonitorSetup("none", baseline, chart_limits(baseline, innovations, run_length))
        alarms, cycles = begun_alarms(setup, echoing(8000, 60 + seed))
        begun, judged = begun + alarms, judged + cycles
    low, high = poisson.interval(0.999, judged / run_length)
    assert low <= begun <= high


@pytest.mark.timeout(900)
@pytest.mark.slow
def test_false_alarms_come_as_often_as_stated_where_many_features_are_known_from_short_runs() -> None:
    """Of one rate r the charts have exp(-250 r) of blocks of 250 cycles quiet."""
    run_length, width, block, short = 1000.0, 19, 250, 165
    random, rates = np.random.default_rng(80), []

    def remembering(cycles: int) -> np.ndarray:
        settled = lfilter([1.0], [1.0, -0.5, -0.2], random.standard_normal((cycles + 60, width)), axis=0)
        return np.asarray(settled[60:])

    watched = remembering(300_000)
    for _ in range(12):
        known = [vector for first in range(0, 61_000, 1000) for vector in vectors(remembering(short), first)]
        baseline, innovations = fitted_baseline(known)
        limits, left = chart_limits(baseline, innovations, run_length), baseline.innovations(watched)
        rows = chart_rows(left / baseline.sigma, baseline.whitened(left), ALLOWANCE, WINDOW)
        blocks = rows[: len(rows) // block * block].reshape(-1, block, 3).max(axis=1)
        quiet = np.mean((blocks <= np.array(limits.alarm)).all(axis=1))
        rates.append(-np.log(quiet) / block * run_length)
    error = np.std(rates, ddof=1) / np.sqrt(len(rates))
    assert error < 0.12
    assert abs(np.mean(rates) - 1.0) < 3.0 * error


@pytest.mark.slow
def test_a_short_baseline_is_called_extrapolated_and_gives_wider_thresholds() -> None:
    short, long = healthy_setup(200, 2000.0), healthy_setup(6001, 2000.0)
    assert short.limits.extrapolated and not long.limits.extrapolated
    assert all(narrow < wide for narrow, wide in zip(long.limits.alarm, short.limits.alarm, strict=True))


@pytest.mark.slow
def test_a_longer_stated_time_between_alarms_gives_wider_thresholds() -> None:
    alarms = [healthy_setup(2000, run_length).limits.alarm for run_length in (100.0, 1000.0, 10_000.0, 1e6)]
    assert all(a < b for low, high in pairwise(alarms) for a, b in zip(low, high, strict=True))


@pytest.mark.slow
def test_a_setup_survives_its_file() -> None:
    setup = healthy_setup(500, 500.0)
    again = SETUP.validate_json(json.dumps(plain(setup)))
    rows = autoregressive(60, COEFFICIENTS, COVARIANCE, 3) + np.array([12.0, -3.0, 0.5])
    first, second = Monitor(setup), Monitor(again)
    for vector in vectors(rows):
        one, other = first.observe(vector), second.observe(vector)
        np.testing.assert_array_equal(one.standard, other.standard)
        assert one._replace(standard=other.standard, onset_s=0.0) == other._replace(onset_s=0.0)


@pytest.mark.slow
def test_a_missing_feature_is_said_and_nothing_is_made_up() -> None:
    setup = healthy_setup(500, 500.0)
    rows = autoregressive(12, COEFFICIENTS, COVARIANCE, 3) + np.array([10.0, -3.0, 0.5])
    rows[6, 1] = np.nan
    monitor = Monitor(setup)
    findings = [monitor.observe(vector) for vector in vectors(rows)]
    assert [found.verdict for found in findings[:3]] == ["learning", "learning", "healthy"]
    assert findings[6].missing == ("feature_1",) and findings[6].charts is None
    assert [found.charts is None for found in findings[6:10]] == [True, True, True, False]


@pytest.mark.slow
@pytest.mark.parametrize("silent", [("feature_1",), ()], ids=["channel silent", "without meaning"])
def test_a_feature_whose_channel_is_silent_is_a_finding_until_it_comes_again(silent: tuple[str, ...]) -> None:
    """A machine that strikes no more gives no impact, and its cycles would otherwise only not be judged."""
    setup = healthy_setup(500, 500.0)
    rows = autoregressive(200, COEFFICIENTS, COVARIANCE, 3) + np.array([10.0, -3.0, 0.5])
    rows[::2, 1] = np.nan  # every other cycle at first
    rows[60:100, 1] = np.nan
    rows[100:, 1] = -3.0
    monitor = Monitor(setup)
    findings = [
        monitor.observe(vector if np.isfinite(vector.values[1]) else vector._replace(silent=silent))
        for vector in vectors(rows)
    ]
    named = [i for i, found in enumerate(findings) if found.finding == "sensor_dropout:feature_1"]
    assert named == (list(range(60 + SILENT - 1, 100)) if silent else [])
    if silent:
        assert findings[named[2]].faults[0].state == "active"
        assert findings[-1].faults[0].state == "latched"


def test_features_and_innovations_are_each_others_inverse() -> None:
    baseline = healthy_baseline(500)[0]
    shocks = np.random.default_rng(4).standard_normal((50, 3))
    np.testing.assert_allclose(baseline.innovations(baseline.features(shocks)), shocks[baseline.order :], atol=1e-9)


def test_too_few_cycles_are_no_baseline() -> None:
    with pytest.raises(StudyError, match="holds 20 complete cycles; expected at least 30"):
        fitted_baseline(vectors(autoregressive(20, COEFFICIENTS, COVARIANCE, 3)))


@given(st.lists(st.booleans(), max_size=60), st.integers(1, 5), st.integers(1, 12))
def test_a_fault_is_active_only_after_its_debounce_and_gone_only_after_its_hysteresis(
    seen: list[bool], debounce: int, clear: int
) -> None:
    rules, life = LifeRules(debounce, clear), FaultLife("spring_soft")
    for cycle, here in enumerate(seen, 1):
        before, life = life, after_cycle(life, here, float(cycle), rules)
        if life.state == "active" and before.state in ("cleared", "pending"):
            assert cycle >= debounce and all(seen[cycle - debounce : cycle])
        if before.state == "active" and life.state != "active":
            assert life.state == "latched" and not any(seen[cycle - clear : cycle])
        if before.state == "latched" and not here:
            assert life.state == "latched"


def test_an_acknowledged_fault_clears_itself_and_a_latched_one_by_the_word() -> None:
    rules = LifeRules(1, 1)
    active = after_cycle(FaultLife("x"), True, 1.0, rules)
    latched = after_cycle(active, False, 2.0, rules)
    assert (active.state, latched.state, acknowledged(latched, 3.0).state) == ("active", "latched", "cleared")
    assert after_cycle(acknowledged(active, 1.5), False, 2.0, rules).state == "cleared"


def test_a_shelved_fault_lives_on_unannounced_until_its_time() -> None:
    life = shelved(after_cycle(FaultLife("x"), True, 1.0, LifeRules(1, 1)), 10.0)
    assert life.state == "active"
    assert not life.is_announced(9.9) and life.is_announced(10.0)


def test_a_fault_that_comes_again_is_not_acknowledged_even_where_one_cycle_makes_it_active() -> None:
    rules, life = LifeRules(debounce=1, clear=2), FaultLife("worn")
    life = acknowledged(after_cycle(life, True, 1.0, rules), 1.0)
    for _ in range(2):
        assert life.state == "active"
        life = after_cycle(life, False, 2.0, rules)
    assert life.state == "cleared"
    again = after_cycle(life, True, 3.0, rules)
    assert again.state == "active" and not again.is_acknowledged
