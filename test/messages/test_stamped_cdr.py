# SPDX-License-Identifier: Apache-2.0
"""What is written straight into bytes is what the middleware's converter reads and writes."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import TransformStamped, Vector3Stamped, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock

from mech_twin.messages import body, force, impact
from mech_twin.messages.joint_state_cdr import stamp_of
from mech_twin.messages.stamped_cdr import clock_bytes, transform_bytes
from mech_twin.samples import Event, Wrench

number = st.floats(allow_nan=False)
time = st.floats(0.0, 1e6)
frame = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)


def read(raw: bytes, kind: Any) -> Any:
    message = deserialize_message(raw, kind)
    assert len(bytes(serialize_message(message))) == len(raw)
    return message


@given(time, frame, st.builds(Wrench, number, number, number))
def test_a_wrench_reads_as_the_message(time_s: float, name: str, wrench: Wrench) -> None:
    assert read(force.wrench_bytes(time_s, name, wrench), WrenchStamped) == force.wrench_message(time_s, name, wrench)


@given(time, frame, number)
def test_a_pressing_force_reads_as_the_message(time_s: float, name: str, force_n: float) -> None:
    found = read(body.pressing_force_bytes(time_s, name, force_n), WrenchStamped)
    assert found == body.pressing_force_message(time_s, name, force_n)


@given(time, frame, number, number, number)
def test_an_impact_reads_as_the_message(time_s: float, name: str, before: float, after: float, impulse: float) -> None:
    event = Event(time_s, "blow", name, before, after, impulse)
    assert read(impact.to_bytes(event), Vector3Stamped) == impact.to_message(event)


@given(time)
def test_a_clock_reads_as_its_time(time_s: float) -> None:
    stamp = read(clock_bytes(time_s), Clock).clock
    assert (stamp.sec, stamp.nanosec) == tuple(stamp_of(time_s))


@given(time, frame, frame, st.tuples(*[number] * 7))
def test_a_transform_reads_as_its_frames_and_numbers(
    time_s: float, parent: str, child: str, numbers: tuple[float, ...]
) -> None:
    found = read(transform_bytes(time_s, parent, child, numbers), TransformStamped)
    at, turn = found.transform.translation, found.transform.rotation
    assert (found.header.frame_id, found.child_frame_id) == (parent, child)
    assert (at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w) == numbers
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == tuple(stamp_of(time_s))
