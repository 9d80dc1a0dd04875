# SPDX-License-Identifier: Apache-2.0
"""The samples of each step topic of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from catalogue import WITH_BODY
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mech_twin.messages.topics import full_name, step_topics
from mech_twin.nodes.roles.viewer_node import DECODERS
from mech_twin.recording.bag_reader import BagReader

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
        for topic in step_topics(name in WITH_BODY):
            rows = reader.messages(topics=[full_name(name, topic)])
            decode = DECODERS[topic.name]
            found[topic.name] = [decode(deserialize_message(row.raw, JointState)) for row in rows]
    return found
