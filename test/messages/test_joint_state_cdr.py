# SPDX-License-Identifier: Apache-2.0
"""What is read and written without the converter is what the converter reads and writes."""

import struct

import hypothesis.strategies as st
import pytest
from catalogue import built
from hypothesis import given
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.joint_state_cdr import MOST_LAYOUTS, CdrError, Decoder, encoded
from mech_twin.messages.step_codec import linkage
from mech_twin.messages.step_message import MessageError

NAMES = st.lists(st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9), max_size=6)
NUMBERS = st.floats(width=64)


@st.composite
def messages(draw: st.DrawFn) -> JointState:
    names = draw(NAMES)
    columns = [draw(st.lists(NUMBERS, min_size=len(names), max_size=len(names))) for _ in range(3)]
    message = JointState(name=names, position=columns[0], velocity=columns[1], effort=columns[2])
    message.header.frame_id = draw(st.sampled_from(["", "base", "ü"]))
    message.header.stamp.sec = draw(st.integers(-(2**31), 2**31 - 1))
    message.header.stamp.nanosec = draw(st.integers(0, 2**32 - 1))
    return message


def content(message):
    """Return what a message says, numbers as bits: not-a-number is equal to itself."""
    columns = (message.position, message.velocity, message.effort)
    stamp = message.header.stamp
    return (stamp.sec, stamp.nanosec, tuple(message.name), *(struct.pack(f"{len(c)}d", *c) for c in columns))


@given(message=messages())
def test_what_is_written_is_what_the_converter_reads(message):
    read = deserialize_message(encoded(message), JointState)
    assert content(read) == content(message)
    assert read.header.frame_id == message.header.frame_id


@given(first=messages(), second=messages())
def test_what_is_read_is_what_the_converter_wrote(first, second):
    decode = Decoder()
    for message in (first, second, first):
        assert content(decode(serialize_message(message))) == content(message)
        assert content(decode(encoded(message))) == content(message)


@given(message=messages(), twice=st.integers(0, 2))
def test_columns_of_other_lengths_are_read_too(message, twice):
    column = ("position", "velocity", "effort")[twice]
    setattr(message, column, [*getattr(message, column), 1.0])
    decode = Decoder()
    for _ in range(2):
        assert content(decode(encoded(message))) == content(message)


def test_the_same_message_is_the_same_bytes():
    message = JointState(name=["a", "bcd"], position=[1.0, 2.0], velocity=[3.0, 4.0], effort=[5.0, 6.0])
    assert encoded(message) == encoded(message)
    assert len(encoded(message)) == len(serialize_message(message))


def test_equally_long_messages_of_other_names_are_told_apart():
    decode = Decoder()
    for name in ("ab", "cd", "ab", "cd"):
        raw = encoded(JointState(name=[name], position=[1.0], velocity=[2.0], effort=[3.0]))
        assert decode(raw).name == (name,)


def test_ever_new_names_do_not_fill_the_memory():
    decode = Decoder()
    for number in range(2 * MOST_LAYOUTS + 10):
        raw = encoded(JointState(name=[f"joint {number:06}"], position=[1.0], velocity=[2.0], effort=[3.0]))
        assert decode(raw).name == (f"joint {number:06}",)
    assert decode.layout_count <= MOST_LAYOUTS


@pytest.mark.parametrize("raw", [b"", b"garbage", b"\x00\x01\x00\x00" + b"\xff" * 60])
def test_bytes_that_are_no_message_are_refused(raw):
    with pytest.raises(CdrError, match=f"{len(raw)} bytes"):
        Decoder()(raw)


@given(message=messages(), cut=st.integers(1, 40))
def test_a_learnt_shape_does_not_read_beyond_a_message_cut_short(message, cut):
    decode = Decoder()
    raw = encoded(message)
    decode(raw)
    short = raw[:-cut]
    try:
        read = decode(short)
    except CdrError:
        return
    assert content(read) == content(deserialize_message(short, JointState))


def test_bytes_heard_by_several_listeners_are_one_sample_to_all() -> None:
    sample = next(iter(frames(built("winding_drum"), 0.0))).linkage
    raw = linkage.to_bytes(sample)
    first = linkage.received(raw, 0.001, sample.joints)
    assert first == sample
    assert linkage.received(bytes(bytearray(raw)), 0.001, sample.joints) is first
    assert linkage.received(raw, 0.001, sample.joints[::-1]).joints == sample.joints[::-1]
    for _ in range(2):  # what is wrong stays wrong
        with pytest.raises(CdrError):
            linkage.received(raw[:20], 0.001, sample.joints)
        with pytest.raises(MessageError, match="missing"):
            linkage.received(raw, 0.001, ("somebody",))
