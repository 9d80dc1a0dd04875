# SPDX-License-Identifier: Apache-2.0
"""What is written straight into bytes is what the middleware's converter reads and writes."""

from __future__ import annotations

from typing import Any

import pytest
from geometry_msgs.msg import Point, Pose, Quaternion, TransformStamped, Vector3, Vector3Stamped, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from mech_twin.messages import impacts, scene
from mech_twin.messages.cdr import Stamp, stamp_of, stamped_bytes, wrench_bytes
from mech_twin.messages.step_message import set_stamp
from mech_twin.samples import Drawing, Event, Shape

number = st.floats(allow_nan=False)
time = st.floats(0.0, 1e6)
frame = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)


places = st.lists(st.tuples(number, number), min_size=1, max_size=4).map(tuple)
colour = st.tuples(*[st.integers(0, 255)] * 3)
shape = st.builds(Shape, frame, st.sampled_from([*scene.TYPES]), places, colour, number, frame)


def marker(time_s: float, name: str, index: int, shape: Shape) -> Marker:
    """Return a shape as the middleware's own message."""
    x, y = shape.points_m[0] if shape.kind == "text" else (0.0, 0.0)
    red, green, blue = (part / 255.0 for part in shape.colour)
    made = Marker(header=Header(frame_id=name), ns=shape.name, id=index, type=scene.TYPES[shape.kind], text=shape.text)
    set_stamp(made.header, time_s)
    made.pose = Pose(position=Point(x=x, y=y), orientation=Quaternion(w=1.0))
    made.scale = Vector3(x=shape.width_m, y=shape.width_m, z=shape.width_m)
    made.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
    made.points = [] if shape.kind == "text" else [Point(x=x, y=y) for x, y in shape.points_m]
    return made


def read(raw: bytes, kind: Any) -> Any:
    message = deserialize_message(raw, kind)
    assert len(bytes(serialize_message(message))) == len(raw)
    return message


@pytest.mark.slow
@given(time, frame, st.tuples(*[number] * 3))
def test_a_wrench_reads_as_its_frame_and_numbers(time_s: float, name: str, numbers: tuple[float, ...]) -> None:
    expected = WrenchStamped()
    set_stamp(expected.header, time_s)
    expected.header.frame_id = name
    expected.wrench.force.x, expected.wrench.force.y, expected.wrench.torque.z = numbers
    assert read(wrench_bytes(time_s, name, *numbers), WrenchStamped) == expected


@given(time, frame, number, number, number)
def test_an_impact_reads_as_the_message(time_s: float, name: str, before: float, after: float, impulse: float) -> None:
    event = Event(time_s, "blow", name, before, after, impulse)
    expected = Vector3Stamped(vector=Vector3(x=before, y=after, z=impulse))
    set_stamp(expected.header, time_s)
    expected.header.frame_id = f"{name}/blow"
    assert read(impacts.to_bytes(event), Vector3Stamped) == expected
    expected.header.stamp.sec, expected.header.stamp.nanosec = stamp = Stamp(7, 1)
    assert read(impacts.to_bytes(event, stamp), Vector3Stamped) == expected


@given(time)
def test_a_clock_reads_as_its_time(time_s: float) -> None:
    stamp = read(stamped_bytes(time_s), Clock).clock
    assert (stamp.sec, stamp.nanosec) == tuple(stamp_of(time_s))


@given(time, frame, frame, st.tuples(*[number] * 7))
def test_a_transform_reads_as_its_frames_and_numbers(
    time_s: float, parent: str, child: str, numbers: tuple[float, ...]
) -> None:
    found = read(stamped_bytes(time_s, parent, child, numbers=numbers), TransformStamped)
    at, turn = found.transform.translation, found.transform.rotation
    assert (found.header.frame_id, found.child_frame_id) == (parent, child)
    assert (at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w) == numbers
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == tuple(stamp_of(time_s))


@pytest.mark.slow
@given(time, frame, st.lists(shape, max_size=5).map(tuple))
def test_a_drawing_reads_as_its_markers(time_s: float, name: str, shapes: tuple[Shape, ...]) -> None:
    found = read(scene.to_bytes(Drawing(0, time_s, shapes), name), MarkerArray)
    expected = MarkerArray(markers=[marker(time_s, name, index, each) for index, each in enumerate(shapes)])
    assert found == read(bytes(serialize_message(expected)), MarkerArray)


def test_a_frame_has_the_namespace_of_its_run_and_no_leading_slash() -> None:
    found = [scene.frame_id(space, "shaft") for space in ("/", "/drum", "/hall/drum")]
    assert found == ["shaft", "drum/shaft", "hall/drum/shaft"]
