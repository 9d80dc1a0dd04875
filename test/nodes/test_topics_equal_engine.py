# SPDX-License-Identifier: Apache-2.0
"""A run over topics is the one-process run, to the bit, through real DDS and a real recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from catalogue import NAMES, built
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.topics import full_name, step_topics
from mech_twin.nodes.composition import Outcome, run_in_process
from mech_twin.nodes.multi_process import run_processes
from mech_twin.nodes.observer_node import DECODERS
from mech_twin.nodes.options import RunOptions
from mech_twin.recording.bag_reader import BagReader

RUN_S = 0.4
PARTS = {
    "step/linkage": "linkage",
    "step/motor": "motor",
    "step/forces": "forces",
    "step/body": "body",
}


def recorded_samples(name: str, bag: Path) -> dict[str, list[Any]]:
    """Return the samples of each step topic of a recording."""
    found: dict[str, list[Any]] = {}
    with BagReader(bag) as reader:
        for topic in step_topics(built(name).body is not None):
            rows = reader.messages(topics=[full_name(name, topic)])
            decode = DECODERS[topic.name]
            found[topic.name] = [decode(deserialize_message(row.raw, JointState)) for row in rows]
    return found


def assert_equal_engine(name: str, bag: Path, duration_s: float) -> None:
    expected = list(frames(built(name), duration_s))
    for topic, samples in recorded_samples(name, bag).items():
        assert sorted({sample.step for sample in samples}) == list(range(len(expected))), topic
        for sample in samples:  # one that was asked again, when the machine stalled, stands there twice
            assert sample == getattr(expected[sample.step], PARTS[topic]), topic


@pytest.mark.parametrize("name", NAMES)
def test_topics_equal_engine_to_the_bit(name: str, ros_domain: int, tmp_path: Path) -> None:
    options = RunOptions(pace="max", duration_s=RUN_S, recorder=True, exclusive=False)
    outcome = run_in_process(name, built(name).parameters, options, tmp_path / "bag", None)
    assert_equal_engine(name, tmp_path / "bag", RUN_S)
    assert_every_message_recorded(outcome)


def assert_every_message_recorded(outcome: Outcome) -> None:
    for topic, number in outcome.recorded.items():
        assert outcome.sent.get(topic, 0) == number, topic


@pytest.mark.parametrize("name", ["mb10_breaker", "winding_drum"])
@pytest.mark.slow
def test_nodes_in_processes_of_their_own_equal_engine_to_the_bit(name: str, ros_domain: int, tmp_path: Path) -> None:
    options = RunOptions(pace="max", duration_s=RUN_S, recorder=True, exclusive=False)
    run_processes(name, built(name).parameters, options, tmp_path / "bag", None)
    assert_equal_engine(name, tmp_path / "bag", RUN_S)
