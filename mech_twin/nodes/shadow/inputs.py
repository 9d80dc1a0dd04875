# SPDX-License-Identifier: Apache-2.0
"""Inputs of a shadow: the topics of a map, or the twin's own, and the samples in their messages.

A machine's stamps may start anywhere, jump at a restart, and stand still meanwhile.  A single stamp that does not
continue the others is damaged or from another publisher: it does not set the time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import isfinite
from typing import Any, Generic, NamedTuple, TypeVar

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.measurements.measurement_map import Channel, MeasurementMap
from mech_twin.measurements.units import is_event
from mech_twin.messages.cdr import CdrError, Stamp, received_message, stamp_of
from mech_twin.messages.topics import BODY_JOINT_STATES, JOINT_STATES, Topic
from mech_twin.recording.frame_recorder import FIELD_TYPES, FIELDS, field_type
from mech_twin.recording.measured_topics import EPOCH_NS, JOINT_FIELDS, SECOND_NS, STAMP
from mech_twin.roles import Machine
from mech_twin.studies.observer.estimate import SeenSample, SensedChannel

BEHIND_NS = SECOND_NS  # largest lag between topics of a machine
AHEAD_NS = SECOND_NS // 4
PACE = 2.0  # largest rate of the machine's clock to the steady clock between messages
CONFIRMING = 3  # consecutive stamps before a new time base is accepted
MOST_TIMES = 8  # candidate time bases held at once
MOST_HELD = 1000
Item = TypeVar("Item")


class ReceivedStamp(NamedTuple):
    """A stamp (ns), and its time of arrival (s of the steady clock)."""

    stamp_ns: int
    at_s: float

    def goes_on_from(self, before: ReceivedStamp) -> bool:
        """Return whether it is at most as far ahead as the time passed, and hardly behind."""
        passed_ns = PACE * max(self.at_s - before.at_s, 0.0) * SECOND_NS
        return -BEHIND_NS <= self.stamp_ns - before.stamp_ns <= AHEAD_NS + passed_ns


class FollowedClock:
    """The newest accepted stamp of a machine.

    A stamp that continues the newest is accepted.  Another time, the first one too, is accepted when several stamps
    continue each other and none continues the newest meanwhile.

    Attributes
    ----------
    now_ns : int or None
        The newest; None while none is accepted.
    jumps : int
        Number of jumps to another time.
    led_by : frozenset of int
        The stamps by which the present time was accepted.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self.led_by: frozenset[int] = frozenset()
        self._newest: ReceivedStamp | None = None
        self._others: deque[list[ReceivedStamp]] = deque(maxlen=MOST_TIMES)

    @property
    def now_ns(self) -> int | None:
        """The newest accepted stamp."""
        return None if self._newest is None else self._newest.stamp_ns

    def at(self, at_s: float) -> int | None:
        """Return the machine's time (ns) at an instant of the steady clock (s), None if unknown."""
        newest = self._newest
        return None if newest is None else newest.stamp_ns + round((at_s - newest.at_s) * SECOND_NS)

    def admit(self, stamp_ns: int, at_s: float) -> bool:
        """Return whether a stamp that arrived at an instant of the steady clock (s) is accepted."""
        arrival = ReceivedStamp(stamp_ns, at_s)
        if stamp_ns < 0:
            return False
        if self._newest is not None and arrival.goes_on_from(self._newest):
            self._newest = ReceivedStamp(max(self._newest.stamp_ns, stamp_ns), at_s)
            self._others.clear()
            return True
        row = next((row for row in self._others if arrival.goes_on_from(row[-1])), None)
        if row is None:
            self._others.append(row := [])
        row.append(arrival)
        if len(row) < CONFIRMING:
            return False
        self.jumps += self._newest is not None
        self.led_by = frozenset(each.stamp_ns for each in row)
        self._newest = max(row)
        self._others.clear()
        return True


class Admitted(NamedTuple, Generic[Item]):
    """A message, its own stamp (ns) if that may set the time, its effective time (ns), and whether they agree."""

    item: Item
    stamp_ns: int | None
    at_ns: int
    believed: bool


