# SPDX-License-Identifier: Apache-2.0
"""Sensors at fault are told of the sensor, first, and never of the machine."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mech_twin.capabilities.cycle import TURN
from mech_twin.measurements.measurement_map import read_map
from mech_twin.parameters.load import machine_parameters
from mech_twin.results.opened_runs import columns_of
from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.charts import chart_limits
from mech_twin.studies.monitoring.findings import Findings
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.sensing import MonitoredMachine, Seen, seen_run
from mech_twin.studies.monitoring.sensor_design import simulated_vectors
from mech_twin.studies.monitoring.sensor_quality import ChannelQuality, channel_quality, sensor_findings, sensor_limits

NAME, COLUMN = "vibration_crank", "linkage.slider.position"
SENSOR = {  # beside that which cycles are counted by
    NAME: COLUMN,
    "mb10_breaker": "motor.rotor.effort",
    "compaction_press": "linkage.pendulum.position",
    "impact_mass": "linkage.mass.position",
    "roller_former": "linkage.twist.position",
    "winding_drum": "linkage.drum.effort",
}
QUICK = (NAME, "winding_drum")  # the others take seconds to be watched
MACHINES = [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in SENSOR]
AFTER_CYCLES = 30
SENSORS = Path(__file__).resolve().parents[3] / "benchmarks" / "monitoring" / "sensors"
Samples = tuple[np.ndarray, np.ndarray]


@cache
def watched(name: str) -> tuple[MonitoredMachine, MonitorSetup]:
    machine = MonitoredMachine(name, machine_parameters(name), read_map(SENSORS / f"{name}.yaml", columns_of))
    vectors = simulated_vectors(machine, 90 if name == "winding_drum" else 200, 1)
    baseline, innovations = fitted_baseline(vectors)
    limits = sensor_limits([(vector.end_s - vector.begin_s, vector.quality) for vector in vectors])
    return machine, MonitorSetup(name, baseline, chart_limits(baseline, innovations, 1e5), (), sensors=limits)


@cache
def healthy(name: str) -> tuple[Seen, float, float]:
    """Return a healthy run, an instant in it, and the duration of a cycle (s)."""
    machine, setup = watched(name)
    begin_s, period_s = machine.declared.run_up_s, setup.baseline.period_s
    built, since_s = machine.entry.build(machine.parameters), begin_s + (AFTER_CYCLES + 0.2) * period_s
    duration_s = begin_s + 2.0 * AFTER_CYCLES * period_s
    seen = seen_run(built, machine.sensors, duration_s, random=np.random.default_rng(7), begin_s=begin_s)
    return seen, since_s, period_s


def told(wrong: Callable[[np.ndarray, np.ndarray], Samples], name: str = NAME) -> list[Findings]:
    """Return what the monitor says where a sensor goes wrong."""
    machine, setup = watched(name)
    seen, since_s, _ = healthy(name)
    times, values = seen[SENSOR[name]]
    late = times >= since_s
    after_s, after = wrong(times[late], values[late])
    channel = np.concatenate([times[~late], after_s]), np.concatenate([values[~late], after])
    monitor = Monitor(setup)
    return [monitor.observe(vector) for vector in machine.vectors({**seen, SENSOR[name]: channel})]


def stuck(times: np.ndarray, values: np.ndarray) -> Samples:
    return times, np.full_like(values, values[0])


def dropping(times: np.ndarray, values: np.ndarray) -> Samples:
    kept = np.random.default_rng(1).random(len(times)) > 0.3
    return times[kept], values[kept]


def silent(times: np.ndarray, values: np.ndarray) -> Samples:
    return times[:0], values[:0]


def slower(times: np.ndarray, values: np.ndarray) -> Samples:
    at = np.arange(times[0], times[-1], (times[-1] - times[0]) / (0.7 * len(times)))
    return at, np.interp(at, times, values)


def spiking(times: np.ndarray, values: np.ndarray) -> Samples:
    shown = values.copy()
    shown[10::20] += max(6.0 * channel_quality(times, values).isolation, 0.5 * float(np.ptp(values)))
    return times, shown


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize(
    ("wrong", "kind"),
    [(stuck, "stuck"), (dropping, "dropout"), (silent, "dropout"), (slower, "rate"), (spiking, "spikes")],
)
def test_a_sensor_at_fault_is_named_and_the_machine_is_not(
    wrong: Callable[[np.ndarray, np.ndarray], Samples], kind: str, name: str
) -> None:
    found, (_, since_s, period_s) = told(wrong, name), healthy(name)
    named = {each.finding for each in found if each.time_s > since_s + period_s and each.finding}
    assert named == {f"sensor_{kind}:{SENSOR[name]}"}  # in a cycle that begins before, both are seen
    active = {life.name for each in found for life in each.faults if life.state == "active"}
    assert active == {f"sensor_{kind}:{SENSOR[name]}"}
    first = next(each for each in found if each.finding)
    assert since_s - period_s <= first.onset_s <= since_s + 2.0 * period_s


def test_a_change_of_state_tells_how_far_the_sensor_is_at_fault() -> None:
    events = [event for each in told(slower) for event in each.events]
    assert events[-1].state == "active"
    assert float(events[-1].because.removeprefix("size ")) == pytest.approx(1.0 / 0.7, rel=0.02)


@pytest.mark.parametrize("gain", [-1.0, 180.0 / np.pi], ids=["reversed", "in degrees"])
def test_an_encoder_that_turns_otherwise_than_the_machine_is_named(gain: float) -> None:
    machine, setup = watched(NAME)
    seen, since_s, period_s = healthy(NAME)
    column = machine.declared.reference.column
    times, angles = seen[column]
    monitor = Monitor(setup)
    shown = np.where(times < since_s, angles, gain * angles)
    found = [monitor.observe(vector) for vector in machine.vectors({**seen, column: (times, shown)})]
    assert {each.finding for each in found if each.finding} == {f"sensor_turns:{column}"}
    assert min(each.onset_s for each in found if each.finding) >= since_s - period_s
    assert {life.name for life in found[-1].faults if life.state == "active"} == {f"sensor_turns:{column}"}


@pytest.mark.parametrize("name", MACHINES)
def test_a_healthy_sensor_is_not_named(name: str) -> None:
    assert not any(each.finding for each in told(lambda times, values: (times, values), name))


def test_jitter_does_not_matter() -> None:
    def jittering(times: np.ndarray, values: np.ndarray) -> Samples:
        at = times + np.random.default_rng(2).uniform(-5e-4, 5e-4, len(times))
        return at, np.interp(at, times, values)

    assert not any(each.finding for each in told(jittering))


@pytest.mark.parametrize("later_jitter", [0.0, 0.2, 0.4])
@pytest.mark.parametrize(("spacing", "sizes"), [(1.0, []), (0.93, []), (0.5, [0.5] * 600)])
def test_a_doubled_rate_of_few_jittered_samples_is_told_and_jitter_is_not(
    spacing: float, sizes: list[float], later_jitter: float
) -> None:
    random = np.random.default_rng(3)

    def cycle(interval_s: float, jitter: float) -> tuple[float, dict[str, ChannelQuality]]:
        count = round(0.05 / interval_s)
        times_s = interval_s * (np.arange(count) + np.clip(jitter * random.standard_normal(count), -0.45, 0.45))
        return 0.05, {COLUMN: channel_quality(times_s, np.sin(times_s))}

    limits = sensor_limits([cycle(0.001, 0.2) for _ in range(600)])
    found = [sensor_findings(limits, *cycle(0.001 * spacing, later_jitter)) for _ in range(600)]
    rates = [each.size for findings in found for each in findings if each.kind == "rate"]
    assert rates == pytest.approx(sizes, rel=0.03)


def test_a_channel_with_plateaus_while_healthy_is_not_called_stuck() -> None:
    times = np.linspace(0.0, 1.0, 101)
    flat = np.where(times < 0.6, 0.0, np.sin(times))
    limits = sensor_limits([(1.0, {"body": channel_quality(times, flat)})])
    assert sensor_findings(limits, 1.0, {"body": channel_quality(times, np.zeros(101))}) == ()


def test_samples_that_come_in_bursts_have_no_spacing_that_could_change() -> None:
    """As those of a stream that tells each event besides: the quartile is that of the bursts, or not, by chance."""

    def burst(events: int) -> tuple[float, dict[str, ChannelQuality]]:
        times_s = np.unique(np.concatenate([0.005 * np.arange(20), 0.03 + 0.001 * np.arange(events)]).round(6))
        return 0.1, {COLUMN: channel_quality(times_s, np.sin(times_s))}

    limits = sensor_limits([burst(12 if cycle % 10 else 5) for cycle in range(50)])
    assert sensor_findings(limits, *burst(12)) == ()
    assert sensor_findings(limits, *burst(5)) == ()


def test_a_curve_that_samples_meet_at_other_phases_has_no_spikes_but_a_sample_beside_it_is_one() -> None:
    """Ten to forty samples a turn, at the same phases in every healthy cycle, but for noise of 1e-6."""
    random = np.random.default_rng(3)

    def quality(count: int, phase: float, spike: float = 0.0) -> ChannelQuality:
        times = np.arange(count) * 0.4 / count
        angle = TURN * np.arange(count) / count + phase
        values = np.cos(angle) + 0.4 * np.sin(2.0 * angle) + 1e-6 * random.standard_normal(count)
        values[count // 3] += spike
        return channel_quality(times, values)

    tested = 0
    for count in (10, 20, 40):
        for phase in np.linspace(0.0, TURN / count, 40):
            limits = sensor_limits([(0.4, {"a": quality(count, phase)}) for _ in range(5)])
            for other in np.linspace(0.0, TURN, 50):
                assert sensor_findings(limits, 0.4, {"a": quality(count, other)}) == ()
            if limits["a"].isolation > 0.0:  # a sample met an extremum
                (found,) = sensor_findings(limits, 0.4, {"a": quality(count, phase, 8.0)})
                assert found.kind == "spikes"
                tested += 1
    assert tested >= 5
