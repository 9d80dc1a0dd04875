# SPDX-License-Identifier: Apache-2.0
"""Channels of numbers from a bag of foreign topics: joints of JointState, dotted fields of any other message."""

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mech_twin.recording.bag_contents import RecordingReader, TopicInfo
from mech_twin.recording.errors import BagError, DecodeError
from mech_twin.recording.message_decoder import JOINT_STATE, MessageDecoder, fields_of

Array = npt.NDArray[np.float64]
JOINT_FIELDS = ("position", "velocity", "effort")
SCALAR_TYPES: Mapping[str, tuple[str, ...]] = {  # what turns a mechanism of one plane, about z, before the rest
    "geometry_msgs/msg/WrenchStamped": (
        *(f"wrench.force.{axis}" for axis in "xyz"),
        *(f"wrench.torque.{axis}" for axis in "zxy"),
    ),
    "geometry_msgs/msg/Vector3Stamped": ("vector.x", "vector.y", "vector.z"),
    "sensor_msgs/msg/Imu": (
        *(f"angular_velocity.{axis}" for axis in "zxy"),
        *(f"linear_acceleration.{axis}" for axis in "xyz"),
    ),
    "std_msgs/msg/Float64": ("data",),
    "std_msgs/msg/Float32": ("data",),
    "std_msgs/msg/Int32": ("data",),
    "std_msgs/msg/Int64": ("data",),
}
STAMP = "stamp"  # the field that is the time of the message
SAMPLES_PER_BLOCK = 4096
EPOCH_NS = 10**15
SECOND_NS = 10**9
JOINTS_WITHIN_NS = 2 * SECOND_NS  # of a topic, in which all of its publishers have told their joints
OF_SHADOW = "/twin/"  # part of the topics that a shadow publishes
BOOKKEEPING = "~"  # first character of names in a step message that are not joints


class TopicField(NamedTuple):
    """One number of the messages of a topic."""

    topic: str
    joint: str | None
    field: str


class FieldBlock(NamedTuple):
    """Samples of one field: stamps (s), values, and changes of the delay (log time minus stamp) since the first (s)."""

    channel: int
    times_s: Array
    values: Array
    delays_s: Array


