# SPDX-License-Identifier: Apache-2.0
"""Records sensor readings as a bag of foreign topics: the messages that a real machine's nodes would publish."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from geometry_msgs.msg import Vector3Stamped, WrenchStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64

from mech_twin.messages.step_message import set_stamp
from mech_twin.recording.bag_writer import BagWriter
from mech_twin.recording.errors import BagError
from mech_twin.recording.measured_topics import JOINT_FIELDS, STAMP, TopicField
from mech_twin.recording.schemas import offered_qos

_TYPES = {
    "wrench": (WrenchStamped, "geometry_msgs/msg/WrenchStamped"),
    "vector": (Vector3Stamped, "geometry_msgs/msg/Vector3Stamped"),
    STAMP: (Vector3Stamped, "geometry_msgs/msg/Vector3Stamped"),
    "angular_velocity": (Imu, "sensor_msgs/msg/Imu"),
    "linear_acceleration": (Imu, "sensor_msgs/msg/Imu"),
    "data": (Float64, "std_msgs/msg/Float64"),
}
_JOINT_STATE = (JointState, "sensor_msgs/msg/JointState")
DEPTH = 100


class SensorRecorder:
    """Writer of a bag of sensor readings.

    Parameters
    ----------
    directory : Path
        The bag to create.
    fields : iterable of TopicField
        Every field that will be written.

    Raises
    ------
    BagError
        The bag cannot be created; a field belongs to no supported message type; a topic would need two types.
    """

    def __init__(self, directory: Path, fields: Iterable[TopicField]) -> None:
        self._kinds: dict[str, tuple[Any, str]] = {}
        for item in fields:
            kind = (
                _JOINT_STATE
                if item.joint is not None and item.field in JOINT_FIELDS
                else _TYPES.get(item.field.partition(".")[0])
            )
            if kind is None:
                known = ", ".join((*JOINT_FIELDS, *_TYPES))
                raise BagError(directory, f"field {item.field!r} of topic {item.topic!r}: expected one of {known}")
            if self._kinds.setdefault(item.topic, kind) != kind:
                raise BagError(
                    directory, f"topic {item.topic!r} would have two types, {self._kinds[item.topic][1]} and {kind[1]}"
                )
        self._writer = BagWriter(directory, configuration="")
        for topic, (_, name) in self._kinds.items():
            self._writer.add_topic(topic, name, offered_qos(durability="volatile", depth=DEPTH))

    def __enter__(self) -> SensorRecorder:
        """Return the recorder itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the bag; without any message, delete it."""
        self._writer.close(discard_empty=True)

    def write(self, time_s: float, fields: Sequence[TopicField], values: Sequence[float]) -> None:
        """Record one message: fields of one topic at one stamp (s), which is also the log time."""
        topic = fields[0].topic
        message = self._kinds[topic][0]()
        if hasattr(message, "header"):
            set_stamp(message.header, time_s)
        if isinstance(message, JointState):
            _fill_joints(message, fields, values)
        else:
            for item, value in zip(fields, values, strict=True):
                _fill(message, item, value)
        now_ns = round(time_s * 1e9)
        self._writer.write(topic, serialize_message(message), now_ns, now_ns)


def _fill_joints(message: JointState, fields: Sequence[TopicField], values: Sequence[float]) -> None:
    """Fill a JointState; a field that only some of its joints have is NaN for the others."""
    message.name = list(dict.fromkeys(item.joint or "" for item in fields))
    for column in JOINT_FIELDS:
        known = {item.joint: value for item, value in zip(fields, values, strict=True) if item.field == column}
        if known:
            setattr(message, column, [known.get(name, float("nan")) for name in message.name])


def _fill(message: Any, item: TopicField, value: float) -> None:
    if item.joint is not None:
        message.header.frame_id = item.joint
    if item.field == STAMP:
        return
    *groups, last = item.field.split(".")
    for word in groups:
        message = getattr(message, word)
    setattr(message, last, value)
