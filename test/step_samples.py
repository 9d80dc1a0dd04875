# SPDX-License-Identifier: Apache-2.0
"""A recording of a run over topics: the samples of each step topic, compared with the engine's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from catalogue import WITH_BODY
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.topics import full_name, step_topics
from mech_twin.nodes.roles.viewer_node import DECODERS
from mech_twin.recording.bag_reader import BagReader
from mech_twin.roles import Machine, own_name
from mech_twin.samples import Frame

PARTS = {f"step/{part}": part for part in Frame._fields}


def recorded_samples(name: str, bag: Path) -> dict[str, list[Any]]:
    """Return the samples of each step topic of a recording."""
    found: dict[str, list[Any]] = {}
    with BagReader(bag) as reader:
        for topic in step_topics(name in WITH_BODY):
            rows = reader.messages(topics=[full_name(name, topic)])
            decode = DECODERS[topic.name]
            found[topic.name] = [decode(deserialize_message(row.raw, JointState)) for row in rows]
    return found


def assert_equal_engine(bag: Path, machine: Machine, duration_s: float) -> None:
    """Compare every sample of a recording with the engine's, bit by bit; no step is missing."""
    expected = list(frames(machine, duration_s))
    for topic, samples in recorded_samples(own_name(machine.name, machine.parameters), bag).items():
        assert sorted({sample.step for sample in samples}) == list(range(len(expected))), topic
        for sample in samples:  # one that was asked again, when the machine stalled, stands there twice
            assert sample == getattr(expected[sample.step], PARTS[topic]), topic
