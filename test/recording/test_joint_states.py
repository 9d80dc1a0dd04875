# SPDX-License-Identifier: Apache-2.0
"""Joint states are decoded as by the decoder of their definition, whatever came before them on their topic."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as some
from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from mech_twin.recording import measured_topics, message_decoder
from mech_twin.recording.bag_contents import BagMessage, TopicInfo
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_writer import BagWriter
from mech_twin.recording.errors import BagError, DecodeError
from mech_twin.recording.message_decoder import JOINT_STATE, MessageDecoder
from mech_twin.recording.schemas import message_schema

TEXT = message_schema(JOINT_STATE).definition
ENCODE = serialize_dynamic(JOINT_STATE, TEXT)[JOINT_STATE]
names = some.lists(some.text(max_size=5), max_size=4)
numbers = some.lists(some.floats() | some.sampled_from([math.nan, -0.0]), max_size=4)
messages = some.builds(
    lambda sec, nanosec, frame, name, position, velocity, effort: SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id=frame),
        name=name, position=position, velocity=velocity, effort=effort,
    ),
    some.integers(-(2**31), 2**31 - 1), some.integers(0, 2**32 - 1), some.text(max_size=5), names,
    numbers, numbers, numbers,
)  # fmt: skip


def decoder(text: str = TEXT) -> MessageDecoder:
    return MessageDecoder({"/j": TopicInfo("/j", JOINT_STATE, 1, "", "", text, "ros2msg", "cdr")})


def message(raw: bytes) -> BagMessage:
    return BagMessage("/j", JOINT_STATE, 0, 0, raw)


def content(found: Any) -> tuple[object, ...]:
    """Return what a message says, numbers as bits: not-a-number is equal to itself."""
    header, columns = found.header, (found.position, found.velocity, found.effort)
    stamp = header.stamp.sec, header.stamp.nanosec, header.frame_id
    return (*stamp, tuple(found.name), *(struct.pack(f"{len(column)}d", *column) for column in columns))


def later(like: SimpleNamespace, by: float) -> SimpleNamespace:
    """Return a message with the same names and as many other numbers, a second later."""
    stamp = SimpleNamespace(sec=like.header.stamp.sec // 2, nanosec=1)
    moved = {name: [x + by for x in getattr(like, name)] for name in ("position", "velocity", "effort")}
    header = SimpleNamespace(stamp=stamp, frame_id=like.header.frame_id)
    return SimpleNamespace(header=header, name=like.name, **moved)


@given(some.lists(messages, min_size=1, max_size=6), some.binary(max_size=8))
def test_each_message_is_that_of_its_definition(sent: list[SimpleNamespace], left_behind: bytes) -> None:
    plain, ours = generate_dynamic(JOINT_STATE, TEXT)[JOINT_STATE], decoder()
    for raw in map(ENCODE, [m for one in sent for m in (one, later(one, 1.0), one)]):
        expected, found = plain(raw), ours.decode(message(raw + left_behind))
        assert content(found) == content(expected)


@given(messages, some.data())
def test_changed_bytes_are_decoded_or_refused_as_by_the_definition(sent: SimpleNamespace, data: Any) -> None:
    plain, ours, raw = generate_dynamic(JOINT_STATE, TEXT)[JOINT_STATE], decoder(), bytearray(ENCODE(sent))
    ours.decode(message(bytes(raw)))
    raw[data.draw(some.integers(0, len(raw) - 1))] ^= 1 << data.draw(some.integers(0, 7))
    try:
        expected = content(plain(bytes(raw)))
    except (struct.error, ValueError, IndexError, OverflowError, MemoryError, UnicodeDecodeError):
        with pytest.raises(DecodeError):
            ours.decode(message(bytes(raw)))
    else:
        assert content(ours.decode(message(bytes(raw)))) == expected


def test_numbers_of_known_names_are_read_by_their_places(monkeypatch: pytest.MonkeyPatch) -> None:
    stamp = SimpleNamespace(sec=3, nanosec=4)
    first = SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id="f"),
        name=["a", "bc"],
        position=[1.0, 2.0],
        velocity=[],
        effort=[3.0],
    )
    ours, calls = decoder(), []
    build = message_decoder._function
    monkeypatch.setattr(message_decoder, "_function", lambda topic: lambda raw: calls.append(raw) or build(topic)(raw))
    for shift in range(5):
        found = ours.decode(message(ENCODE(later(first, float(shift))) + b"left"))
        assert (*found.name, *found.position, *found.effort) == ("a", "bc", 1.0 + shift, 2.0 + shift, 3.0 + shift)
    assert len(calls) == 1


def test_a_definition_of_another_order_is_obeyed() -> None:
    turned = TEXT.replace("float64[] position", "float64[] kept").replace("float64[] velocity", "float64[] position")
    turned = turned.replace("float64[] kept", "float64[] velocity")
    ours = decoder(turned)
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id="")
    like = SimpleNamespace(header=header, name=[], position=[1.0], velocity=[2.0], effort=[])
    for shift in (0.0, 1.0, 2.0):
        found = ours.decode(message(ENCODE(later(like, shift))))
        assert (found.velocity, found.position) == ([1.0 + shift], [2.0 + shift])


@pytest.mark.parametrize(
    ("recorded", "found"),
    [
        (("/plant/motor/joint_states", "/plant/joint_states", "/plant/forces/joint_states"), "/plant/joint_states"),
        (("/hall/plant_2/joint_states",), "/hall/plant_2/joint_states"),
        (("/plant/joint_states", "/press/twin/estimated/joint_states"), "/plant/joint_states"),
        (("/a/motor/joint_states", "/a/forces/joint_states"), "may be any of"),
        (("/a/joint_states", "/b/joint_states"), "may be any of"),
        (("/a/joint_states", "/ab/joint_states"), "may be any of"),
    ],
)
def test_a_relative_topic_is_that_of_the_namespace_above_all_others(recorded: tuple[str, ...], found: str) -> None:
    topics = {name: TopicInfo(name, JOINT_STATE, 1, "", "", TEXT, "ros2msg", "cdr") for name in recorded}
    reader = SimpleNamespace(path=Path("bag"), topics=topics)
    measured = measured_topics.MeasuredTopics(reader)  # type: ignore[arg-type]
    if found in topics:
        assert measured._topic("joint_states") is topics[found]
        return
    with pytest.raises(BagError, match=found):
        measured._topic("joint_states")


def test_a_message_whose_array_ends_before_a_number_is_no_sample_of_it(tmp_path: Path) -> None:
    kind = "std_msgs/msg/Float64MultiArray"
    with BagWriter(tmp_path / "bag", configuration="") as writer:
        writer.add_topic("/a", kind)
        for number, length in enumerate((0, 2, 1, 2)):
            raw = bytes(serialize_message(Float64MultiArray(data=[float(number)] * length)))
            writer.write("/a", raw, number * 10**9, 0)
    with BagReader(tmp_path / "bag") as reader:
        topics = measured_topics.MeasuredTopics(reader)
        wanted = [measured_topics.TopicField("/a", None, f"data.{place}") for place in range(3)]
        first, second = topics.blocks(wanted[:2], by_header=True)
        assert (first.values.tolist(), second.times_s.tolist()) == ([1.0, 2.0, 3.0], [1.0, 3.0])
        with pytest.raises(BagError, match=r"topic '/a' holds no message with a 'data\.2'"):
            list(topics.blocks(wanted[2:], by_header=True))


@pytest.mark.parametrize("chunk_bytes", [300, 100_000])
def test_stamps_stand_in_the_order_of_the_file_whatever_was_done_to_the_log_clock(
    chunk_bytes: int, tmp_path: Path
) -> None:
    with BagWriter(tmp_path / "bag", configuration="", chunk_bytes=chunk_bytes) as writer:
        writer.add_topic("/j", JOINT_STATE)
        for number in range(20):
            sent = JointState(name=["crank"], position=[float(number)], effort=[0.0])
            sent.header.stamp.sec = number
            writer.write("/j", bytes(serialize_message(sent)), (number - (15 if number > 9 else 0) + 20) * 10**9, 0)
    wanted = measured_topics.TopicField("/j", "crank", "position")
    with BagReader(tmp_path / "bag") as reader:
        topics = measured_topics.MeasuredTopics(reader)
        (by_header,) = topics.blocks([wanted], by_header=True)
        (by_log,) = topics.blocks([wanted], by_header=False)
    assert by_header.times_s.round(9).tolist() == by_header.values.tolist() == list(range(20))
    assert by_log.times_s.tolist() == sorted(by_log.times_s.tolist())


@pytest.mark.parametrize("begins", [[], ["wheel"]])
def test_every_joint_that_a_topic_tells_within_two_seconds_is_offered(begins: list[str], tmp_path: Path) -> None:
    told = [begins, ["wheel"], ["ram"], ["wheel"], ["ram", "late"]]  # two drivers on one topic, the first starts empty
    with BagWriter(tmp_path / "bag", configuration="") as writer:
        writer.add_topic("/joint_states", JOINT_STATE)
        for number, joints in enumerate(told):
            sent = JointState(name=joints, position=[1.0] * len(joints), effort=[1.0] * len(joints))
            writer.write("/joint_states", bytes(serialize_message(sent)), number * 600_000_000, 0)
    with BagReader(tmp_path / "bag") as reader:
        offered = measured_topics.MeasuredTopics(reader).fields()
    expected = [(joint, field) for joint in ("wheel", "ram") for field in ("position", "effort")]
    assert [(each.joint, each.field) for each in offered] == expected  # each once
