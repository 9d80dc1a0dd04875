"""The splits of a recording, one after the other, and the page of contents that lists the finished ones."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

from mech_twin.recording.bag_metadata import FileContents, TopicContents, write_contents
from mech_twin.recording.bag_split import BagSplit, Storage, TopicCounters
from mech_twin.recording.errors import BagExistsError, UnwritableDirectoryError
from mech_twin.recording.schemas import MessageSchema
from mech_twin.recording.split_file import Reserve

FINISHED_KEY = "mech_twin.finished"
COUNTERS_KEY = "mech_twin.counters"
_RESERVE_BYTES = 64 * 1024


class Latched(NamedTuple):
    """The last message of a latched topic."""

    raw: bytes
    publish_time_ns: int
    sequence: int


@dataclass
class RecordedTopic:
    """A topic, what happened to it, and what a new split repeats of it."""

    schema: MessageSchema
    qos_yaml: str
    counters: TopicCounters = field(default_factory=TopicCounters)
    latched: Latched | None = None


class SplitSeries:
    """The files of a bag; every method that writes raises OSError and may be called again."""

    def __init__(
        self,
        directory: Path,
        storage: Storage,
        configuration: str,
        topics: Mapping[str, RecordedTopic],
        ros_distro: str,
    ) -> None:
        self.current: BagSplit | None = None
        self.started = 0
        self._directory = directory
        self._storage = storage
        self._configuration = configuration
        self._topics = topics
        self._ros_distro = ros_distro
        self._finished: list[FileContents] = []
        self._reserve = Reserve(directory)

    def counter_rows(self) -> dict[str, TopicCounters]:
        """Return the counters by topic."""
        return {name: topic.counters for name, topic in self._topics.items()}

    def waiting(self) -> Counter[str]:
        """Return how many messages of each topic the operating system has refused so far."""
        held = self.current is not None and self.current.file.pending
        return self.current.uncommitted if self.current is not None and held else Counter()

    def open_next(self) -> None:
        """Start a file, whole or not at all."""
        path = self._directory / f"{self._directory.name}_{self.started}.mcap"
        latched = {name: topic.latched.sequence for name, topic in self._topics.items() if topic.latched}
        split = BagSplit(path, self._storage, self._configuration, self.started, latched if self.started else {})
        try:
            for name, topic in self._topics.items():
                split.add_topic(name, topic.schema, topic.qos_yaml)
            split.file.commit()
            self.current = split
            self._hold_reserve()
        except OSError:
            self.current = None
            split.file.close()
            path.unlink(missing_ok=True)
            self._reserve.release()
            raise
        self.started += 1

    def announce(self, topic: str) -> None:
        """Register a topic in the file in progress, if there is one; the chunk in progress stays open."""
        if self.current is not None:
            entry = self._topics[topic]
            self.current.add_topic(topic, entry.schema, entry.qos_yaml)
            self.current.file.commit()

    def commit(self) -> None:
        """Close the chunk in progress and hand it to the operating system."""
        if self.current is not None:
            self.current.commit(self.counter_rows())
            self._hold_reserve()

    def finish_current(self) -> None:
        """Complete the file in progress, if there is one."""
        if self.current is not None:
            self.current.finish(self.counter_rows())
            self._finished.append(self.current.contents)
            self.current = None

    def release_reserve(self) -> None:
        """Give up the space held back."""
        self._reserve.release()

    def write_contents(self, finished: bool) -> None:
        """Describe the finished files; ``finished`` says whether any more will come."""
        topics = [
            TopicContents(name, topic.schema.type_name, topic.qos_yaml, topic.schema.type_hash)
            for name, topic in self._topics.items()
        ]
        counters = json.dumps({name: asdict(row) for name, row in self.counter_rows().items()})
        custom = {FINISHED_KEY: str(finished).lower(), COUNTERS_KEY: counters}
        write_contents(self._directory, topics, self._finished, custom, self._ros_distro)

    def _hold_reserve(self) -> None:
        assert self.current is not None
        needed = _RESERVE_BYTES + self._storage.chunk_bytes + len(self._configuration) + self.current.summary_bytes
        self._reserve.hold(1 << (needed - 1).bit_length())


def fresh_directory(wanted: Path, if_exists: str) -> tuple[Path, list[Path]]:
    """Return an empty directory and those that had to be made for it, innermost first.

    Raises
    ------
    BagExistsError, UnwritableDirectoryError
        Nothing is left behind.
    """
    directory, number = wanted.absolute(), 1
    while _occupied(directory):
        if if_exists != "rename":
            raise BagExistsError(directory, "holds files already; nothing is overwritten, choose another directory")
        number += 1
        directory = wanted.absolute().with_name(f"{wanted.name}_{number}")
    made: list[Path] = []
    try:
        missing = [path for path in (directory, *directory.parents) if not path.exists()]
        for path in reversed(missing):
            path.mkdir()
            made.insert(0, path)
    except OSError as error:
        for path in made:
            path.rmdir()
        raise UnwritableDirectoryError(directory, f"cannot be made ({error.strerror})") from error
    return directory, made


def _occupied(directory: Path) -> bool:
    try:
        return directory.exists() and (not directory.is_dir() or any(directory.iterdir()))
    except OSError as error:
        raise UnwritableDirectoryError(directory, f"cannot be looked into ({error.strerror})") from error
