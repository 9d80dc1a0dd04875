# SPDX-License-Identifier: Apache-2.0
"""What is read and written without the converter is what the converter reads and writes."""

import random
import struct

import hypothesis.strategies as st
import pytest
from catalogue import NAMES as MACHINES
from catalogue import built
from hypothesis import given
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages import cdr
from mech_twin.messages.cdr import CdrError, Header, Stamp, StepMessage, encoded, received_message
from mech_twin.messages.step_message import (
    REVISION,
    SOURCE,
    STEP,
    MessageError,
    Row,
    force,
    linkage,
    marked,
    motor,
    step_index,
)

NAMES = st.lists(st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9), max_size=6)
NUMBERS = st.floats(width=64)
MARKS = (Row(REVISION, 3.0, 17.0), Row(SOURCE, 2.0**47 + 1.0))


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


def told(message: JointState) -> StepMessage:
    """Return the message as the twin's own type."""
    stamp, columns = message.header.stamp, (message.position, message.velocity, message.effort)
    header = Header(Stamp(stamp.sec, stamp.nanosec), message.header.frame_id)
    return StepMessage(header, tuple(message.name), *map(tuple, columns))


def one_row(name: str) -> bytes:
    return encoded(StepMessage(Header(Stamp(0, 0)), (name,), (1.0,), (2.0,), (3.0,)))


@given(message=messages())
def test_what_is_written_is_what_the_converter_reads(message):
    raw = encoded(told(message))
    if message.name:  # of none the converter writes more than it reads
        assert len(raw) == len(serialize_message(message))
    read = deserialize_message(raw, JointState)
    assert content(read) == content(message)
    assert read.header.frame_id == message.header.frame_id


@given(first=messages(), second=messages())
def test_what_is_read_is_what_the_converter_wrote(first, second):
    for message in (first, second, first):
        assert content(received_message(bytes(serialize_message(message)))) == content(message)
        assert content(received_message(encoded(told(message)))) == content(message)


@pytest.mark.slow
@given(message=messages(), twice=st.integers(0, 2))
def test_columns_of_other_lengths_are_read_too(message, twice):
    column = ("position", "velocity", "effort")[twice]
    setattr(message, column, [*getattr(message, column), 1.0])
    for _ in range(2):
        received_message.cache_clear()
        assert content(received_message(bytes(serialize_message(message)))) == content(message)


def test_equally_long_messages_of_other_names_are_told_apart():
    for name in ("ab", "cd", "ab", "cd"):
        received_message.cache_clear()
        assert received_message(one_row(name)).name == (name,)


def test_ever_new_names_do_not_fill_the_memory():
    for number in range(2 * cdr.MOST_LAYOUTS + 10):
        assert received_message(one_row(f"joint {number:06}")).name == (f"joint {number:06}",)
    assert sum(map(len, cdr._layouts.values())) <= cdr.MOST_LAYOUTS


@pytest.mark.parametrize("raw", [b"", b"garbage", b"\x00\x01\x00\x00" + b"\xff" * 60])
def test_bytes_that_are_no_message_are_refused(raw):
    with pytest.raises(CdrError, match=f"{len(raw)} bytes"):
        received_message(raw)


@given(message=messages(), cut=st.integers(1, 40))
def test_a_learnt_shape_does_not_read_beyond_a_message_cut_short(message, cut):
    raw = encoded(told(message))
    received_message(raw)
    short = raw[:-cut]
    try:
        read = received_message(short)
    except CdrError:
        return
    assert content(read) == content(deserialize_message(short, JointState))


def test_damaged_bytes_are_read_as_the_converter_reads_them(capfd: pytest.CaptureFixture[str]) -> None:
    chance, outcomes = random.Random(3), set()
    sound = linkage.to_bytes(next(iter(frames(built("winding_drum"), 0.0))).linkage, MARKS)
    received_message(sound)
    for _ in range(3000):
        raw = bytearray(sound)
        for _ in range(chance.randrange(1, 4)):
            raw[chance.randrange(len(raw))] = chance.randrange(256)
        damaged = bytes(raw if chance.random() < 0.9 else raw[: chance.randrange(len(raw))])
        try:
            expected = content(deserialize_message(damaged, JointState))
        except RuntimeError:
            expected = None
        try:
            found = content(received_message(damaged))
        except CdrError:
            found = None
        assert found == expected
        outcomes.add(found is None)
    assert outcomes == {True, False}
    capfd.readouterr()  # the CDR library writes a line of its own for each


@pytest.mark.parametrize("name", MACHINES)
def test_stamp_step_and_source_are_those_of_the_sample(name: str) -> None:
    for frame in frames(built(name), 0.1):
        for codec, sample in ((linkage, frame.linkage), (motor, frame.motor), (force, frame.forces)):
            for marks, source in ((MARKS, MARKS[-1].position), ((), 0.0)):
                message = received_message(codec.to_bytes(sample, marks))
                stamp = message.header.stamp
                assert stamp.sec * 1_000_000_000 + stamp.nanosec == round(sample.time_s * 1e9)
                assert (step_index(message), marked(message, SOURCE)) == (sample.step, source)


@pytest.mark.parametrize("step", [0.5, float("nan"), float("inf"), 2.0**60])
def test_a_step_that_is_none_is_refused(step: float) -> None:
    message = JointState(name=["x", STEP, SOURCE], position=[0.0, step, 1.0], velocity=[0.0] * 3, effort=[0.0] * 3)
    with pytest.raises(MessageError, match="no step index"):
        step_index(message)


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
