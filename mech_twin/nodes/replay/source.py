# SPDX-License-Identifier: Apache-2.0
"""Source of a replay: the valid messages of a bag, from any position, in constant memory.

The position follows the wall clock, with rate, pause and jumps.  Nothing here reads that clock itself.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.qos import DurabilityPolicy, QoSProfile

from mech_twin.messages.topics import CLOCK, IMPACTS, full_name, type_name
from mech_twin.recording.bag_samples import recorded_machines
from mech_twin.recording.errors import BagError, DecodeError, UnknownTypeError
from mech_twin.recording.schemas import decoded, message_class, recorded_qos

if TYPE_CHECKING:
    from mech_twin.recording.bag_contents import BagMessage, RecordingReader

LARGEST_LAG_S = 0.1


class ReplayClock:
    """Replay position, which advances at a rate.

    Parameters
    ----------
    position_ns : int
        Log time at the start.
    rate : float
        Recorded seconds per second.
    now_s : float
        Steady time at the start.
    """

    def __init__(self, position_ns: int, rate: float, now_s: float) -> None:
        self.rate = rate
        self.paused = False
        self._anchor_ns = position_ns
        self._anchor_s = now_s

    def position_ns(self, now_s: float) -> int:
        """Return the position (log time in ns) at a steady time (s)."""
        if self.paused:
            return self._anchor_ns
        return self._anchor_ns + round((now_s - self._anchor_s) * self.rate * 1e9)

    def wait_s(self, log_time_ns: int, now_s: float) -> float:
        """Return the time (s) until a log time is due; at most 0 if it is, infinite while paused."""
        if self.paused:
            return float("inf")
        return (log_time_ns - self._anchor_ns) * 1e-9 / self.rate + self._anchor_s - now_s

    def jump(self, position_ns: int, now_s: float) -> None:
        """Continue from another position."""
        self._anchor_ns, self._anchor_s = position_ns, now_s

    def change_rate(self, rate: float, now_s: float) -> None:
        """Continue at another rate from the present position."""
        self.jump(self.position_ns(now_s), now_s)
        self.rate = rate

    def pause(self, now_s: float) -> None:
        """Pause."""
        self.jump(self.position_ns(now_s), now_s)
        self.paused = True

    def resume(self, now_s: float) -> None:
        """Continue from the present position."""
        self.jump(self.position_ns(now_s), now_s)
        self.paused = False

    def give_way(self, log_time_ns: int, now_s: float) -> bool:
        """Set the position back to a message that is too late, to avoid a flood; return whether it is too late."""
        late = -self.wait_s(log_time_ns, now_s) > LARGEST_LAG_S
        if late:
            self.jump(log_time_ns, now_s)
        return late


LARGEST_LATCH = 100


class SelectionError(BagError):
    """The requested topic or time is not in the bag."""


class PlayedTopic(NamedTuple):
    """A topic that is replayed."""

    name: str
    kind: Any
    qos: QoSProfile

    @property
    def latched(self) -> bool:
        """Whether late subscribers get its last messages."""
        return bool(self.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)


class ReplaySource:
    """The part of a bag to replay.

    Parameters
    ----------
    reader : RecordingReader
        The open bag.
    topics : list of str
        Full names, or names relative to the machine's namespace; all if empty.
    start_s, duration_s : float
        Start from the beginning of the bag, and length; None extends to its end.

    Attributes
    ----------
    topics : dict
        Topics that are replayed.
    unknown : dict
        Topics that are not replayed, and why.
    malformed : Counter
        Number of messages by topic whose bytes are not of its type.

    Raises
    ------
    SelectionError
        If the bag is empty, or has no such topic or time.
    """

    def __init__(
        self,
        reader: RecordingReader,
        topics: list[str] | None = None,
        start_s: float = 0.0,
        duration_s: float | None = None,
    ) -> None:
        if reader.start_ns is None or reader.end_ns is None:
            raise SelectionError(reader.path, "holds no messages")
        self._reader = reader
        self._zero_ns = reader.start_ns
        self.first_ns = self._zero_ns + round(start_s * 1e9)
        wanted_end = reader.end_ns if duration_s is None else self.first_ns + round(duration_s * 1e9)
        self.last_ns = min(reader.end_ns, wanted_end)
        if self.first_ns > reader.end_ns:
            length = (reader.end_ns - self._zero_ns) * 1e-9
            raise SelectionError(reader.path, f"lasts {length:g} s; --start {start_s:g} is beyond its end")
        self._spaces = [full_name(machine, IMPACTS).removesuffix(IMPACTS.name) for machine in recorded_machines(reader)]
        self.unknown: dict[str, str] = {}
        self.malformed: Counter[str] = Counter()
        self.topics: dict[str, PlayedTopic] = {}
        for name in self._selected(topics or []):
            self._admit(name)

    def below(self, name: str) -> str:
        """Return a topic's name below its machine's namespace, or below the first level where it is of no machine."""
        space = max((space for space in self._spaces if name.startswith(space)), key=len, default="")
        return name.removeprefix(space) if space else name.split("/", 2)[-1]

    def seconds(self, log_time_ns: int) -> float:
        """Return a log time (ns) in seconds from the beginning of the bag."""
        return (log_time_ns - self._zero_ns) * 1e-9

    def log_time_ns(self, seconds: float) -> int:
        """Return the log time (ns) of a position in seconds."""
        return self._zero_ns + round(seconds * 1e9)

    def messages(self, from_ns: int) -> Iterator[BagMessage]:
        """Yield the valid messages from a log time on; latched ones of exactly that time are in `latched_at`."""
        for message in self._read(list(self.topics), from_ns, self.last_ns):
            played = self.topics[message.topic]
            if not (played.latched and message.log_time_ns <= from_ns) and self._sound(message):
                yield message

    def latched_at(self, log_time_ns: int) -> dict[str, list[BagMessage]]:
        """Return for each latched topic the messages of a late subscriber at a log time; possibly an empty list."""
        latched = {name: played for name, played in self.topics.items() if played.latched}
        held: dict[str, deque[BagMessage]] = {
            name: deque(maxlen=min(played.qos.depth or 1, LARGEST_LATCH)) for name, played in latched.items()
        }
        for message in self._read(list(latched), self._zero_ns, log_time_ns):
            if self._sound(message):
                held[message.topic].append(message)
        return {name: list(messages) for name, messages in held.items()}

    def next_impact_ns(self, after_ns: int) -> int | None:
        """Return the log time (ns) of the first impact (event with impulse) after a log time; None if there is none."""
        kind = type_name(IMPACTS)
        names = [
            name
            for name, topic in self._reader.topics.items()
            if topic.type_name == kind and name.endswith(f"/{IMPACTS.name}") and topic.message_count
        ]
        for message in self._read(names, after_ns + 1, self.last_ns):
            impact = self._decoded(message, IMPACTS.type)
            if impact is not None and impact.vector.z != 0.0:
                return message.log_time_ns
        return None

    def without_clock(self) -> None:
        """Leave out the recorded clock: the replay publishes its own."""
        self.topics.pop(CLOCK.name, None)

    def _read(self, names: list[str], from_ns: int, to_ns: int) -> Iterator[BagMessage]:
        if not names or to_ns < from_ns:
            return
        start, duration = self.seconds(from_ns), (to_ns - from_ns) * 1e-9
        for message in self._reader.messages(names, start, duration):
            if from_ns <= message.log_time_ns <= to_ns:
                yield message

    def _sound(self, message: BagMessage) -> bool:
        return self._decoded(message, self.topics[message.topic].kind) is not None

    def _decoded(self, message: BagMessage, kind: Any) -> Any:
        """Return the content of a message; None, counted as malformed, if it is not of its type."""
        try:
            return decoded(message.raw, kind)
        except DecodeError:
            self.malformed[message.topic] += 1
            return None

    def _selected(self, wanted: list[str]) -> list[str]:
        names = list(self._reader.topics)
        if not wanted:
            return names
        chosen = []
        for word in wanted:
            found = [name for name in names if word in (name, self.below(name))]
            if not found:
                raise SelectionError(self._reader.path, f"has no topic '{word}'; it has {', '.join(names)}")
            chosen += found
        return [name for name in names if name in chosen]

    def _admit(self, name: str) -> None:
        about = self._reader.topics[name]
        try:
            self.topics[name] = PlayedTopic(name, message_class(about), recorded_qos(about.qos_yaml))
        except UnknownTypeError as error:
            self.unknown[name] = str(error)
