# SPDX-License-Identifier: Apache-2.0
"""The monitor inside a shadow: live as of a recording; life of a fault, services, black box."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_run import ShadowBench
from catalogue import built
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from mech_twin.declarations.configuration_tree import configuration_tree, merged_tree, tree_from_flat
from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.runs import read_run
from mech_twin.messages.cdr import Header, StepMessage, encoded, stamp_of
from mech_twin.messages.topics import DATA, DIAGNOSTICS, STANDARD_RESIDUALS, full_name
from mech_twin.nodes.shadow.monitor_node import FAULT, SHELVE_S, MonitorNode
from mech_twin.nodes.shadow.session import BlackBox, Company, ShadowRecorder
from mech_twin.parameters.load import catalogue_entry
from mech_twin.recording.bag_reader import open_bag
from mech_twin.results.opened_runs import opened_run
from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.charts import chart_limits
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, FeatureVector, feed_channels
from mech_twin.studies.monitoring.findings import FaultLife, Findings
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.observer.estimate import SeenSample

pytestmark = [pytest.mark.usefixtures("ros_domain"), pytest.mark.slow]
NAME, EVERY, BURST = "vibration_crank", 20, 50
SOURCE = {"topic": "/plant/wheel", "joint": "main_shaft"}
MAP = MeasurementMap.model_validate(
    {
        "machine": NAME,
        "channels": [
            {"source": {**SOURCE, "field": "position"}, "is": "linkage.crank.position", "sigma": 1e-3},
            {"source": {**SOURCE, "field": "effort"}, "is": "linkage.crank.effort", "sigma": 2.0},
        ],
    }
)
COLUMNS = ("linkage.crank.position", "linkage.crank.effort")


def run_of(seconds: float, **changes: float) -> RollOut:
    entry = catalogue_entry(NAME)
    tree = configuration_tree(built(NAME).parameters)
    flat = {key.replace("__", "."): value for key, value in changes.items()}
    return roll_out(entry.build(entry.parameters.model_validate(merged_tree(tree, tree_from_flat(flat)))), seconds)


def noisy(run: RollOut, seed: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    times = run["time_s"][::EVERY]
    shown = {name: run[name][::EVERY] for name in COLUMNS}
    sigma = dict(zip(COLUMNS, (1e-3, 2.0), strict=True))
    return {"time_s": times} | {n: x + sigma[n] * random.standard_normal(len(x)) for n, x in shown.items()}


def vectors_of(channels: dict[str, tuple[np.ndarray, np.ndarray]]) -> list[FeatureVector]:
    ask = catalogue_entry(NAME).capabilities.features
    assert ask is not None
    declared = ask(built(NAME).parameters)
    return feed_channels(FeatureFeed(declared, COLUMNS, run_up_s=declared.run_up_s), channels)


@pytest.fixture(scope="module")
def setup() -> MonitorSetup:
    shown = noisy(run_of(160.0), 1)
    vectors = vectors_of({name: (shown["time_s"], shown[name]) for name in COLUMNS})
    baseline, innovations = fitted_baseline(vectors)
    return MonitorSetup(NAME, baseline, chart_limits(baseline, innovations, 1000.0), (), settling_cycles=1)


class MonitoredPlant(ShadowBench):
    """A foreign publisher, a shadow with monitor, recorder and black box, and an operator."""

    def __init__(self, setup: MonitorSetup, folder: Path) -> None:
        super().__init__(NAME, MAP, Company(folder / "bag", setup, folder / "faults"))
        self.findings: list[Findings] = []
        take = self.of(MonitorNode).live.take

        def told(sample: Any) -> list[Findings]:
            found = take(sample)
            self.findings += found
            return found

        self.of(MonitorNode).live.take = told
        self.wheel = self.client.create_publisher(JointState, "/plant/wheel", DATA)
        self.standard: list[JointState] = []
        self.said: list[DiagnosticArray] = []
        self.client.create_subscription(JointState, full_name(NAME, STANDARD_RESIDUALS), self.standard.append, DATA)
        self.client.create_subscription(DiagnosticArray, DIAGNOSTICS.name, self.said.append, DATA)

    def play(self, shown: dict[str, np.ndarray], from_s: float) -> None:
        recorder = self.of(ShadowRecorder)
        for i, (at, crank, torque) in enumerate(zip(*shown.values(), strict=True), 1):
            header = Header(stamp_of(from_s + float(at)))
            self.wheel.publish(encoded(StepMessage(header, ("main_shaft",), (float(crank),), (0.0,), (float(torque),))))
            self.sent += 1
            if i % BURST == 0:
                self.until(lambda: recorder.received.get("/plant/wheel", 0) >= self.sent)

    def answer(self, service: str) -> Trigger.Response:
        return self.call(Trigger, f"/{NAME}/monitor/{service}", Trigger.Request())

    def __enter__(self) -> MonitoredPlant:
        self.sent = 0
        self.until(lambda: self.wheel.get_subscription_count() >= 1)
        return self


def has_active_fault(monitor: MonitorNode) -> bool:
    return any(life.state == "active" for life in monitor.live.monitor.lives.values())


def test_live_is_what_a_recording_says_and_a_fault_is_told_kept_and_acknowledged(
    setup: MonitorSetup, tmp_path: Path
) -> None:
    with MonitoredPlant(setup, tmp_path) as bench:
        monitor = bench.of(MonitorNode)
        bench.play(noisy(run_of(16.0), 2), 0.0)
        assert not has_active_fault(monitor)
        assert bench.answer("acknowledge").success is False
        heavy = run_of(36.0, masses__extra_kg=10.0)
        bench.play({name: values[801:] for name, values in noisy(heavy, 3).items()}, 0.0)
        assert has_active_fault(monitor)
        bench.until(lambda: any(s.name.endswith(": unknown") for array in bench.said for s in array.status))
        status = [s for array in bench.said for s in array.status if s.name.endswith(": unknown")][-1]
        monitor.set_parameters([Parameter(FAULT, value="another")])
        refused = bench.answer("shelve")
        monitor.set_parameters([Parameter(FAULT, value="unknown")])
        assert bench.answer("acknowledge").success
        assert bench.answer("shelve").message == "shelved: unknown"
        bench.until(lambda: len(bench.standard) >= len(bench.findings))
        live, boxes = bench.findings, bench.of(BlackBox).bags
        (life,) = monitor.live.monitor.lives.values()
    values = {value.key: value.value for value in status.values}
    assert status.hardware_id == NAME
    assert values["state"] == "active"
    assert float(values["arl0 h"]) == pytest.approx(1000.0 * setup.baseline.period_s / 3600.0, rel=1e-3)
    assert not refused.success
    assert life.is_acknowledged
    assert life.shelved_until_s > live[-1].time_s
    with opened_run(tmp_path / "bag") as reader:
        run = read_run(reader, MAP)
    offline = Monitor(setup)
    again = [offline.observe(v) for v in vectors_of({c.name: (c.times_s, c.values) for c in run.channels})][: len(live)]
    innovations = [np.array([found.standard for found in findings]) for findings in (live, again)]
    assert np.array_equal(*innovations, equal_nan=True)
    told = [[event.text for found in findings for event in found.events] for findings in (live, again)]
    assert told[0] == told[1] != []
    assert [(found.verdict, found.alarm) for found in live] == [(found.verdict, found.alarm) for found in again]
    active_s = next(f.time_s for f in live if any(each.state == "active" for each in f.faults))
    (box,) = boxes
    with open_bag(box) as reader:
        assert reader.start_ns is not None
        assert reader.end_ns is not None
        assert reader.start_ns * 1e-9 == pytest.approx(active_s - 10.0, abs=0.1)
        assert reader.end_ns * 1e-9 == pytest.approx(active_s + 5.0, abs=0.1)


def strange_samples(at_s: float) -> list[bytes]:
    """Return samples of the followed channel that no machine sends, and one of another time."""
    values = [math.nan, math.inf, -math.inf, 1e300, -1e300]
    rows = [(at_s, ("main_shaft",), (value,), (value,)) for value in values]
    rows += [(at_s, ("another",), (0.0,), (0.0,)), (1e9, ("main_shaft",), (0.0,), (0.0,))]
    return [encoded(StepMessage(Header(stamp_of(t)), names, at, (0.0,), effort)) for t, names, at, effort in rows]


def test_a_monitor_goes_on_judging_whatever_strangers_say(setup: MonitorSetup, tmp_path: Path) -> None:
    shown = noisy(run_of(16.0), 2)
    half = len(shown["time_s"]) // 2
    with MonitoredPlant(setup, tmp_path) as bench:
        monitor = bench.of(MonitorNode)
        bench.play({name: values[:half] for name, values in shown.items()}, 0.0)
        before = monitor.live.newest.number
        for raw in strange_samples(float(shown["time_s"][half])):
            bench.wheel.publish(raw)
            bench.sent += 1
        bench.play({name: values[half:] for name, values in shown.items()}, 0.0)
        bench.until(lambda: monitor.live.newest.number > before + 3)
        verdicts = [found.verdict for found in bench.findings]
        assert not has_active_fault(monitor)
    assert "named" not in verdicts


def test_a_monitor_whose_encoder_is_stuck_says_since_when_there_is_no_cycle(
    setup: MonitorSetup, tmp_path: Path
) -> None:
    with MonitoredPlant(setup, tmp_path) as bench:
        monitor, shown = bench.of(MonitorNode), noisy(run_of(8.0), 2)
        for at_s, position, effort in zip(*shown.values(), strict=True):
            monitor.observe(SeenSample(float(at_s), (0, 1), (float(position), float(effort))))
        assert monitor.diagnostics.state == "healthy"
        for at_s in np.arange(8.0, 13.0, 0.02):
            monitor.observe(SeenSample(float(at_s), (0, 1), (float(position), 0.0)))
        last_s = monitor.live.newest.time_s
        assert monitor.diagnostics.state == f"no cycle since {last_s:.3f} s" and 7.0 < last_s < 8.1


def test_a_fault_is_acknowledged_by_its_name_alone_or_in_a_group_once_it_is_active(
    setup: MonitorSetup, tmp_path: Path
) -> None:
    with MonitoredPlant(setup, tmp_path) as bench:
        monitor = bench.of(MonitorNode)
        states = {"a": "cleared", "b": "pending", "c or d": "active", "e": "latched"}
        monitor.live.monitor.lives = {name: FaultLife(name, state) for name, state in states.items()}
        told = []
        for fault in ("a", "b", "d", ""):
            monitor.set_parameters([Parameter(FAULT, value=fault)])
            told.append(bench.answer("acknowledge"))
        there = "b is pending; c or d is active; e is latched"
        assert [(answer.success, answer.message) for answer in told] == [
            (False, f"no fault 'a' that can be acknowledged: {there}"),
            (False, f"no fault 'b' that can be acknowledged: {there}"),
            (True, "acknowledged: c or d"),
            (True, "acknowledged: c or d, e"),
        ]
        assert bench.answer("shelve").message == "shelved: b, c or d"
        monitor.live.begin_anew()
        assert not any(math.isfinite(life.shelved_until_s) for life in monitor.live.monitor.lives.values())


@pytest.mark.parametrize("shelve_s", [math.nan, math.inf, 0.0, -60.0, 1e300])
def test_a_fault_is_shelved_for_a_time_that_is_one(shelve_s: float, setup: MonitorSetup, tmp_path: Path) -> None:
    with MonitoredPlant(setup, tmp_path) as bench:
        (told,) = bench.of(MonitorNode).set_parameters([Parameter(SHELVE_S, value=shelve_s)])
        assert not told.successful
        assert SHELVE_S in told.reason
        assert bench.of(MonitorNode).set_parameters([Parameter(SHELVE_S, value=60.0)])[0].successful
