# SPDX-License-Identifier: Apache-2.0
"""Events in the map of a shadow: the observer passes them over, the monitor has their features, live as recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_run import ShadowBench
from catalogue import built
from geometry_msgs.msg import Vector3Stamped
from sensor_msgs.msg import JointState

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.rollout import roll_out
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.runs import read_run
from mech_twin.messages.cdr import Header, StepMessage, encoded, stamp_of
from mech_twin.messages.topics import DATA
from mech_twin.nodes.shadow.inputs import followed_topics
from mech_twin.nodes.shadow.monitor_node import MonitorNode
from mech_twin.nodes.shadow.session import Company, ShadowRecorder
from mech_twin.parameters.load import catalogue_entry
from mech_twin.results.opened_runs import opened_run
from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.charts import chart_limits
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, FeatureVector, feed_channels
from mech_twin.studies.monitoring.findings import Findings
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.sensing import Seen, seen_roll_out
from mech_twin.studies.observer.estimate import SeenSample

NAME, BURST = "impact_mass", 50
JOINTS = {"generator": "motor.generator.effort", "mass": "linkage.mass.position"}
FIELDS = {"stamp": "time", "vector.x": "pre_velocity", "vector.y": "post_velocity"}
IMPACT = "stop/impact"
MAP = MeasurementMap.model_validate(
    {
        "machine": NAME,
        "channels": [
            {"source": {"topic": "/plant/impacts", "joint": IMPACT, "field": field}, "is": f"event.impact.{what}"}
            for field, what in FIELDS.items()
        ]
        + [
            {"source": {"topic": "/plant/joints", "joint": joint, "field": field}, "is": column, "sigma": 1e-3}
            for joint, field, column in zip(JOINTS, ("effort", "position"), JOINTS.values(), strict=True)
        ],
    }
)  # fmt: skip
COLUMNS = tuple(channel.quantity for channel in MAP.channels)


def seen(seconds: float, seed: int) -> Seen:
    machine = built(NAME)
    run = roll_out(machine, seconds, list(JOINTS.values()))
    return seen_roll_out(run, MAP, machine.coupling_step_s, np.random.default_rng(seed))


def vectors_of(channels: Seen) -> list[FeatureVector]:
    ask = catalogue_entry(NAME).capabilities.features
    assert ask is not None
    declared = ask(built(NAME).parameters)
    return feed_channels(FeatureFeed(declared, COLUMNS, run_up_s=declared.run_up_s), channels)


def messages_of(channels: Seen) -> list[tuple[float, str, Any]]:
    """Return stamps, topics and messages in the order of time: of the joints together, and of each impact."""
    force, position = (channels[column] for column in JOINTS.values())
    told: list[tuple[float, str, Any]] = []
    for at, x, f in zip(position[0], position[1], force[1], strict=True):
        header, zeros = Header(stamp_of(float(at))), (0.0, 0.0)
        message = StepMessage(header, tuple(JOINTS), (0.0, float(x)), zeros, (float(f), 0.0))
        told.append((float(at), "joints", encoded(message)))
    before, after = (channels[f"event.impact.{what}"][1] for what in ("pre_velocity", "post_velocity"))
    for at, pre, post in zip(channels["event.impact.time"][0], before, after, strict=True):
        impact = Vector3Stamped()
        impact.header.frame_id = IMPACT
        impact.header.stamp.sec, impact.header.stamp.nanosec = stamp_of(float(at))
        impact.vector.x, impact.vector.y = float(pre), float(post)
        told.append((float(at), "impacts", impact))
    return sorted(told, key=lambda each: each[0])


@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain")
def test_features_of_events_are_judged_live_as_of_the_recording(tmp_path: Path) -> None:
    baseline, innovations = fitted_baseline(vectors_of(seen(20.0, 1)))
    assert {"impact_share", "impact_speed_m_per_s", "speed_ratio"} <= set(baseline.names)
    setup = MonitorSetup(NAME, baseline, chart_limits(baseline, innovations, 1000.0), ())
    findings = list[Findings]()
    with ShadowBench(NAME, MAP, Company(tmp_path / "bag", setup)) as bench:
        live, recorder = bench.of(MonitorNode).live, bench.of(ShadowRecorder)
        take, heard = live.take, list[float]()

        def told(sample: SeenSample) -> list[Findings]:
            heard.append(sample.time_s)
            findings.extend(take(sample))
            return []

        live.take = told
        publishers = {
            "joints": bench.client.create_publisher(JointState, "/plant/joints", DATA),
            "impacts": bench.client.create_publisher(Vector3Stamped, "/plant/impacts", DATA),
        }
        bench.until(lambda: all(each.get_subscription_count() >= 1 for each in publishers.values()))
        for sent, (_, topic, message) in enumerate(messages_of(seen(5.0, 2)), 1):
            publishers[topic].publish(message)
            if sent % BURST == 0:
                bench.until(lambda sent=sent: min(len(heard), sum(recorder.received.values())) >= sent)
        bench.until(lambda: min(len(heard), sum(recorder.received.values())) >= sent)
        columns = [channel.column for channel in bench.shadow.observer.channels]
        estimate = bench.shadow.estimate
    assert columns == list(JOINTS.values())
    assert estimate is not None
    with opened_run(tmp_path / "bag") as reader:
        run = read_run(reader, MAP)
    offline = Monitor(setup)
    again = [offline.observe(v) for v in vectors_of({c.name: (c.times_s, c.values) for c in run.channels})]
    judged = [(found, other) for found, other in zip(findings, again, strict=False) if found.charts is not None]
    assert len(judged) > 40
    assert all(one.number == other.number for one, other in judged)
    assert all(np.array_equal(one.standard, other.standard) and one.charts == other.charts for one, other in judged)


def test_a_topic_of_samples_and_events_is_refused() -> None:
    channels = [
        {"source": {"topic": "both", "joint": "mass", "field": "position"}, "is": "linkage.mass.position"},
        {"source": {"topic": "both", "joint": "stop", "field": "velocity"}, "is": "event.impact.pre_velocity"},
    ]
    mixed = MeasurementMap.model_validate({"machine": NAME, "channels": channels})
    with pytest.raises(ConfigurationError, match="'/plant/both' would hold both samples and events"):
        followed_topics(mixed, "/plant")
