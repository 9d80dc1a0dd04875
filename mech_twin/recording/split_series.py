# SPDX-License-Identifier: Apache-2.0
"""The consecutive splits of a recording, and the `metadata.yaml` that lists the finished ones."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from mech_twin.recording.bag_metadata import FileStatistics, TopicMetadata, write_metadata
from mech_twin.recording.bag_split import BagSplit, Storage, TopicCounters
from mech_twin.recording.schemas import MessageSchema
from mech_twin.recording.split_file import SpaceReservation

FINISHED_KEY = "mech_twin.finished"
COUNTERS_KEY = "mech_twin.counters"
RECOVERED_KEY = "mech_twin.recovered"
_RESERVE_BYTES = 64 * 1024


class Latched(NamedTuple):
    """The last message of a latched topic."""

    raw: bytes
    publish_time_ns: int
    sequence: int


@dataclass
class RecordedTopic:
    """A topic with its counters and the latched message to repeat in a new split."""

    schema: MessageSchema
    qos_yaml: str
    counters: TopicCounters = field(default_factory=TopicCounters)
    latched: Latched | None = None


class SplitSeries:
    """The files of a bag; methods that write raise OSError and may be called again."""

    def __init__(
        self, directory: Path, storage: Storage, configuration: str, topics: Mapping[str, RecordedTopic]
    ) -> None:
        self.current: BagSplit | None = None
        self.started = 0
        self._directory = directory
        self._storage = storage
        self._configuration = configuration
        self._topics = topics
        self._finished: list[FileStatistics] = []
        self._reservation = SpaceReservation(directory)

    def counter_rows(self) -> dict[str, TopicCounters]:
        """Return the counters by topic."""
        return {name: topic.counters for name, topic in self._topics.items()}

    def waiting(self) -> Counter[str]:
        """Return the number of messages by topic that are buffered because the disk did not accept them."""
        pending = self.current is not None and self.current.file.pending
        return self.current.uncommitted if self.current is not None and pending else Counter()

    def open_next(self) -> None:
        """Start a file; it is deleted if that fails."""
        path = self._directory / f"{self._directory.name}_{self.started}.mcap"
        latched = {name: topic.latched.sequence for name, topic in self._topics.items() if topic.latched}
        split = BagSplit(path, self._storage, self._configuration, self.started, latched if self.started else {})
        try:
            for name, topic in self._topics.items():
                split.add_topic(name, topic.schema, topic.qos_yaml)
            split.file.commit()
            self.current = split
            self._reserve_space()
        except OSError:
            self.current = None
            split.file.close()
            path.unlink(missing_ok=True)
            self._reservation.release()
            raise
        self.started += 1

    def announce(self, topic: str) -> None:
        """Register a topic in the current file, if there is one; the current chunk stays open."""
        if self.current is not None:
            entry = self._topics[topic]
            self.current.add_topic(topic, entry.schema, entry.qos_yaml)
            self.current.file.commit()

    def commit(self) -> None:
        """Close the current chunk and write it to the file."""
        if self.current is not None:
            self.current.commit(self.counter_rows())
            self._reserve_space()

    def finish_current(self) -> None:
        """Finish the current file, if there is one."""
        if self.current is not None:
            self.current.finish(self.counter_rows())
            self._finished.append(self.current.statistics)
            self.current = None

    def release_reservation(self) -> None:
        """Release the reserved disk space."""
        self._reservation.release()

    def write_metadata(self, finished: bool) -> None:
        """Write `metadata.yaml` for the finished files; ``finished`` is False while more may follow."""
        topics = [
            TopicMetadata(name, topic.schema.type_name, topic.qos_yaml, topic.schema.type_hash)
            for name, topic in self._topics.items()
        ]
        waiting = self.waiting()
        rows = {
            name: replace(row, written=row.written - waiting[name], dropped=row.dropped + waiting[name])
            for name, row in self.counter_rows().items()
        }
        counters = json.dumps({name: asdict(row) for name, row in rows.items()})
        custom = {FINISHED_KEY: str(finished).lower(), COUNTERS_KEY: counters}
        write_metadata(self._directory, topics, self._finished, custom)

    def discard(self) -> None:
        """Delete the files of the recording, for a run that recorded nothing."""
        self._reservation.release()
        if self.current is not None:
            self.current.file.close()
            self.current.file.path.unlink(missing_ok=True)
            self.current = None

    def _reserve_space(self) -> None:
        assert self.current is not None
        needed = _RESERVE_BYTES + self._storage.chunk_bytes + len(self._configuration) + self.current.summary_bytes
        self._reservation.reserve(1 << (needed - 1).bit_length())
