# SPDX-License-Identifier: Apache-2.0
"""One split of a recording: a complete MCAP file that can be opened on its own.

| record     | what                | holds                                                                            |
|------------|---------------------|----------------------------------------------------------------------------------|
| attachment | configuration.yaml  | checksummed                                                                      |
| metadata   | mech_twin.split     | its index, and the latched messages it repeats                                   |
| metadata   | mech_twin.topic     | for each topic: a second copy of its schema and channel; not in the summary      |
| chunk      |                     | messages, before them new schemas and channels; compressed, checksummed, indexed |
| metadata   | mech_twin.counters  | after each chunk: the counters of every topic; the summary lists the last        |
| summary    |                     | schemas, channels, statistics and indexes; checksummed                           |
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.records import Metadata
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType

from mech_twin.recording.bag_metadata import FileStatistics
from mech_twin.recording.message_writer import MessageWriter
from mech_twin.recording.schemas import MessageSchema
from mech_twin.recording.split_file import SplitFile

CONFIGURATION_NAME = "configuration.yaml"
SPLIT_RECORD = "mech_twin.split"
TOPIC_RECORD = "mech_twin.topic"
COUNTERS_RECORD = "mech_twin.counters"
LIBRARY = "mech_twin"
COMPRESSIONS = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}


@dataclass
class TopicCounters:
    """Loss counters of a topic.

    Attributes
    ----------
    received : int
        Passed to the writer.
    written : int
        Of these, written to the bag.
    dropped : int
        Of these, lost because the disk was full or failing.
    missed : int
        Published but never received: gaps in the sequence of the publisher.
    late : int
        Received after a later one.
    publishers : int
        Largest number of simultaneous publishers of the topic, if the recorder follows one of them.
    """

    received: int = 0
    written: int = 0
    dropped: int = 0
    missed: int = 0
    late: int = 0
    publishers: int = 0


@dataclass(frozen=True)
class Storage:
    """Chunk size, compression and fsync of a file."""

    chunk_bytes: int
    compression: str
    fsync: bool

    def __post_init__(self) -> None:
        """Validate the values."""
        if self.chunk_bytes <= 0 or self.compression not in COMPRESSIONS:
            raise ValueError(
                f"expected chunk_bytes > 0 and compression one of {', '.join(COMPRESSIONS)}; "
                f"got {self.chunk_bytes}, '{self.compression}'"
            )


@dataclass(frozen=True)
class SplitRule:
    """When to start a new file: at a size, or after a duration of log time; None means never."""

    size_bytes: int | None
    duration_s: float | None

    def due(self, split: BagSplit | None, log_time_ns: int) -> bool:
        """Whether a message of this log time belongs in a new file."""
        if split is None or split.statistics.start_ns is None:
            return False
        if self.size_bytes is not None and split.size_bytes >= self.size_bytes:
            return True
        return self.duration_s is not None and log_time_ns - split.statistics.start_ns >= self.duration_s * 1e9


class BagSplit:
    """Writer of one file of a bag; only `commit` and `finish` raise OSError."""

    def __init__(
        self, path: Path, storage: Storage, configuration: str, index: int, repeated: Mapping[str, int]
    ) -> None:
        self.statistics = FileStatistics(path.name)
        self.file = SplitFile(path, storage.fsync)
        self.chunks = 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._finished = False
        self._committed: Counter[str] = Counter()
        self._writer = MessageWriter(
            self.file,  # type: ignore[arg-type]
            storage.chunk_bytes,
            COMPRESSIONS[storage.compression],
        )
        self._writer.start(profile="ros2", library=LIBRARY)
        self._writer.add_attachment(0, 0, CONFIGURATION_NAME, "application/yaml", configuration.encode())
        self._writer.add_metadata(SPLIT_RECORD, {"index": str(index), "repeated": json.dumps(repeated)})

    @property
    def uncommitted(self) -> Counter[str]:
        """Messages by topic that are not yet in the file."""
        return self.statistics.counts - self._committed

    @property
    def size_bytes(self) -> int:
        """Bytes written so far."""
        return self.file.tell()

    @property
    def summary_bytes(self) -> int:
        """Upper estimate of the bytes that closing the file writes: the indexes grow with every chunk."""
        return (self.chunks + 1) * (160 + 10 * len(self._channels)) + 8192 * (len(self._channels) + 1)

    def add_topic(self, topic: str, schema: MessageSchema, qos_yaml: str) -> None:
        """Register a topic."""
        if schema.type_name not in self._schemas:
            self._schemas[schema.type_name] = self._writer.register_schema(
                schema.type_name, SchemaEncoding.ROS2, schema.definition.encode()
            )
        about = {"offered_qos_profiles": qos_yaml, "topic_type_hash": schema.type_hash}
        channel = self._writer.register_channel(
            topic, MessageEncoding.CDR, self._schemas[schema.type_name], dict(about)
        )
        self._channels[topic] = channel
        about |= {"id": str(channel), "topic": topic, "type": schema.type_name, "definition": schema.definition}
        self._append(TOPIC_RECORD, about)

    def add_message(self, topic: str, raw: bytes, log_time_ns: int, publish_time_ns: int, sequence: int) -> bool:
        """Add a message; return whether it completed a chunk, which then waits for `commit`."""
        self._writer.add_message(self._channels[topic], log_time_ns, raw, publish_time_ns, sequence & 0xFFFFFFFF)
        self.statistics.count(topic, log_time_ns)
        return self.file.pending

    def commit(self, counters: Mapping[str, TopicCounters]) -> None:
        """Close the current chunk and write it, with the current counters, to the file."""
        if not self._finished:
            self._writer.flush()
            self._append(COUNTERS_RECORD, _rows(counters))
            self.chunks += 1
        self.file.commit()
        self._committed = self.statistics.counts.copy()

    def finish(self, counters: Mapping[str, TopicCounters]) -> None:
        """Write the summary and close the file; may be called again after an OSError."""
        if not self._finished:
            self._writer.flush()
            self._writer.add_metadata(COUNTERS_RECORD, _rows(counters))
            self._writer.finish()
            self._finished = True
        self.file.commit()
        self._committed = self.statistics.counts.copy()
        self.file.close()

    def _append(self, name: str, data: dict[str, str]) -> None:
        """Write a metadata record that the summary does not index; only a linear scan finds it.

        The summary then indexes one record of each name, so it does not grow with every chunk and readers that list
        metadata list each name once.
        """
        builder = RecordBuilder()
        Metadata(name=name, metadata=data).write(builder)
        self.file.write(builder.end())


def _rows(counters: Mapping[str, TopicCounters]) -> dict[str, str]:
    return {topic: json.dumps(vars(row)) for topic, row in counters.items()}
