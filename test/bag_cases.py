# SPDX-License-Identifier: Apache-2.0
"""Bags for the tests of the recording room, and the messages in them."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from mech_twin.recording.bag_writer import BagWriter
from mech_twin.recording.schemas import offered_qos

JOINTS = "/twin/joint_states"
FORCES = "/twin/forces/pin"
NOTES = "/twin/notes"
DESCRIPTION = "/twin/description"
CONFIGURATION = "crank_m: 0.05\nnote: 'Größe'\n"
TYPES = {
    JOINTS: "sensor_msgs/msg/JointState",
    FORCES: "geometry_msgs/msg/WrenchStamped",
    NOTES: "std_msgs/msg/String",
}


def string_cdr(text: str) -> bytes:
    """Return the little-endian CDR encoding of a std_msgs/msg/String."""
    data = text.encode() + b"\0"
    return b"\x00\x01\x00\x00" + struct.pack("<I", len(data)) + data


def joint_state(number: int) -> bytes:
    """Return the number-th joint state, encoded."""
    message = JointState(
        name=["crank", "rocker"], position=[number * 0.1, -1.0], velocity=[1.5, number / 3.0], effort=[0.25, 0.0]
    )
    message.header.stamp.sec = number
    message.header.frame_id = "frame"
    return bytes(serialize_message(message))


def wrench(number: int) -> bytes:
    """Return the number-th wrench, encoded."""
    message = WrenchStamped()
    message.wrench.force.x = float(number)
    return bytes(serialize_message(message))


def raw_of(topic: str, number: int) -> bytes:
    """Return the number-th message of a topic, encoded."""
    if topic == JOINTS:
        return joint_state(number)
    return wrench(number) if topic == FORCES else string_cdr(f"note {number}")


def written(directory: Path, steps: int, **options: Any) -> Path:
    """Write steps of two fast topics, 1 ms apart, and a note every tenth; return the bag."""
    with BagWriter(directory, configuration=CONFIGURATION, **options) as writer:
        writer.add_topic(DESCRIPTION, TYPES[NOTES], offered_qos(durability="transient_local", depth=1))
        for topic, type_name in TYPES.items():
            writer.add_topic(topic, type_name)
        if steps:
            writer.write(DESCRIPTION, string_cdr(CONFIGURATION), 0, 0, latched=True)
        for step in range(steps):
            time_ns = 1_000_000 * step
            for topic in TYPES:
                if topic != NOTES or step % 10 == 0:
                    writer.write(topic, raw_of(topic, step), time_ns, time_ns)
    return directory


def counts(steps: int) -> dict[str, int]:
    """Return how many messages `written` puts on each topic."""
    return {DESCRIPTION: min(steps, 1), JOINTS: steps, FORCES: steps, NOTES: (steps + 9) // 10}
