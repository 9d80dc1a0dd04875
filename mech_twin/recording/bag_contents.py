# SPDX-License-Identifier: Apache-2.0
"""Contents of a recording: messages, topics, files, totals; and the interface of its readers."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Protocol


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
    counters: dict[str, dict[str, int]]
    configuration: str | None
    splits: tuple[SplitInfo, ...]
    finished: bool
    problems: tuple[str, ...] = ()


class RecordingReader(Protocol):
    """Interface of a recording open for reading, for all storage formats."""

    path: Path
    topics: dict[str, TopicInfo]
    start_ns: int | None
    end_ns: int | None

    @property
    def info(self) -> BagInfo:
        """Return the summary of the bag."""

    def messages(
        self, topics: Collection[str] | None = None, start_s: float = 0.0, duration_s: float | None = None
    ) -> Iterator[BagMessage]:
        """Yield the messages in order of log time, of these topics and this part of the bag."""

    def close(self) -> None:
        """Close the files."""

    def __enter__(self) -> RecordingReader:
        """Return the reader itself."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the files."""
