"""What a bag holds, as its reader says it."""

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
    """What a bag holds.

    Attributes
    ----------
    counters : dict
        Loss counters by topic (received, written, dropped, missed, late); empty for foreign bags.
    configuration : str, optional
        YAML of the machine.
    finished : bool
        Whether the recording was closed.
    problems : tuple of str
        What is damaged or missing, a line each; empty for a sound bag.
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
