# SPDX-License-Identifier: Apache-2.0
"""A commissioned monitor calls a healthy machine healthy at any operating point, and a fault by its name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from runpy import run_path

import numpy as np
import pytest

from mech_twin.capabilities.cycle import TURN
from mech_twin.capabilities.faults import MachineFault, value_at
from mech_twin.capabilities.variation import varied
from mech_twin.files.output_file import plain
from mech_twin.parameters.live_change import ChangingMachine, live_changes
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.findings import Findings
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.operating_fit import operated_run, operating_surface, parameters_at
from mech_twin.studies.monitoring.report import judged_run
from mech_twin.studies.monitoring.sensing import (
    MonitoredMachine,
    SensorFault,
    seen_roll_out,
    seen_run,
    with_sensor_fault,
)
from mech_twin.studies.monitoring.sensor_design import PROMPT_CYCLES, fitted_setup, sensor_design, simulated_vectors
from mech_twin.studies.monitoring.setup_record import SETUP

PLANTS = Path(__file__).resolve().parents[3] / "benchmarks" / "monitoring" / "plants.py"
monitored_in_the_proof = run_path(str(PLANTS))["monitored_machine"]  # a press with a motor
MONITORED = sorted(sensors.stem for sensors in (PLANTS.parent / "sensors").glob("*.yaml"))
CYCLES = {"winding_drum": 150}  # then its package runs off


@cache
def commissioned(name: str) -> tuple[MonitoredMachine, MonitorSetup]:
    """Return a machine and its monitor, kept and read again, as a day later."""
    machine = monitored_in_the_proof(name)
    setup = fitted_setup(machine, simulated_vectors(machine, CYCLES.get(name, 600), 1), 24.0)
    return machine, SETUP.validate_json(json.dumps(plain(setup)))


def sensed(machine: MonitoredMachine, **keys: float | None) -> MonitoredMachine:
    """Return the machine with keys of every channel changed."""
    channels = tuple(channel.model_copy(update=keys) for channel in machine.sensors.channels)
    return replace(machine, sensors=machine.sensors.model_copy(update={"channels": channels}))


def another_day(name: str, point: Mapping[str, float], fault: Mapping[str, float] | None = None) -> list[Findings]:
    """Return what the monitor says of cycles at another operating point."""
    machine, setup = commissioned(name)
    variables = [variable for variable in machine.operating if variable.name in point]
    parameters = parameters_at(machine.parameters, variables, [point[variable.name] for variable in variables])
    assert parameters is not None
    begin_s, monitor = machine.declared.run_up_s, Monitor(setup)
    seen = seen_run(
        machine.entry.build(varied(parameters, fault or {})), machine.sensors,
        begin_s + min(CYCLES.get(name, 200), 200) * setup.baseline.period_s,
        random=np.random.default_rng(5), begin_s=begin_s,
    )  # fmt: skip
    return [monitor.observe(vector) for vector in machine.vectors(seen)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mb10_breaker", "vibration_crank"])
@pytest.mark.parametrize("share", [-0.05, -0.02, 0.02, 0.05])
def test_mains_off_by_a_little_are_an_operating_point_and_no_fault(name: str, share: float) -> None:
    told = another_day(name, {"supply_frequency": share})
    assert not any(found.faults for found in told)
    assert {found.verdict for found in told[-50:]} == {"operating_point"}
    (value,) = (value for value in told[-1].operating if value.name == "supply_frequency")
    assert value.share == pytest.approx(share, abs=5e-4)
    assert value.low_95 <= value.share <= value.high_95


@pytest.mark.timeout(900)  # the first of a machine commissions it
@pytest.mark.slow
@pytest.mark.parametrize("share", [-0.9, 0.9])
@pytest.mark.parametrize(
    ("name", "variable"),
    [
        ("compaction_press", "supply_frequency"), ("compaction_press", "layer"),
        ("roller_former", "supply_frequency"), ("roller_former", "mix"),
        ("winding_drum", "yarn_weight"),
    ],
)  # fmt: skip
def test_each_machine_is_healthy_anywhere_in_its_ranges_and_the_variable_is_told(
    name: str, variable: str, share: float
) -> None:
    machine, _ = commissioned(name)
    (declared,) = (each for each in machine.operating if each.name == variable)
    told = another_day(name, {variable: share * declared.range})
    assert not any(found.faults for found in told)
    assert "operating_point" in {found.verdict for found in told[-50:]}
    (value,) = (value for value in told[-1].operating if variable in value.name.split(" or "))
    assert value.share == pytest.approx(share * declared.range, abs=0.35 * declared.range)


@pytest.mark.slow
@pytest.mark.parametrize("share", [-0.05, 0.05])
def test_a_step_of_the_mains_within_their_range_alarms_at_no_phase_of_the_cycle(share: float) -> None:
    machine, setup = commissioned("vibration_crank")
    period_s, healthy = setup.baseline.period_s, machine.entry.build(machine.parameters)
    stepped = parameters_at(machine.parameters, machine.operating[:1], [share])
    assert stepped is not None
    for phase in (0.05, 0.2, 0.3, 0.45, 0.55, 0.7, 0.8, 0.95):
        change_s = machine.declared.run_up_s + (20.0 + phase) * period_s
        seen = seen_run(
            healthy, machine.sensors, change_s + 30.0 * period_s, random=np.random.default_rng(3),
            begin_s=machine.declared.run_up_s, changes=[(change_s, machine.entry.build(stepped))],
        )  # fmt: skip
        found = judged_run(Monitor(setup), machine.vectors(seen))
        assert found.alarms == ()
        assert found.operating[0].share == pytest.approx(share, abs=1e-3)


@pytest.mark.slow
def test_a_step_is_over_at_once_also_for_sensors_whose_noise_the_map_does_not_give() -> None:
    """Where features differ by the phase of sampling alone, no movement lasts."""
    machine = monitored_in_the_proof("vibration_crank")
    noisy = sensed(machine, rate_hz=200.0)
    vectors = simulated_vectors(noisy, 150, 0)
    surface = operating_surface(sensed(noisy, sigma=None), vectors, vectors[0].names)
    assert surface is not None
    assert surface.hold <= 3  # cycles, in which no chart sees a fault that moves the point


@pytest.mark.slow
@pytest.mark.parametrize("share", [-0.04, 0.04])
def test_effects_are_those_about_the_point_of_the_baseline_wherever_that_is(share: float) -> None:
    machine = monitored_in_the_proof("vibration_crank")
    elsewhere = parameters_at(machine.parameters, machine.operating[:1], [share])
    assert elsewhere is not None
    setup = fitted_setup(machine, simulated_vectors(replace(machine, parameters=elsewhere), 600, 1), 24.0)
    for later in (0.0, 0.75 * share):
        there = parameters_at(machine.parameters, machine.operating[:1], [later])
        assert there is not None
        found = judged_run(Monitor(setup), simulated_vectors(replace(machine, parameters=there), 150, 2))
        assert found.alarms == ()
        assert found.operating[0].share == pytest.approx((1.0 + later) / (1.0 + share) - 1.0, abs=1e-3)


@pytest.mark.slow
def test_a_drift_of_the_yarns_speed_acts_on_the_torque_by_no_more_than_the_charts_allow() -> None:
    machine, setup = commissioned("winding_drum")
    step_s = machine.entry.build(machine.parameters).coupling_step_s
    at_s = np.arange(0.0, machine.declared.run_up_s + 40.0, 0.2)
    steps = round(at_s[-1] / step_s)
    means = []
    for swing in (0.0, 0.05):  # a sine of ten minutes, at its steepest
        shares = np.stack([swing * np.sin(TURN * at_s / 600.0), 0.0 * at_s], axis=1)
        run = operated_run(machine, machine.operating, at_s, shares, np.ones(steps + 1))
        seen = seen_roll_out(run, machine.sensors, step_s, np.random.default_rng(4), machine.declared.run_up_s)
        assert setup.operating is not None
        means.append(np.nanmean([setup.operating.reduced(v)[0].values for v in machine.vectors(seen)], axis=0))
    moved, spread = np.abs(means[1] - means[0]), np.sqrt(np.diag(setup.baseline.covariance))
    assert moved[0] > 0.4 * spread[0]
    assert (moved < 1.3 * setup.operating.drift + 0.3 * spread).all()


@pytest.mark.slow
@pytest.mark.parametrize("share", [-0.1, 0.1])
def test_a_load_within_its_range_is_no_fault_and_beyond_it_is(share: float) -> None:
    within = another_day("vibration_crank", {"boom_load": share})
    assert not any(found.faults for found in within)
    (value,) = within[-1].operating
    assert (value.name, value.share) == ("boom_load", pytest.approx(share, abs=2e-3))
    beyond = another_day("vibration_crank", {"boom_load": 2.0 * share})
    assert beyond[-1].finding == "boom_load"
    (named,) = beyond[-1].candidates
    assert min(abs(named.low_95), abs(named.high_95)) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.02])
def test_a_fault_is_named_and_sized_at_another_operating_point_too(share: float) -> None:
    told = another_day("mb10_breaker", {"supply_frequency": share}, {"body.spring_rate_n_per_m": 0.8 * 53300.0})
    spring = next(candidate for candidate in told[-1].candidates if candidate.name == "spring_soft")
    assert spring.low_95 <= -0.2 <= spring.high_95 or spring.size == pytest.approx(-0.2, abs=0.02)
    assert {candidate.name for candidate in told[-1].candidates} <= {"spring_soft", "preload_lost"}


def change_text(machine: MonitoredMachine, fault: MachineFault, size: float, time_s: float) -> str:
    """Return what `--change` is given."""
    return f"{fault.name}={100.0 * size!r}%@{time_s!r}" if fault.unit == "1" else f"{fault.name}={size!r}@{time_s!r}"


@pytest.mark.parametrize("name", MONITORED)
def test_each_fault_at_each_size_can_be_made_by_a_change_in_a_run(name: str) -> None:
    machine = monitored_in_the_proof(name)
    healthy = machine.entry.build(machine.parameters)
    for fault in machine.faults:
        for size in fault.sizes:
            text = change_text(machine, fault, size, 1.0)
            run = ChangingMachine(healthy, live_changes([text]))
            later = run.revisions[-1][1].parameters
            for key, wanted in fault.changes(machine.parameters, size).items():
                made = value_at(later, key) if wanted is not None else None
                assert made == (pytest.approx(wanted, rel=1e-12) if isinstance(wanted, float) else wanted), text


def last_told(machine: MonitoredMachine, setup: MonitorSetup, fault: MachineFault, size: float) -> Findings:
    """Return what is said 80 cycles after a fault has come, in a run that was healthy until then."""
    begin_s, period_s = machine.declared.run_up_s, setup.baseline.period_s
    change_s, healthy = begin_s + 20.4 * period_s, machine.entry.build(machine.parameters)
    made = ChangingMachine(healthy, live_changes([change_text(machine, fault, size, change_s)]))
    step_s, end_s = healthy.coupling_step_s, change_s + 81.0 * period_s
    seen = seen_run(
        healthy, machine.sensors, end_s, random=np.random.default_rng(7), begin_s=begin_s,
        command=np.array([made.command(step) for step in range(round(end_s / step_s) + 1)]),
        changes=[(step * step_s, revision) for step, revision in made.revisions[1:]],
    )  # fmt: skip
    monitor = Monitor(setup)
    findings = [monitor.observe(vector) for vector in machine.vectors(seen)]
    assert not any(found.alarm for found in findings if found.time_s < change_s)
    return findings[-1]


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", MONITORED)
def test_each_fault_that_the_sensors_are_said_to_find_is_named_when_made_by_its_name(name: str) -> None:
    """At the size that `--design` tells of; or what it tells that they cannot tell apart from it."""
    machine, setup = commissioned(name)
    designs = {design.name: design for design in sensor_design(setup).faults}
    wrong, found = {}, 0
    for fault in machine.faults:
        design = designs[fault.name]
        if design.delay_cycles > PROMPT_CYCLES:
            continue
        told = last_told(machine, setup, fault, design.size)
        names, found = {candidate.name for candidate in told.candidates}, found + 1
        if fault.name not in names and not (names and names <= {*design.alike}):
            wrong[fault.name] = (design.size, told.verdict, names)
    assert wrong == {}
    assert found >= 2


def findings_of(vectors: list[FeatureVector], monitor: Monitor) -> list[Findings]:
    return [monitor.observe(vector) for vector in vectors]


@pytest.mark.slow
def test_live_and_recorded_give_the_same_findings() -> None:
    machine, setup = commissioned("vibration_crank")
    begin_s = machine.declared.run_up_s
    seen = seen_run(
        machine.entry.build(machine.parameters), machine.sensors, begin_s + 24.0,
        random=np.random.default_rng(7), begin_s=begin_s,
    )  # fmt: skip
    seen = with_sensor_fault(seen, SensorFault("linkage.slider.position", gain=0.05), begin_s + 10.0)
    recorded = findings_of(machine.vectors(seen), Monitor(setup))
    feed, monitor, live = machine.feed(), Monitor(setup), []
    for first in range(0, 12_000, 20):  # forty milliseconds at a time, the reference first
        for column, (times, values) in seen.items():
            live += findings_of(feed.feed(column, times[first : first + 20], values[first : first + 20]), monitor)
    live += findings_of(feed.finish(), monitor)
    assert len(recorded) == len(live) > 50
    assert any(found.finding == "sensor_gain:linkage.slider.position" for found in live)
    for one, other in zip(recorded, live, strict=True):
        np.testing.assert_array_equal(one.standard, other.standard)
        assert (one.charts, one.verdict, one.candidates, one.faults) == (
            other.charts, other.verdict, other.candidates, other.faults,
        )  # fmt: skip


@pytest.mark.slow
def test_a_fifth_off_the_breakers_spring_rate_is_found_within_fifty_blows() -> None:
    machine, setup = commissioned("mb10_breaker")
    begin_s, period_s = machine.declared.run_up_s, setup.baseline.period_s
    change_s = begin_s + 20.4 * period_s
    faulty = machine.entry.build(machine.varied({"body.spring_rate_n_per_m": 0.8 * 53300.0}))
    seen = seen_run(
        machine.entry.build(machine.parameters), machine.sensors, change_s + 52.0 * period_s,
        random=np.random.default_rng(7), begin_s=begin_s, changes=[(change_s, faulty)],
    )  # fmt: skip
    found = judged_run(Monitor(setup), machine.vectors(seen))
    (alarm,) = found.alarms
    assert 0.0 <= alarm.alarm_s - change_s <= 50.0 * period_s
    spring = next(candidate for candidate in alarm.candidates if candidate.name == "spring_soft")
    assert spring.low_95 <= -0.2 <= spring.high_95
    assert {candidate.name for candidate in alarm.candidates} <= {"spring_soft", "preload_lost"}


@pytest.mark.slow
def test_a_standing_alarm_follows_the_breakers_spring_until_it_is_weakest() -> None:
    machine, setup = commissioned("mb10_breaker")
    begin_s, period_s = machine.declared.run_up_s, setup.baseline.period_s
    each_s = 170.0 * period_s  # beyond the first cycles of an alarm, and the newest that are averaged
    steps = [(begin_s + 30.4 * period_s + i * each_s, share) for i, share in enumerate([-0.06, -0.15, -0.1, -0.24])]
    seen = seen_run(
        machine.entry.build(machine.parameters), machine.sensors, steps[-1][0] + each_s,
        random=np.random.default_rng(7), begin_s=begin_s,
        changes=[
            (at_s, machine.entry.build(machine.varied({"body.spring_rate_n_per_m": (1.0 + share) * 53300.0})))
            for at_s, share in steps
        ],
    )  # fmt: skip
    findings = findings_of(machine.vectors(seen), Monitor(setup))
    assert sum(found.alarm_begins for found in findings) == 1
    for (at_s, _), share in zip(steps, (-0.06, -0.15, -0.15, -0.24), strict=True):
        last = [found for found in findings if at_s < found.time_s < at_s + each_s][-1]
        spring = next(candidate for candidate in last.candidates if candidate.name == "spring_soft")
        assert spring.low_95 <= share <= spring.high_95
        assert spring.high_95 - spring.low_95 < 0.08
