# SPDX-License-Identifier: Apache-2.0
"""Live and of a recording the monitor says the same, word for word: losses, wrong sensors and a restart included."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mech_twin.engine.rollout import roll_out
from mech_twin.measurements.measurement_map import MeasurementMap, read_map
from mech_twin.measurements.runs import read_parts
from mech_twin.parameters.load import machine_parameters
from mech_twin.results.opened_runs import columns_of, opened_run
from mech_twin.studies.live_monitor import LiveMonitor
from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.charts import chart_limits
from mech_twin.studies.monitoring.findings import Findings
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.report import judged_run, vectors_of_parts
from mech_twin.studies.monitoring.sensing import MonitoredMachine, Seen, needed_columns, seen_roll_out
from mech_twin.studies.monitoring.sensor_design import simulated_vectors
from mech_twin.studies.monitoring.sensor_quality import sensor_limits
from mech_twin.studies.observer.estimate import SeenSample

NAME, RUN_S, FAULT_S = "vibration_crank", 20.0, 4.0
SENSORS = Path(__file__).resolve().parents[3] / "benchmarks" / "monitoring" / "sensors"


@cache
def watched() -> tuple[MonitoredMachine, MonitorSetup]:
    machine = MonitoredMachine(NAME, machine_parameters(NAME), read_map(SENSORS / f"{NAME}.yaml", columns_of))
    vectors = simulated_vectors(machine, 200, 1)
    baseline, innovations = fitted_baseline(vectors)
    limits = sensor_limits([(vector.end_s - vector.begin_s, vector.quality) for vector in vectors])
    return machine, MonitorSetup(NAME, baseline, chart_limits(baseline, innovations, 1e4), (), sensors=limits)


def plant(seed: int, changed: dict[str, float]) -> Seen:
    """Return what the sensors show of a run from its start on, something changed half way."""
    machine, _ = watched()
    healthy, faulty = machine.entry.build(machine.parameters), machine.entry.build(machine.varied(changed))
    run = roll_out(healthy, RUN_S, needed_columns(machine.sensors), None, 1.0, [(FAULT_S, faulty)])
    return seen_roll_out(run, machine.sensors, healthy.coupling_step_s, np.random.default_rng(seed), 0.0)


def rows_of(seen: Seen, lost: float, seed: int) -> list[tuple[float, str, float]]:
    """Return samples in the order they come, a share of them lost from the fault on."""
    random, found = np.random.default_rng(seed), []
    for column, (times, values) in seen.items():
        kept = (random.random(len(times)) >= lost) | (times < FAULT_S)
        found += [(float(t), column, float(x)) for t, x in zip(times[kept], values[kept], strict=True)]
    return sorted(found)


def written(path: Path, rows: list[tuple[float, str, float]], columns: list[str]) -> MeasurementMap:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time", *columns])
        for at_s, column, value in rows:
            table.writerow([repr(at_s), *(repr(value) if each == column else "" for each in columns)])
    channels = [{"source": {"column": column}, "is": column} for column in columns]
    return MeasurementMap.model_validate({"machine": NAME, "time": {"column": "time"}, "channels": channels})


def live_of(starts: list[list[tuple[float, str, float]]], columns: list[str]) -> list[Findings]:
    machine, setup = watched()
    live, found = LiveMonitor(setup, machine.declared, columns), list[Findings]()
    for place, rows in enumerate(starts):
        if place:
            live.begin_anew()
        for at_s, column, value in rows:
            found += live.take(SeenSample(at_s, (columns.index(column),), (value,)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lost", "starts", "changed", "expected"),
    [
        (0.0, 1, {"masses.extra_kg": 10.0}, {"unknown active"}),
        (0.3, 1, {}, {"active"}),
        (0.0, 2, {"masses.extra_kg": 10.0}, {"unknown active"}),
    ],
)
def test_live_and_recorded_tell_the_same_story(
    lost: float, starts: int, changed: dict[str, float], expected: set[str], tmp_path: Path
) -> None:
    machine, setup = watched()
    columns = list(machine.columns)
    runs = [rows_of(plant(seed, changed), lost, seed) for seed in range(starts)]
    live = live_of(runs, columns)
    told_live = [event.text for found in live for event in found.events]
    given = written(tmp_path / "run.csv", [row for rows in runs for row in rows], columns)
    with opened_run(tmp_path / "run.csv") as reader:
        parts = read_parts(reader, given)
    assert len(parts) == starts
    feed = machine.feed()
    feed.run_up_s = machine.declared.run_up_s
    _, vectors = vectors_of_parts(feed, parts)
    recorded = judged_run(
        Monitor(setup), [vector for vector in vectors if vector.end_s <= live[-1].time_s or starts > 1]
    )
    told = [event.text for event in recorded.events]
    assert told_live
    assert told[: len(told_live)] == told_live
    assert all(any(text.partition(": size ")[0].endswith(words) for text in told_live) for words in expected)
    sensor_lines = [text for text in told_live if "sensor_" in text]
    assert (len(sensor_lines) == len(told_live)) if lost else not sensor_lines