class StampGate(Generic[Item]):
    """Holds messages until the machine's time is known, and releases them in the order of arrival."""

    def __init__(self) -> None:
        self.clock = FollowedClock()
        self.held: list[tuple[Item, int | None]] = []

    def take(self, item: Item, stamp_ns: int | None, at_s: float) -> list[Admitted[Item]]:
        """Add a message, with its stamp if that may set the time; return the messages that can be released."""
        believed = stamp_ns is not None and self.clock.admit(stamp_ns, at_s)
        if self.clock.now_ns is not None:
            return [*self.released(), Admitted(item, stamp_ns, self.clock.now_ns, believed)]
        self.held.append((item, stamp_ns))
        return self.released() if len(self.held) > MOST_HELD else []

    def released(self) -> list[Admitted[Item]]:
        """Return the held messages; without a known time theirs is 0."""
        held, self.held = self.held, []
        led_by, found = self.clock.led_by, []
        at_ns = min(led_by, default=0)
        for item, stamp in held:
            believed = stamp is not None and stamp in led_by
            at_ns = max(at_ns, stamp) if stamp is not None and believed else at_ns
            found.append(Admitted(item, stamp, at_ns, believed))
        return found


COMMAND = "motor.command"


class StampOrigin:
    """Origin of times (s): 0, or the first accepted stamp (`FollowedClock`) if stamps are of a wall clock.

    A float holds a wall clock's stamp to 0.2 us only; a recording is read with the same origin.
    """

    def __init__(self) -> None:
        self.second: int | None = None

    def seconds(self, stamp: Any) -> float:
        """Return the time of a stamp since the origin (s)."""
        if self.second is None:
            self.second = stamp.sec if stamp.sec * SECOND_NS > EPOCH_NS else 0
        return float(((stamp.sec - self.second) * SECOND_NS + stamp.nanosec) * 1e-9)

    def clock_s(self, time_s: float) -> float:
        """Return the machine's clock (s) at a time since the origin (s)."""
        return time_s + (self.second or 0)

    def stamp(self, time_s: float) -> Stamp:
        """Return the stamp of a time since the origin (s)."""
        found = stamp_of(time_s)
        return Stamp(found.sec + (self.second or 0), found.nanosec)


class ReceivedValues(NamedTuple):
    """Channels of a message: their indices, values in SI units, stamp (None if the type has none), and delay (s)."""

    channels: tuple[int, ...]
    values: tuple[float, ...]
    stamp: Stamp | None
    lag_s: float

    @property
    def led_ns(self) -> int | None:
        """The machine's time (ns): stamp less delay; None without a stamp."""
        if self.stamp is None:
            return None
        return self.stamp.sec * SECOND_NS + self.stamp.nanosec - round(self.lag_s * SECOND_NS)

    def sample(self, origin: StampOrigin, else_ns: int) -> SeenSample:
        """Return the sample at the machine's time since the origin; a message without a stamp has the time given."""
        stamp = Stamp(*divmod(else_ns, SECOND_NS)) if self.stamp is None else self.stamp
        return SeenSample(origin.seconds(stamp) - self.lag_s, self.channels, self.values)


class FollowedField(NamedTuple):
    """One number of the messages of a topic: index of its channel, and its field."""

    place: int
    channel: Channel

    @property
    def of_joint(self) -> bool:
        """Whether it is a field of a JointState."""
        return self.channel.source.joint is not None and self.channel.source.field in JOINT_FIELDS


class FollowedTopic:
    """A subscribed topic of the machine, and the channels in its messages.

    Parameters
    ----------
    name : str
        Full name.
    fields : sequence of FollowedField
        Fields of its messages that are used.
    """

    def __init__(self, name: str, fields: Sequence[FollowedField]) -> None:
        self.fields = tuple(fields)
        kinds = {_type_of(field) for field in fields if field.channel.source.field != STAMP} or {FIELD_TYPES[STAMP]}
        if len(kinds) != 1:
            raise ConfigurationError(f"topic {name!r} would have several types: {', '.join(k.__name__ for k in kinds)}")
        self.of_events = is_event(fields[0].channel.quantity)  # which the observer does not use
        if any(is_event(field.channel.quantity) != self.of_events for field in fields):
            raise ConfigurationError(f"topic {name!r} would hold both samples and events; expected a topic for each")
        self.topic = Topic(name, kinds.pop())

    @property
    def has_stamps(self) -> bool:
        """Whether its messages have a stamp."""
        return hasattr(self.topic.type, "header")

    @property
    def lag_s(self) -> float:
        """Delay of its values (s)."""
        return float(self.fields[0].channel.lag_s)

    def values(self, raw: bytes) -> ReceivedValues | None:
        """Return the channels of a message; None if it contains none of them.

        Raises
        ------
        CdrError
            The bytes are not a message of the type, or a value is not finite.
        """
        joints = self.topic.type is JointState
        message: Any = received_message(raw) if joints else _converted(raw, self.topic.type)
        found = {f.place: (f.channel, _value(message, f)) for f in self.fields if _has(message, f)}
        if not found:
            return None
        values = tuple(float(channel.to_machine(value)) for channel, value in found.values())
        if not all(map(isfinite, values)):
            raise CdrError("a value is not finite")
        stamp = message.header.stamp if self.has_stamps else None
        return ReceivedValues(tuple(found), values, stamp, self.lag_s)


