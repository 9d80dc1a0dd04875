# SPDX-License-Identifier: Apache-2.0
"""Records the frames of a one-process run as the messages that the nodes would have published.

Sensor readings are recorded as foreign topics: the messages that a real machine's nodes would publish.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from geometry_msgs.msg import Vector3Stamped, WrenchStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64, String

from mech_twin.capabilities.mechanism import urdf
from mech_twin.engine.trajectory import frame_events
from mech_twin.messages import impacts, scene, topics
from mech_twin.messages.cdr import joint_state_bytes, stamped_bytes, wrench_bytes
from mech_twin.messages.scene import TOOL_FRAME, frame_id, transforms
from mech_twin.messages.step_message import CODECS, REVISION, Row, StepCodec, set_stamp
from mech_twin.messages.step_message import body as body_messages
from mech_twin.messages.step_message import force as force_messages
from mech_twin.messages.step_message import linkage as linkage_messages
from mech_twin.messages.step_message import motor as motor_messages
from mech_twin.process.closing import Closing
from mech_twin.recording.bag_writer import BagWriter
from mech_twin.recording.errors import BagError
from mech_twin.recording.measured_topics import JOINT_FIELDS, STAMP, TopicField
from mech_twin.recording.schemas import offered_qos
from mech_twin.roles import Machine, own_name
from mech_twin.samples import Drawing, Frame

FIELD_TYPES: Mapping[str, Any] = {
    "wrench": WrenchStamped,
    "vector": Vector3Stamped,
    STAMP: Vector3Stamped,
    "angular_velocity": Imu,
    "linear_acceleration": Imu,
    "data": Float64,
}
FIELDS = ", ".join((*JOINT_FIELDS, *FIELD_TYPES))
DEPTH = 100
VIEW_RATE_HZ = 30.0


def field_type(joint: str | None, field: str) -> Any:
    """Return the message type of a field of a foreign topic; None if it is none of `FIELDS`."""
    return JointState if joint is not None and field in JOINT_FIELDS else FIELD_TYPES.get(field.partition(".")[0])


class SensorRecorder(Closing):
    """Writer of a bag of sensor readings.

    Raises
    ------
    BagError
        The bag cannot be created; a field belongs to no supported message type; a topic would need two types.
    """

    def __init__(self, directory: Path, fields: Iterable[TopicField]) -> None:
        self._kinds: dict[str, Any] = {}
        for item in fields:
            kind = field_type(item.joint, item.field)
            if kind is None:
                raise BagError(directory, f"field {item.field!r} of topic {item.topic!r}: expected one of {FIELDS}")
            before = self._kinds.setdefault(item.topic, kind)
            if before != kind:
                names = f"{before.__name__} and {kind.__name__}"
                raise BagError(directory, f"topic {item.topic!r} would have two types, {names}")
        self._writer = BagWriter(directory, configuration="")
        for topic, kind in self._kinds.items():
            name = topics.type_name(topics.Topic(topic, kind))
            self._writer.add_topic(topic, name, offered_qos(durability="volatile", depth=DEPTH))

    def close(self) -> None:
        """Finish the bag; without any message, delete it."""
        self._writer.close(discard_empty=True)

    def write(self, time_s: float, fields: Sequence[TopicField], values: Sequence[float]) -> None:
        """Record one message: fields of one topic at one stamp (s), which is also the log time."""
        topic, now_ns = fields[0].topic, round(time_s * 1e9)
        if self._kinds[topic] is JointState:
            self._writer.write(topic, _joint_state(time_s, fields, values), now_ns, now_ns)
            return
        message = self._kinds[topic]()
        if hasattr(message, "header"):
            set_stamp(message.header, time_s)
        for item, value in zip(fields, values, strict=True):
            _fill(message, item, value)
        self._writer.write(topic, serialize_message(message), now_ns, now_ns)


def _joint_state(time_s: float, fields: Sequence[TopicField], values: Sequence[float]) -> bytes:
    """Return a JointState; a field that only some of its joints have is NaN for the others."""
    names, columns = tuple(dict.fromkeys(item.joint or "" for item in fields)), list[Sequence[float]]()
    for column in JOINT_FIELDS:
        known = {item.joint: value for item, value in zip(fields, values, strict=True) if item.field == column}
        columns.append([known.get(name, float("nan")) for name in names] if known else ())
    return joint_state_bytes(time_s, names, columns)


def _fill(message: Any, item: TopicField, value: float) -> None:
    if item.joint is not None:
        message.header.frame_id = item.joint
    if item.field == STAMP:
        return
    *groups, last = item.field.split(".")
    for word in groups:
        message = getattr(message, word)
    setattr(message, last, value)


class FrameRecorder:
    """Writer of a recording without ROS communication.

    Parameters
    ----------
    description : str
        The configuration, as published on the description topic.

    Raises
    ------
    BagError
        The recording cannot be created there.
    """

    def __init__(self, machine: Machine, directory: Path, description: str) -> None:
        self._machine, self._space = machine, own_name(machine.name, machine.parameters)
        self._writer = BagWriter(directory, configuration=description)
        gauge = machine.gauge
        gauged = () if gauge is None else (topics.BLOW_GAUGE, *((topics.BLOW_WAVE,) if gauge.sent else ()))
        seen = () if machine.mechanism is None else (topics.FRAMES, topics.ROBOT_DESCRIPTION)
        for topic in (*topics.recorded_topics(machine.forces.pins, machine.body is not None), *gauged, *seen):
            durability = "transient_local" if topic.qos is topics.LATCHED else "volatile"
            qos = offered_qos(durability=durability, depth=topic.qos.depth)
            self._writer.add_topic(topics.full_name(self._space, topic), topics.type_name(topic), qos)
        self._now_ns = 0
        self._window = topics.steps_per_window(topics.STREAM_RATE_HZ, machine.coupling_step_s)
        self._wrenches = {pin: topics.PeakHoldWindow[Any](self._window) for pin in machine.forces.pins}
        self._pressing = topics.PeakHoldWindow[Any](self._window)
        self._joints = {codec: topics.StreamWindow[Any](self._window) for codec in CODECS}
        self._steps_per_drawing = max(1, round(1.0 / (VIEW_RATE_HZ * machine.coupling_step_s)))
        self._revision = 1
        self._describe(description)

    def change(self, machine: Machine, description: str) -> None:
        """Record a change of the configuration, valid from the next frame on."""
        self._machine = machine
        self._revision += 1
        self._describe(description)

    def write(self, frame: Frame) -> None:
        """Record one frame."""
        linkage, forces, body = frame.linkage, frame.forces, frame.body
        self._now_ns = round(linkage.time_s * 1e9)
        marks = (Row(REVISION, self._revision),)
        struck = topics.has_impact(linkage.events)
        self._put_step(linkage_messages, linkage, marks, struck)
        self._put_step(motor_messages, frame.motor, (), struck)
        largest = max(map(topics.wrench_size, forces.wrenches), default=0.0)
        self._put_step(force_messages, forces, marks, struck, largest)
        if body is not None:
            struck = topics.has_impact(body.events) or topics.has_impact(forces.loads)
            self._put_step(body_messages, body, (), struck)
            kept = self._pressing.offer(abs(body.pressing_force_n), (body.time_s, (body.pressing_force_n,)))
            self._put_wrenches(topics.PRESSING_FORCE, TOOL_FRAME, kept)
        for pin, wrench in zip(forces.pins, forces.wrenches, strict=True):
            kept = self._wrenches[pin].offer(topics.wrench_size(wrench), (forces.time_s, wrench))
            self._put_wrenches(topics.pin_wrench(pin), pin, kept)
        for event in frame_events(frame):
            self._put(topics.IMPACTS, impacts.to_bytes(event))
        for gauge, event in impacts.gauged_blows(self._machine.gauge, linkage.events):
            self._put(topics.BLOW_GAUGE, impacts.numbers_bytes(gauge, event))
            if event.contact in gauge.sent:
                self._put(topics.BLOW_WAVE, impacts.curve_message(gauge, event))
        self._write_scene(frame)

    def close(self) -> None:
        """Write the last window of the decimated topics and finish the recording; without any frame, delete it."""
        for pin, window in self._wrenches.items():
            self._put_wrenches(topics.pin_wrench(pin), pin, window.rest())
        self._put_wrenches(topics.PRESSING_FORCE, TOOL_FRAME, self._pressing.rest())
        for codec, joints in self._joints.items():
            for sample in joints.rest():
                self._put(codec.joint_states, codec.shown(sample))
        self._writer.close(discard_empty=True)

    def _put_step(
        self, codec: StepCodec[Any], sample: Any, marks: tuple[Row, ...], struck: bool, magnitude: float = 0.0
    ) -> None:
        """Record a step message, and the joint states that are due."""
        self._put(codec.steps, codec.to_bytes(sample, marks))
        for due in self._joints[codec].offer(sample.step, sample, magnitude, struck):
            self._put(codec.joint_states, codec.shown(due))

    def _write_scene(self, frame: Frame) -> None:
        linkage = frame.linkage
        if linkage.step % self._window == 0:
            self._put(topics.CLOCK, stamped_bytes(linkage.time_s))
            self._write_frames(frame)
        if linkage.step % self._steps_per_drawing == 0:
            shapes, frame_name = self._machine.draw(linkage, frame.body), frame_id(self._space, scene.FRAME)
            self._put(topics.SCENE, scene.to_bytes(Drawing(linkage.step, linkage.time_s, shapes), frame_name))

    def _write_frames(self, frame: Frame) -> None:
        if self._machine.mechanism is None:
            return
        positions = dict(zip(frame.linkage.joints, frame.linkage.position, strict=True))
        for found in transforms(self._machine.mechanism, positions, frame.linkage.time_s, self._space):
            self._put(topics.FRAMES, found)

    def _describe(self, description: str) -> None:
        self._put(topics.DESCRIPTION, String(data=description))
        if self._machine.mechanism is not None:
            self._put(topics.ROBOT_DESCRIPTION, String(data=urdf(self._space, self._machine.mechanism)))

    def _put_wrenches(self, topic: topics.Topic, frame: str, kept: tuple[Any, ...]) -> None:
        for time_s, wrench in kept:
            self._put(topic, wrench_bytes(time_s, frame_id(self._space, frame), *wrench))

    def _put(self, topic: topics.Topic, message: Any) -> None:
        name = topics.full_name(self._space, topic)
        raw = message if isinstance(message, bytes) else serialize_message(message)
        self._writer.write(name, raw, self._now_ns, self._now_ns, latched=topic.qos is topics.LATCHED)
