"""What a recording holds: messages, topics, files, totals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple


class BagMessage(NamedTuple):
    """One recorded message, still encoded."""

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
        Loss counters by topic (received, written, dropped, missed, late); empty for foreign bags.
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
