# SPDX-License-Identifier: Apache-2.0
"""The head that a recorder reads of a step message is that of the decoded message, for any bytes."""

from __future__ import annotations

import random

import pytest
from catalogue import NAMES, built
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.joint_state_cdr import CdrError, Decoder
from mech_twin.messages.step_codec import force, linkage, motor
from mech_twin.messages.step_head import StepHead, StepHeadReader
from mech_twin.messages.step_message import SOURCE, STEP, MessageError, Row, revision_row, source, step_index

MARKS = (revision_row(3, 17.0), Row(SOURCE, 2.0**47 + 1.0))


def decoded_head(decode: Decoder, raw: bytes) -> StepHead | None:
    """Return the head of a message by decoding all of it; None if it is none."""
    try:
        message = decode(raw)
        stamp = message.header.stamp
        return StepHead(stamp.sec * 1_000_000_000 + stamp.nanosec, step_index(message), source(message))
    except (CdrError, MessageError):
        return None


def read_head(read: StepHeadReader, raw: bytes) -> StepHead | None:
    try:
        return read(raw)
    except (CdrError, MessageError):
        return None


@pytest.mark.parametrize("name", NAMES)
def test_the_head_is_that_of_the_message(name: str) -> None:
    read, signed = StepHeadReader(), StepHeadReader()
    for frame in frames(built(name), 0.1):
        for codec, sample in ((linkage, frame.linkage), (motor, frame.motor), (force, frame.forces)):
            stamp_ns = round(sample.time_s * 1e9)
            assert signed(codec.to_bytes(sample, MARKS)) == (stamp_ns, sample.step, MARKS[-1].position)
            assert read(serialize_message(codec.to_message(sample))) == (stamp_ns, sample.step, 0.0)


def test_damaged_bytes_are_read_as_the_decoder_reads_them(capfd: pytest.CaptureFixture[str]) -> None:
    chance = random.Random(3)
    sample = next(iter(frames(built("winding_drum"), 0.0))).linkage
    sound = linkage.to_bytes(sample, MARKS)
    read, decode = StepHeadReader(), Decoder()
    assert read(sound) == decoded_head(decode, sound)
    outcomes = set()
    for _ in range(3000):
        raw = bytearray(sound)
        for _ in range(chance.randrange(1, 4)):
            raw[chance.randrange(len(raw))] = chance.randrange(256)
        damaged = bytes(raw if chance.random() < 0.9 else raw[: chance.randrange(len(raw))])
        head = read_head(read, damaged)
        assert repr(head) == repr(decoded_head(decode, damaged))  # nan is not nan
        outcomes.add(head is None)
    assert outcomes == {True, False}
    capfd.readouterr()  # the CDR library writes a line of its own for each


@pytest.mark.parametrize("step", [0.5, float("nan"), float("inf"), 2.0**60])
def test_a_step_that_is_none_is_refused_on_both_ways(step: float) -> None:
    message = JointState(name=["x", STEP, SOURCE], position=[0.0, step, 1.0], velocity=[0.0] * 3, effort=[0.0] * 3)
    read = StepHeadReader()
    for _ in range(2):  # the second time by the places known from the first
        with pytest.raises(MessageError, match="no step index"):
            read(bytes(serialize_message(message)))
