# SPDX-License-Identifier: Apache-2.0
"""Decodes CDR messages of any type by the definitions stored in their bag, without ROS."""

import struct
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from mech_twin.messages.cdr import Header, known_message, learn_layout
from mech_twin.recording.bag_contents import BagMessage, TopicInfo
from mech_twin.recording.errors import DecodeError


class JointColumns(NamedTuple):
    """A joint state that was read by the places of its numbers."""

    header: Header
    name: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


JOINT_STATE = "sensor_msgs/msg/JointState"
_JOINT_STATE_FIELDS = ["std_msgs/Header header", "string[] name", *(f"float64[] {x}" for x in JointColumns._fields[2:])]
_SEPARATOR = "=" * 80


class MessageDecoder:
    """Decodes the messages of one bag."""

    def __init__(self, topics: Mapping[str, TopicInfo]) -> None:
        self._topics = topics
        self._functions: dict[str, Callable[[bytes], Any]] = {}

    def decode(self, message: BagMessage) -> Any:
        """Return the message as an object with the fields of its type.

        Raises
        ------
        DecodeError
            The bytes are not of that type, or the bag's definition of it cannot be used.
        """
        function = self._functions.get(message.topic)
        if function is None:
            topic = self._topics[message.topic]
            function = _function(topic)
            if topic.type_name == JOINT_STATE and fields_of(topic) == _JOINT_STATE_FIELDS:
                function = partial(_joint_state, function)
            self._functions[message.topic] = function
        try:
            return function(message.raw)
        except (
            McapError,
            struct.error,
            ValueError,
            IndexError,
            TypeError,
            KeyError,
            OverflowError,
            MemoryError,
        ) as error:
            raise DecodeError(f"topic {message.topic}: not a {message.type_name} ({error})") from error


def _function(topic: TopicInfo) -> Callable[[bytes], Any]:
    schema = Schema(id=1, data=topic.definition.encode(), encoding=topic.schema_encoding, name=topic.type_name)
    for part in topic.definition.split(_SEPARATOR)[1:]:
        if not any(_is_field(line) for line in part.splitlines()[2:]):
            raise DecodeError(
                f"topic {topic.topic}: its definition nests a type without fields, whose decoding is unbounded"
            )
    try:
        function = DecoderFactory().decoder_for(topic.message_encoding, schema)
    except Exception as error:  # the definition parser raises various exceptions on malformed text
        raise DecodeError(f"topic {topic.topic}: its definition of {topic.type_name} cannot be read") from error
    if function is None:
        raise DecodeError(
            f"topic {topic.topic}: encoding '{topic.message_encoding}' with schema '{topic.schema_encoding}' is not "
            "decoded here, only cdr with ros2msg"
        )
    return function


def fields_of(topic: TopicInfo) -> list[str]:
    """Return type and name of each field of a topic's messages."""
    lines = topic.definition.partition(_SEPARATOR)[0].splitlines()
    return [" ".join(line.partition("#")[0].split()) for line in lines if _is_field(line)]


def _is_field(line: str) -> bool:
    text = line.partition("#")[0].strip()
    return bool(text) and "=" not in text.replace("<=", "")


def _joint_state(decode: Callable[[bytes], Any], raw: bytes) -> Any:
    """Return a joint state; the numbers of one with the names of an earlier one are read by their places."""
    known = known_message(raw)
    if known is not None:
        return JointColumns(*known[:5])
    content = decode(raw)
    learn_layout(raw, content)
    return content