class MeasuredTopics:
    """The numbers in the messages of a bag from any recorder."""

    def __init__(self, reader: RecordingReader) -> None:
        self.path: Path = reader.path
        self._reader = reader
        self._decoder = MessageDecoder(reader.topics)

    def fields(self) -> list[TopicField]:
        """Return every field of the known types; the joints are those of the first seconds of a topic."""
        joints = {name for name, about in self._reader.topics.items() if about.type_name == JOINT_STATE}
        waiting = {name for name in joints if self._reader.topics[name].message_count}
        found: dict[TopicField, None] = {}
        shapes, looked = set[tuple[object, ...]](), dict[str, int]()
        for message in self._reader.messages(sorted(waiting)) if waiting else ():
            waiting -= {topic for topic, end_ns in looked.items() if message.log_time_ns > end_ns}
            if not waiting:
                break
            if message.topic not in waiting:
                continue
            try:
                content = self._decoder.decode(message)
            except DecodeError:
                if message.topic in looked:  # readable until here: told to whoever asks for these numbers
                    continue
                raise
            looked.setdefault(message.topic, message.log_time_ns + JOINTS_WITHIN_NS)
            lengths = [len(getattr(content, field)) for field in JOINT_FIELDS]
            shape = (message.topic, *content.name, *lengths)
            if shape not in shapes:
                shapes.add(shape)
                found |= dict.fromkeys(
                    TopicField(message.topic, joint, field)
                    for place, joint in enumerate(content.name)
                    for field, length in zip(JOINT_FIELDS, lengths, strict=True)
                    if not joint.startswith(BOOKKEEPING) and place < length
                )
        for name, about in self._reader.topics.items():
            if about.message_count:
                found |= dict.fromkeys(TopicField(name, None, field) for field in SCALAR_TYPES.get(about.type_name, ()))
        return list(found)

    def blocks(self, wanted: Sequence[TopicField], *, by_header: bool) -> Iterator[FieldBlock]:
        """Yield the samples of these fields.

        Parameters
        ----------
        wanted : sequence of TopicField
            Topics are matched without their namespace if no topic has exactly this name.
        by_header : bool
            Use the header stamp as time if a message has one, else the log time.

        Raises
        ------
        BagError
            A topic, joint or field is not in the bag.
        """
        gathered = [_Gathered(place, item) for place, item in enumerate(wanted)]
        of_topic: dict[str, list[_Gathered]] = {}
        for channel in gathered:
            of_topic.setdefault(self._topic(channel.wanted.topic).topic, []).append(channel)
        origin_ns: int | None = None
        fields = (fields_of(self._reader.topics[name]) for name in of_topic)
        stamped = by_header and all(any(each.endswith(" header") for each in found) for found in fields)
        for message in self._reader.messages(list(of_topic), as_written=stamped):
            try:
                content = self._decoder.decode(message)
            except DecodeError as error:
                raise BagError(self.path, str(error)) from error
            stamp_ns = _stamp_ns(content) if by_header else None
            time_ns = message.log_time_ns if stamp_ns is None else stamp_ns
            if origin_ns is None:
                origin_ns = time_ns - time_ns % SECOND_NS if time_ns > EPOCH_NS else 0
            delay_ns = None if stamp_ns is None else message.log_time_ns - stamp_ns
            for channel in of_topic[message.topic]:
                channel.take(content, time_ns - origin_ns, delay_ns, self.path)
                if len(channel.times) >= SAMPLES_PER_BLOCK:
                    yield channel.block()
        for channel in gathered:
            if not channel.seen:
                raise BagError(self.path, channel.absence())
            if channel.times:
                yield channel.block()

    def _topic(self, name: str) -> TopicInfo:
        """Return the topic of this name, or the one in the namespace above all others, those of shadows left out."""
        topics = self._reader.topics
        if name in topics or f"/{name}" in topics:
            return topics.get(name) or topics[f"/{name}"]
        for ending in (name.strip("/"), name.strip("/").partition("/")[2]):
            found = [topic for topic in topics if ending and topic.endswith(f"/{ending}")]
            found = [topic for topic in found if OF_SHADOW not in topic] or found
            for topic in found:
                if all(each.startswith(topic.removesuffix(ending)) for each in found):
                    return topics[topic]
            if found:
                raise BagError(self.path, f"topic {name!r} may be any of {', '.join(found)}; write the whole name")
        near = get_close_matches(name, topics, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise BagError(self.path, f"has no topic {name!r}; expected one of {', '.join(sorted(topics))}{hint}")


class _Gathered:
    """Buffer of samples of one field."""

    def __init__(self, place: int, wanted: TopicField) -> None:
        self.wanted = wanted
        self.times: list[int] = []
        self.seen = False
        self._place = place
        self._values: list[float] = []
        self._delays: list[int] = []
        self._first_delay: int | None = None
        self._joints: set[str] = set()

    def take(self, content: Any, time_ns: int, delay_ns: int | None, path: Path) -> None:
        value = self._value(content, time_ns, path)
        if value is None:
            return
        self.seen = True
        self.times.append(time_ns)
        self._values.append(value)
        if delay_ns is not None:
            self._first_delay = delay_ns if self._first_delay is None else self._first_delay
            self._delays.append(delay_ns - self._first_delay)

    def block(self) -> FieldBlock:
        times, values, delays = self.times, self._values, self._delays
        self.times, self._values, self._delays = [], [], []
        whole = delays if len(delays) == len(times) else []
        return FieldBlock(
            self._place, np.array(times) * 1e-9, np.array(values, dtype=np.float64), np.array(whole) * 1e-9
        )

    def absence(self) -> str:
        """Return the reason why there are no samples."""
        topic, joint, field = self.wanted
        if joint is None:
            return f"topic {topic!r} holds no message with a {field!r}"
        if joint in self._joints:
            return f"topic {topic!r}: joint {joint!r} has no {field}"
        names = ", ".join(sorted(self._joints)[:12])
        return f"topic {topic!r} has no joint {joint!r}; expected one of {names}"

    def _value(self, content: Any, time_ns: int, path: Path) -> float | None:
        topic, joint, field = self.wanted
        names = getattr(content, "name", None)
        if joint is not None and isinstance(names, (list, tuple)):
            if len(self._joints) < len(names):
                self._joints.update(names)
            numbers = getattr(content, field, None) if field in JOINT_FIELDS else None
            if numbers is None:
                raise BagError(
                    path, f"topic {topic!r}: field {field!r} of a joint, expected position, velocity or effort"
                )
            place = names.index(joint) if joint in names else len(numbers)
            return float(numbers[place]) if place < len(numbers) else None
        if joint is not None:
            frame = getattr(getattr(content, "header", None), "frame_id", "")
            self._joints.add(frame)
            if frame != joint:
                return None
        return time_ns * 1e-9 if field == STAMP else _dotted(content, field, topic, path)


def _dotted(content: Any, field: str, topic: str, path: Path) -> float | None:
    """Return the number at a dotted field; None beyond the end of an array, which may have any length."""
    value = content
    for word in field.split("."):
        if word.isdigit() and isinstance(value, Sequence) and int(word) >= len(value):
            return None
        known = word.isdigit() and isinstance(value, Sequence)
        if not known and (word.startswith("_") or not hasattr(value, word)):
            slots = [
                slot for slot in getattr(value, "_fields", getattr(value, "__slots__", ())) if not slot.startswith("_")
            ]
            raise BagError(
                path, f"topic {topic!r} has no field {field!r}; expected {', '.join(slots) or 'a number'} at {word!r}"
            )
        value = value[int(word)] if known else getattr(value, word)
    if isinstance(value, bool | int | float):
        return float(value)
    raise BagError(path, f"topic {topic!r}: field {field!r} is no number")


def _stamp_ns(content: Any) -> int | None:
    header = getattr(content, "header", None)
    if header is None:
        return None
    return int(header.stamp.sec) * SECOND_NS + int(header.stamp.nanosec)
