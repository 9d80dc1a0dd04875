# SPDX-License-Identifier: Apache-2.0
"""A simulated recording carries what a viewer of robots needs, as a run's does: frames and robot description."""

from __future__ import annotations

from catalogue import built
from geometry_msgs.msg import TransformStamped
from rclpy.serialization import deserialize_message
from recordings import decoded_messages, simulated_bag

from mech_twin.capabilities.mechanism import urdf
from mech_twin.messages.scene import transforms

CRANK, DURATION_S = "vibration_crank", 0.05


def test_a_simulated_recording_carries_frames_and_robot_description(tmp_path):
    bag, mechanism = tmp_path / "bag", built(CRANK).mechanism
    simulated_bag(CRANK, DURATION_S, bag)
    (described,) = decoded_messages(bag, f"/{CRANK}/robot_description")
    assert described.data == urdf(CRANK, mechanism)
    found = decoded_messages(bag, f"/{CRANK}/frames")
    steps = {stamp_of(message): message for message in decoded_messages(bag, f"/{CRANK}/joint_states")}
    expected = []
    for stamp in dict.fromkeys(map(stamp_of, found)):
        positions = dict(zip(steps[stamp].name, steps[stamp].position, strict=True))
        made = transforms(mechanism, positions, stamp[0] + 1e-9 * stamp[1], CRANK)
        expected += [deserialize_message(raw, TransformStamped) for raw in made]
    assert len({stamp_of(message) for message in found}) > 4
    assert found == expected


def stamp_of(message) -> tuple[int, int]:
    """Return the stamp of a message."""
    return message.header.stamp.sec, message.header.stamp.nanosec