def events_last(given: MeasurementMap) -> MeasurementMap:
    """Return the map with its channels of events after those of the observer."""
    ordered = sorted(given.channels, key=lambda channel: is_event(channel.quantity))
    return given.model_copy(update={"channels": tuple(ordered)})


def sensed_channels(given: MeasurementMap) -> list[SensedChannel]:
    """Return the channels of a map for the observer; those of events are used by the monitor only.

    Raises
    ------
    ConfigurationError
        A zero, gain or lag is no number; channels of one topic have several lags.
    """
    lags: dict[str | None, float] = {}
    for place, channel in enumerate(given.channels):
        for key in ("zero", "gain", "lag_s"):
            value = getattr(channel, key)
            if isinstance(value, str):
                raise ConfigurationError(
                    f"key 'channels.{place}.{key}', value {value!r}: expected a number to follow a machine by; "
                    "`mech-twin identify` or `replay --analyse` finds it"
                )
        if lags.setdefault(channel.source.topic, float(channel.lag_s)) != channel.lag_s:
            raise ConfigurationError(
                f"key 'channels.{place}.lag_s', value {channel.lag_s}: expected that of the other channels of its topic"
            )
    return [SensedChannel(channel.quantity, _sigma(channel)) for channel in given.channels]


def followed_topics(given: MeasurementMap, namespace: str) -> list[FollowedTopic]:
    """Return the topics of a map; names without a leading slash are below the namespace.

    Raises
    ------
    ConfigurationError
        A channel is a column of a table; channels of one topic need several types, or are samples and events.
    """
    by_topic: dict[str, list[FollowedField]] = {}
    for place, channel in enumerate(given.channels):
        name = channel.source.topic
        if name is None:
            raise ConfigurationError(f"key 'channels.{place}': expected a topic to follow")
        full = name if name.startswith("/") else f"{namespace}/{name}"
        by_topic.setdefault(full, []).append(FollowedField(place, channel))
    return [FollowedTopic(name, fields) for name, fields in by_topic.items()]


def own_map(machine: Machine) -> MeasurementMap:
    """Return the map of a machine that publishes like the twin: positions of its independent and leading joints."""
    first = "" if machine.mechanism is None else machine.mechanism.leading  # driven, and so not independent, in a page
    leading = [joint for joint in machine.linkage.joints if joint == first or joint in machine.linkage.coordinates]
    if machine.body is not None:
        leading = [joint for joint in leading if joint not in machine.body.joints]
    sources = [(JOINT_STATES.name, "linkage", joint) for joint in leading]
    if machine.body is not None:
        sources += [(BODY_JOINT_STATES.name, "body", joint) for joint in machine.body.joints]
    channels = [
        {"source": {"topic": topic, "joint": joint, "field": "position"}, "is": f"{role}.{joint}.position"}
        for topic, role, joint in sources
    ]
    return MeasurementMap.model_validate({"machine": machine.name, "channels": channels})


def _type_of(field: FollowedField) -> Any:
    source = field.channel.source
    found = field_type(source.joint, source.field or "")
    if found is None:
        raise ConfigurationError(f"field {source.field!r} of {source.topic!r}: expected one of {FIELDS}")
    return found


def _sigma(channel: Channel) -> float:
    """Return the standard deviation in SI units, with that of the quantum (quantum^2 / 12); NaN if not known."""
    if channel.sigma is None:
        return float("nan")
    of_steps = channel.quantum**2 / 12.0
    return float((channel.sigma**2 + of_steps) ** 0.5 * abs(float(channel.gain)) * channel.si_factor)


def _converted(raw: bytes, kind: Any) -> Any:
    try:
        return deserialize_message(raw, kind)
    except RuntimeError as error:
        raise CdrError(f"{len(raw)} bytes that are no {kind.__name__}") from error


def _has(message: Any, field: FollowedField) -> bool:
    source = field.channel.source
    if field.of_joint:
        return source.joint in message.name
    return source.joint is None or message.header.frame_id == source.joint


def _value(message: Any, field: FollowedField) -> float:
    source = field.channel.source
    if source.field == STAMP:
        return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
    if field.of_joint:
        column: Sequence[float] = getattr(message, source.field or "")
        place = message.name.index(source.joint)
        if place >= len(column):
            raise CdrError(f"{source.field} of joint {source.joint} is missing")
        return float(column[place])
    for word in (source.field or "").split("."):
        message = getattr(message, word)
    return float(message)
