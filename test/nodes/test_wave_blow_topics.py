# SPDX-License-Identifier: Apache-2.0
"""Breaker and page with a blow as a wave: over topics, in a recording and in its replay as in one process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from recordings import entries_of
from replay_bench import ReplayBench
from sensor_msgs.msg import JointState
from step_samples import assert_equal_engine
from trajectory_msgs.msg import JointTrajectory

from mech_twin.capabilities.blow_gauge import BlowGauge
from mech_twin.engine.run import frames
from mech_twin.messages.impacts import curve_message, numbers_bytes
from mech_twin.messages.topics import BLOW_GAUGE, BLOW_WAVE, full_name
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.run.composition import run_in_process
from mech_twin.parameters.load import machine
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.frame_recorder import FrameRecorder
from mech_twin.roles import own_name
from mech_twin.samples import Frame

NAME = "mb10_breaker"
CURVES = {"tool.model": "wave", "tool.wave.gauge_curve": True}
HAMMER = Path(__file__).parents[2] / "config" / "pages" / "rock_hammer.yaml"
CASES = [(NAME, CURVES), (str(HAMMER), {"contacts.blow.rod.gauge_curve": True})]


def blow_topics(space: str) -> list[str]:
    """Return the names of the topics of blows."""
    return [full_name(space, topic) for topic in (BLOW_GAUGE, BLOW_WAVE)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "settings"), CASES, ids=["breaker", "page"])
def test_topics_equal_engine_to_the_bit(ros_domain: int, tmp_path: Path, name: str, settings: dict[str, Any]) -> None:
    built = machine(name, None, settings)
    space = own_name(built.name, built.parameters)
    options = RunOptions(pace="max", duration_s=0.4, recorder=True, exclusive=False)
    run_in_process(built.name, built.parameters, options, tmp_path / "bag", None)
    assert_equal_engine(tmp_path / "bag", built, 0.4)
    assert built.gauge is not None
    told = blows(list(frames(built, 0.4)), built.gauge)
    assert told[0]
    assert recorded_blows(tmp_path / "bag", space) == told
    with ReplayBench(tmp_path / "bag") as bench:
        bench.to_the_end()
        for topic_name in blow_topics(space):
            entries = [e.raw for e in entries_of(tmp_path / "bag") if e.topic == topic_name]
            assert bench.of(topic_name) == entries


def blows(expected: list[Frame], gauge: BlowGauge) -> list[list[Any]]:
    """Return the messages of each topic of blows, decoded."""
    events = [event for frame in expected for event in frame.linkage.events if gauge.has_reading(event)]
    numbers = [deserialize_message(numbers_bytes(gauge, event), JointState) for event in events]
    return [numbers, [curve_message(gauge, event) for event in events]]


def recorded_blows(bag: Path, space: str = NAME) -> list[list[Any]]:
    with BagReader(bag) as reader:
        rows = [list(reader.messages(topics=[name])) for name in blow_topics(space)]
    kinds = (JointState, JointTrajectory)
    return [[deserialize_message(row.raw, kind) for row in each] for each, kind in zip(rows, kinds, strict=True)]


def test_a_recording_without_nodes_holds_the_same_blows(tmp_path: Path) -> None:
    built = machine(NAME, None, CURVES)
    recorder = FrameRecorder(built, tmp_path / "bag", "")
    expected = list(frames(built, 0.4))
    for frame in expected:
        recorder.write(frame)
    recorder.close()
    assert built.gauge is not None
    assert recorded_blows(tmp_path / "bag") == blows(expected, built.gauge)


def test_the_curve_of_a_blow_holds_the_numbers_of_its_gauge() -> None:
    built = machine(NAME, None, CURVES)
    assert built.gauge is not None
    event = next(e for frame in frames(built, 0.4) for e in frame.linkage.events if built.gauge.has_reading(e))
    curve = built.gauge.curve(event)
    assert curve.force_n.max() == built.gauge.number(event, "peak_force")
    assert curve.strain.max() == built.gauge.number(event, "peak_strain")
    assert -curve.force_n.min() == built.gauge.number(event, "peak_tension")
    force = curve.force_n.max() / curve.strain.max()
    assert force == pytest.approx(2.1e11 * 0.25 * np.pi * 0.06**2, rel=1e-9)  # E A
