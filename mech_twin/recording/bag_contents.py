# SPDX-License-Identifier: Apache-2.0
"""Contents of a recording: messages, topics, files, totals; and the interface of its readers.

The stamp of a header is read from CDR bytes.  A ring buffer keeps the messages of the last seconds for a snapshot.
"""

from __future__ import annotations

import struct
from abc import abstractmethod
from collections import Counter, deque
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from mech_twin.process.closing import Closing

NS_PER_S = 1_000_000_000
ENCAPSULATION = 4
SEQUENCE_LENGTH = 4
HEADER_FIRST = frozenset(
    {
        "sensor_msgs/msg/Imu",
        "sensor_msgs/msg/JointState",
        "geometry_msgs/msg/TransformStamped",
        "geometry_msgs/msg/WrenchStamped",
        "geometry_msgs/msg/Vector3Stamped",
        "diagnostic_msgs/msg/DiagnosticArray",
        "trajectory_msgs/msg/JointTrajectory",
        "rosgraph_msgs/msg/Clock",
    }
)
SEQUENCE_OF_HEADERS_FIRST = frozenset({"visualization_msgs/msg/MarkerArray"})


class RecentMessage(NamedTuple):
    """A serialized message: full topic name, and log time (ns)."""

    topic: str
    raw: bytes
    at_ns: int


class RecentMessages:
    """Buffer of the messages of the last seconds of log time, ``kept``.

    Parameters
    ----------
    seconds : float
        Log time for which a message is kept (s).
    """

    def __init__(self, seconds: float) -> None:
        self._keep_ns = round(seconds * NS_PER_S)
        self.kept: deque[RecentMessage] = deque()
        self.received: Counter[str] = Counter()

    def take(self, message: RecentMessage) -> None:
        """Add a message and drop those that are too old; if log time jumps back, drop all earlier ones."""
        if self.kept and message.at_ns < self.kept[0].at_ns:
            self.kept.clear()
        self.received[message.topic] += 1
        self.kept.append(message)
        while message.at_ns - self.kept[0].at_ns > self._keep_ns:
            self.kept.popleft()

    def released(self) -> tuple[RecentMessage, ...]:
        """Return the buffered messages, and clear the buffer."""
        found = tuple(self.kept)
        self.kept.clear()
        return found


def stamp_ns(type_name: str, raw: bytes) -> int | None:
    """Return the header stamp of a message in nanoseconds, None for a type without one.

    Parameters
    ----------
    type_name : str
        Such as ``sensor_msgs/msg/JointState``.
    raw : bytes
        CDR with its four-byte encapsulation header.
    """
    if type_name in HEADER_FIRST:
        offset = ENCAPSULATION
    elif type_name in SEQUENCE_OF_HEADERS_FIRST and len(raw) > ENCAPSULATION + SEQUENCE_LENGTH:
        offset = ENCAPSULATION + SEQUENCE_LENGTH
    else:
        return None
    if len(raw) < offset + 8:
        return None
    seconds, nanoseconds = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, offset)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


class BagMessage(NamedTuple):
    """One recorded message, serialized."""

    topic: str
    type_name: str
    log_time_ns: int
    publish_time_ns: int
    raw: bytes


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a bag."""

    topic: str
    type_name: str
    message_count: int
    qos_yaml: str
    type_hash: str
    definition: str
    schema_encoding: str
    message_encoding: str


@dataclass(frozen=True)
class SplitInfo:
    """One file of a bag."""

    file: Path
    size_bytes: int
    start_ns: int | None
    end_ns: int | None
    message_count: int


@dataclass(frozen=True)
class BagInfo:
    """Summary of a recording.

    Attributes
    ----------
    counters : dict
        Loss counters by topic (received, written, dropped, missed, late), and the largest number of simultaneous
        publishers; empty for foreign bags.
    configuration : str, optional
        The machine's configuration as YAML.
    finished : bool
        Whether the recording was closed.
    problems : tuple of str
        What is damaged or missing, one line each; empty for an intact recording.
    """

    path: Path
    topics: dict[str, TopicInfo]
    message_count: int
    start_ns: int | None
    duration_s: float
    splits: tuple[SplitInfo, ...]
    finished: bool
    problems: tuple[str, ...]
    counters: dict[str, dict[str, int]] = field(default_factory=dict)
    configuration: str | None = None


class RecordingReader(Closing):
    """A recording open for reading, in any storage format; its files are open until it is closed."""

    start_ns: int | None
    end_ns: int | None

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.topics: dict[str, TopicInfo] = {}
        self._problems: list[str] = []
        self._stack = ExitStack()

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    @property
    @abstractmethod
    def info(self) -> BagInfo:
        """The summary of the bag."""

    @abstractmethod
    def messages(
        self,
        topics: Collection[str] | None = None,
        start_s: float = 0.0,
        duration_s: float | None = None,
        *,
        as_written: bool = False,
    ) -> Iterator[BagMessage]:
        """Yield the messages in the order of log time; of equal times, in the order of the files.

        Parameters
        ----------
        topics : collection of str, optional
            Only these topics; a topic that is not in the bag yields nothing.
        start_s, duration_s : float
            Time range, relative to the start of the bag.
        as_written : bool
            In the order of the files instead, which a log clock that was set does not change.

        Raises
        ------
        DamagedBagError, BagBeyondLimitsError
            A damaged record is reached; the chunks overlap in time so much that sorting needs too much memory.
        """

    def _add_topic(self, topic: TopicInfo) -> None:
        """Add a topic of one file to those of the files before."""
        known = self.topics.get(topic.topic)
        count = topic.message_count + (0 if known is None else known.message_count)
        self.topics[topic.topic] = replace(topic, message_count=count)

    def _info(self, splits: Iterable[SplitInfo], finished: bool, problems: Iterable[str], **known: Any) -> BagInfo:
        """Return the summary with these files and problems; ``known`` are counters and configuration."""
        start, end = self.start_ns, self.end_ns
        return BagInfo(
            path=self.path,
            topics=self.topics,
            message_count=sum(topic.message_count for topic in self.topics.values()),
            start_ns=start,
            duration_s=0.0 if start is None or end is None else (end - start) * 1e-9,
            splits=tuple(splits),
            finished=finished,
            problems=tuple(problems),
            **known,
        )
