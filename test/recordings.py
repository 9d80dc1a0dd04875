# SPDX-License-Identifier: Apache-2.0
"""Recordings for tests: one-process runs, and bags written message by message."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from catalogue import built
from rclpy.serialization import deserialize_message, serialize_message

from mech_twin.engine.run import frames
from mech_twin.parameters.description import description_text
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_writer import BagWriter
from mech_twin.recording.frame_recorder import FrameRecorder
from mech_twin.recording.schemas import message_class, offered_qos
from mech_twin.samples import Frame

LATCHED_QOS = offered_qos(durability="transient_local", depth=1)
PLAIN_QOS = offered_qos(depth=100)


def simulated_bag(name: str, duration_s: float, directory: Path) -> list[Frame]:
    """Record a one-process run; return its frames."""
    machine = built(name)
    recorder = FrameRecorder(machine, directory, description_text(name, machine.parameters, revision=1))
    made = list(frames(machine, duration_s))
    for frame in made:
        recorder.write(frame)
    recorder.close()
    return made


class Entry(NamedTuple):
    """One message to be written."""

    topic: str
    type_name: str
    log_time_ns: int
    raw: bytes
    qos_yaml: str = PLAIN_QOS


def written_bag(directory: Path, entries: Iterable[Entry], configuration: str = "") -> Path:
    """Write a bag of just these messages."""
    with BagWriter(directory, configuration=configuration) as writer:
        for entry in entries:
            latched = "transient_local" in entry.qos_yaml
            writer.add_topic(entry.topic, entry.type_name, entry.qos_yaml)
            writer.write(entry.topic, entry.raw, entry.log_time_ns, entry.log_time_ns, latched=latched)
    return directory


def entries_of(bag: Path) -> list[Entry]:
    """Return every message of a bag."""
    with BagReader(bag) as reader:
        qos = {name: topic.qos_yaml for name, topic in reader.topics.items()}
        return [Entry(m.topic, m.type_name, m.log_time_ns, m.raw, qos[m.topic]) for m in reader.messages()]


def altered_bag(bag: Path, out: Path, alter: Callable[[Entry], Iterable[Entry]]) -> Path:
    """Write another bag, each message replaced by what ``alter`` makes of it."""
    with BagReader(bag) as reader:
        configuration = reader.info.configuration or ""
    return written_bag(out, (new for entry in entries_of(bag) for new in alter(entry)), configuration)


def earlier_layout(entry: Entry) -> Iterable[Entry]:
    """Return the entry as versions without step topics recorded it: the joint states were the step messages."""
    space, _, below = entry.topic.removeprefix("/").partition("/")
    if below.endswith("joint_states"):
        return ()
    role = below.removeprefix("step/")
    name = entry.topic if role == below else f"/{space}/{'' if role == 'linkage' else role + '/'}joint_states"
    return (entry._replace(topic=name),)


def edited(entry: Entry, edit: Callable[[Any], None]) -> Entry:
    """Return the entry with its message edited in place."""
    package, _, name = entry.type_name.split("/")
    kind = getattr(__import__(f"{package}.msg", fromlist=[name]), name)
    message = deserialize_message(entry.raw, kind)
    edit(message)
    return entry._replace(raw=serialize_message(message))


def decoded_messages(bag: Path, topic: str) -> list[Any]:
    """Return the messages of one topic."""
    with BagReader(bag) as reader:
        kind = message_class(reader.topics[topic])
        return [deserialize_message(message.raw, kind) for message in reader.messages([topic])]
