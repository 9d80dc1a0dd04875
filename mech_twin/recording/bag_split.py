# SPDX-License-Identifier: Apache-2.0
"""Splits of a recording, each a complete MCAP file that can be opened on its own, and their ``metadata.yaml``.

| record     | what                | holds                                                                            |
|------------|---------------------|----------------------------------------------------------------------------------|
| attachment | configuration.yaml  | checksummed                                                                      |
| metadata   | mech_twin.split     | its index, and the latched messages it repeats                                   |
| metadata   | mech_twin.topic     | for each topic: a second copy of its schema and channel; not in the summary      |
| chunk      |                     | messages, before them new schemas and channels; compressed, checksummed, indexed |
| metadata   | mech_twin.counters  | after each chunk: the counters of every topic; the summary lists the last        |
| summary    |                     | schemas, channels, statistics and indexes; checksummed                           |

The `mcap` writer gets a faster path for messages and a smaller index of an open file.  A message record is packed in
one call instead of field by field.  The summary of a chunk is kept as its final bytes, a seventh of the memory of the
objects; this index is the only memory that grows with an open file.

The output is byte for byte that of `mcap.writer.Writer`, as a test checks.  Both use private members of that class;
with a release of `mcap` that lacks them, its own methods are used.
"""

from __future__ import annotations

import json
import os
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, MessageIndex, Metadata
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from mech_twin.files.output_file import FILE_MODE, NEW_FILE
from mech_twin.recording.bag_metadata import RESERVATION_NAME, FileStatistics
from mech_twin.recording.schemas import MessageSchema

_HEAD = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_FIXED_BYTES = 22  # content of a message record before the payload
_CHUNK_INDEX_BYTES = 64  # content of a chunk index without channel offsets and compression name
_INDEXES = "_Writer__chunk_indices"
CONFIGURATION_NAME = "configuration.yaml"
SPLIT_RECORD = "mech_twin.split"
TOPIC_RECORD = "mech_twin.topic"
COUNTERS_RECORD = "mech_twin.counters"
LIBRARY = "mech_twin"
COMPRESSIONS = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}
_RESERVED_BYTES = 64 * 1024


class _PackedIndex(MessageIndex):
    """A message index whose entries are packed at once."""

    def write(self, stream: RecordBuilder) -> None:
        stream.start_record(Opcode.MESSAGE_INDEX)
        stream.write2(self.channel_id)
        stream.write4(16 * len(self.records))
        stream.write(struct.pack(f"<{2 * len(self.records)}Q", *chain.from_iterable(self.records)))
        stream.finish_record()


class _PackedChunkIndexes:
    """The chunk indexes of a file as packed records; replaces the writer's list of objects."""

    def __init__(self) -> None:
        self._records = bytearray()

    def append(self, index: ChunkIndex) -> None:
        """Add the record of a chunk."""
        offsets = index.message_index_offsets
        compression = index.compression.encode()
        self._records += struct.pack(
            f"<BQQQQQI{'HQ' * len(offsets)}QI{len(compression)}sQQ",
            Opcode.CHUNK_INDEX,
            _CHUNK_INDEX_BYTES + 10 * len(offsets) + len(compression),
            index.message_start_time,
            index.message_end_time,
            index.chunk_start_offset,
            index.chunk_length,
            10 * len(offsets),
            *chain.from_iterable(offsets.items()),
            index.message_index_length,
            len(compression),
            compression,
            index.compressed_size,
            index.uncompressed_size,
        )

    def __iter__(self) -> Iterator[_PackedChunkIndexes]:
        """Yield this object once: it writes all records together."""
        yield self

    def write(self, stream: RecordBuilder) -> None:
        """Write the records in the order of the chunks."""
        stream.write(self._records)


