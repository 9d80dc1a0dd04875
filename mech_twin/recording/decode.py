# SPDX-License-Identifier: Apache-2.0
"""Decodes CDR to Python objects, by the message definitions stored in the bag."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from mech_twin.recording.bag_contents import BagMessage, TopicInfo
from mech_twin.recording.errors import DecodeError

JOINT_STATE = "sensor_msgs/msg/JointState"
_SEPARATOR = "=" * 80
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_FIELDS = ("header", "name", "position", "velocity", "effort")
_MOST_LAYOUTS = 16  # of one topic: several publishers, or events in some of the messages


class MessageDecoder:
    """Decodes the messages of one bag.

    Parameters
    ----------
    topics : mapping
        `BagReader.topics`.
    """

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
            function = _function(self._topics[message.topic])
            if message.type_name == JOINT_STATE:
                function = _JointStates(function)
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


def _is_field(line: str) -> bool:
    text = line.partition("#")[0].strip()
    return bool(text) and "=" not in text.replace("<=", "")


class _JointStates:
    """Decodes the joint states of a topic; the numbers of one with known names are read by their places."""

    def __init__(self, decode: Callable[[bytes], Any]) -> None:
        self._decode = decode
        self._layouts: dict[int, _Layout | None] = {}  # by the size of a message

    def __call__(self, raw: bytes) -> Any:
        layout = self._layouts.get(len(raw))
        content = None if layout is None else layout.read(raw)
        if content is None:
            content = self._decode(raw)
            if layout is not None or len(raw) not in self._layouts:
                if len(self._layouts) == _MOST_LAYOUTS:
                    self._layouts.clear()
                self._layouts[len(raw)] = _layout(raw, content)
        return content


class _Layout:
    """Places of the numbers in messages that have the names, and as many numbers, as a decoded one."""

    def __init__(self, raw: bytes, like: Any) -> None:
        self._like = like
        self._counts = [len(getattr(like, field)) for field in _FIELDS[2:]]
        end = _after_text(8, like.header.frame_id)  # after the stamp, places counted from the fifth byte
        end += -end % 4 + 4
        for name in like.name:
            end = _after_text(end + -end % 4, name)
        self._same = raw[12 : 4 + end]
        places = f"<4xiI{end - 8}x"
        for count in self._counts:
            places += f"{-end % 4}xI"
            end += -end % 4 + 4
            if count > 0:
                places += f"{-end % 8}x{count}d"
                end += -end % 8 + 8 * count
        self._places = struct.Struct(places)

    def read(self, raw: bytes) -> Any:
        """Return a message of the same size, None if it has other names or counts."""
        if raw[:4] != _LITTLE_ENDIAN or raw[12 : 12 + len(self._same)] != self._same:
            return None
        sec, nanosec, *numbers = self._places.unpack_from(raw)  # a middleware may leave bytes behind its end
        like, place = self._like, 0
        content, header, stamp = type(like)(), type(like.header)(), type(like.header.stamp)()
        for field, count in zip(_FIELDS[2:], self._counts, strict=True):
            if numbers[place] != count:
                return None
            setattr(content, field, numbers[place + 1 : place + 1 + count])
            place += 1 + count
        stamp.sec, stamp.nanosec = sec, nanosec
        header.stamp, header.frame_id = stamp, like.header.frame_id
        content.header, content.name = header, like.name
        return content


def _after_text(place: int, text: str) -> int:
    return place + 4 + len(text.encode()) + 1


def _layout(raw: bytes, content: Any) -> _Layout | None:
    """Return the layout of a decoded message; None if it does not give the same message, as of another definition."""
    try:
        layout = _Layout(raw, content)
        again = layout.read(raw)
        same = again is not None and (again.header, again.name) == (content.header, content.name)
    except (AttributeError, TypeError, struct.error):
        return None
    equal = same and all(
        np.array_equal(getattr(again, field), getattr(content, field), equal_nan=True) for field in _FIELDS[2:]
    )
    return layout if equal else None