class MessageWriter(Writer):
    """Writer of one MCAP file with chunks and checksums.

    Parameters
    ----------
    chunk_bytes : int
        Uncompressed size at which a chunk is closed.
    compression : CompressionType
        Compression of the chunks.
    enable_data_crcs : bool
        Whether the data section has a checksum of its own.
    """

    def __init__(
        self, output: IO[bytes], chunk_bytes: int, compression: CompressionType, *, enable_data_crcs: bool = False
    ) -> None:
        super().__init__(
            output, chunk_size=chunk_bytes, compression=compression, enable_crcs=True, enable_data_crcs=enable_data_crcs
        )
        self._chunk_bytes = chunk_bytes
        self._chunk: Any = getattr(self, "_Writer__chunk_builder", None)
        self._statistics: Any = getattr(self, "_Writer__statistics", None)
        if getattr(self, _INDEXES, None) == []:
            setattr(self, _INDEXES, _PackedChunkIndexes())

    def flush(self) -> None:
        """Close the current chunk and write it to the output."""
        super().flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the summary; the output stays open."""
        super().finish()  # type: ignore[no-untyped-call]

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """Add a message to the current chunk; see `mcap.writer.Writer.add_message`."""
        chunk, statistics = self._chunk, self._statistics
        if chunk is None or statistics is None:
            super().add_message(channel_id, log_time, data, publish_time, sequence)
            return
        records = chunk.record_writer
        offset = records.count
        length = _FIXED_BYTES + len(data)
        records.write(_HEAD.pack(Opcode.MESSAGE, length, channel_id, sequence, log_time, publish_time) + data)
        index = chunk.message_indices.get(channel_id)
        if index is None:
            index = chunk.message_indices[channel_id] = _PackedIndex(channel_id=channel_id, records=[])
        index.records.append((log_time, offset))
        if chunk.num_messages == 0 or log_time < chunk.message_start_time:
            chunk.message_start_time = log_time
        chunk.message_end_time = max(chunk.message_end_time, log_time)
        if statistics.message_count == 0 or log_time < statistics.message_start_time:
            statistics.message_start_time = log_time
        statistics.message_end_time = max(statistics.message_end_time, log_time)
        chunk.num_messages += 1
        statistics.message_count += 1
        statistics.channel_message_counts[channel_id] += 1
        if offset + 9 + length > self._chunk_bytes:
            self.flush()


class SplitFile:
    """The output stream of an MCAP writer: buffered in memory, and written by `commit`, completely or not at all.

    A full disk never leaves a partial record: what was written stays valid, and the rest waits for the next attempt.
    """

    def __init__(self, path: Path, fsync: bool) -> None:
        self.path = path
        self.committed_bytes = 0
        self._fsync = fsync
        self._buffered = bytearray()
        self._descriptor = os.open(path, NEW_FILE, FILE_MODE)

    @property
    def pending(self) -> bool:
        """Whether there are buffered bytes."""
        return bool(self._buffered)

    def write(self, data: bytes) -> int:
        """Buffer bytes."""
        self._buffered += data
        return len(data)

    def tell(self) -> int:
        """Return the offset of the next byte."""
        return self.committed_bytes + len(self._buffered)

    def flush(self) -> None:
        """Do nothing: only `commit` writes."""

    def commit(self) -> None:
        """Write everything buffered, or leave the file as it was.

        Raises
        ------
        OSError
            The disk is full or failing; the bytes stay buffered and the file keeps its previous length.
        """
        data, done = memoryview(bytes(self._buffered)), 0
        try:
            while done < len(data):
                done += os.pwrite(self._descriptor, data[done:], self.committed_bytes + done)
            if self._fsync:
                os.fdatasync(self._descriptor)
        except OSError:
            os.ftruncate(self._descriptor, self.committed_bytes)
            raise
        self.committed_bytes += done
        self._buffered.clear()

    def close(self) -> None:
        """Close the file; idempotent."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class SpaceReservation:
    """Disk space reserved for closing the recording when the disk is full."""

    def __init__(self, directory: Path) -> None:
        self._path = directory / RESERVATION_NAME
        self._reserved_bytes = 0

    def reserve(self, size: int) -> None:
        """Reserve at least `size` bytes; a no-op if they are reserved already."""
        if size <= self._reserved_bytes:
            return
        exists = self._reserved_bytes > 0
        descriptor = os.open(self._path, NEW_FILE & ~(os.O_CREAT | os.O_EXCL) if exists else NEW_FILE, 0o600)
        try:
            os.posix_fallocate(descriptor, 0, size)
        finally:
            os.close(descriptor)
        self._reserved_bytes = size

    def release(self) -> None:
        """Release the space; idempotent."""
        self._path.unlink(missing_ok=True)
        self._reserved_bytes = 0


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


class BagSplit:
    """Writer of one file of a bag; only `commit` and `finish` raise OSError."""

    def __init__(
        self,
        path: Path,
        index: int,
        repeated: Mapping[str, int],
        *,
        configuration: str,
        chunk_bytes: int,
        compression: str,
        fsync: bool,
    ) -> None:
        self.statistics = FileStatistics(path.name)
        self.file = SplitFile(path, fsync)
        self.chunks = 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._finished = False
        self._unwritten_bytes = _RESERVED_BYTES + chunk_bytes + len(configuration)
        self._committed: Counter[str] = Counter()
        self._writer = MessageWriter(
            self.file,  # type: ignore[arg-type]
            chunk_bytes,
            COMPRESSIONS[compression],
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
    def closing_bytes(self) -> int:
        """Upper estimate of the bytes that closing the file writes: the indexes grow with every chunk."""
        summary = (self.chunks + 1) * (160 + 10 * len(self._channels)) + 8192 * (len(self._channels) + 1)
        return self._unwritten_bytes + summary

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


FINISHED_KEY = "mech_twin.finished"
COUNTERS_KEY = "mech_twin.counters"
RECOVERED_KEY = "mech_twin.recovered"


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
