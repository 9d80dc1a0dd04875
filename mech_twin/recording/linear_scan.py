# SPDX-License-Identifier: Apache-2.0
"""Index of an MCAP file built by a linear scan, which works on damaged and truncated files."""

from __future__ import annotations

from collections import Counter

from mcap.records import Attachment, Channel, Chunk, Footer, Metadata, Schema

from mech_twin.recording.bag_split import TOPIC_RECORD
from mech_twin.recording.file_index import Extent, FileIndex
from mech_twin.recording.mcap_records import (
    MAGIC,
    MAX_CHUNK_BYTES,
    Damage,
    LocatedRecord,
    RawMessage,
    Record,
    UnreadableRecordError,
    decompressed,
    inner_records,
)
from mech_twin.recording.record_file import RecordFile

_RUN_BYTES = 256 * 1024
# bound on the decompressed bytes of all chunks of a file: this plus this many times the file size; each record counts
# as RECORD_BYTES in addition, since an empty message takes time and memory too
SCAN_BYTES = 1 << 30
MOST_EXPANSION = 200
RECORD_BYTES = 256


def scanned_index(file: RecordFile) -> FileIndex:
    """Return the index of every intact record and of the damage between them; no file content makes it raise."""
    index = FileIndex(file, finished=False)
    scan = _LinearScan(index)
    for found in file.scan(scan.accept):
        if isinstance(found, Damage):
            index.damages.append(found)
        else:
            scan.take(found)
    scan.complete()
    return index


class _LinearScan:
    """Builds an index record by record."""

    def __init__(self, index: FileIndex) -> None:
        self._index = index
        self._verified_chunk: tuple[int, list[Record]] = (-1, [])
        self._backups: list[dict[str, str]] = []
        self._outside: list[Schema | Channel] = []
        self._limit_bytes = SCAN_BYTES + MOST_EXPANSION * index.file.size
        self._taken_bytes = 0

    def accept(self, found: LocatedRecord) -> None:
        """Verify the content of a record: the records within a chunk must be intact too."""
        record = found.record
        if isinstance(record, Chunk):
            if self._verified_chunk[0] != found.offset:
                self._verified_chunk = (found.offset, self._contents(record))
        elif isinstance(record, Footer):
            end = found.offset + found.length
            if end != self._index.file.size - len(MAGIC):
                raise UnreadableRecordError("a footer before the end of the file")

    def _contents(self, chunk: Chunk) -> list[Record]:
        self._count(min(chunk.uncompressed_size, MAX_CHUNK_BYTES))  # counted first, even if the chunk is damaged
        inner = []
        for record in inner_records(decompressed(chunk)):
            self._count(RECORD_BYTES)
            inner.append(record)
        return inner

    def _count(self, size: int) -> None:
        if self._taken_bytes + size > self._limit_bytes:
            raise UnreadableRecordError(f"chunks that come to more than {self._limit_bytes} bytes together")
        self._taken_bytes += size

    def take(self, found: LocatedRecord) -> None:
        """Add a record to the index."""
        index, record = self._index, found.record
        if isinstance(record, Chunk):
            self._take_chunk(found, self._verified_chunk[1])
        elif isinstance(record, RawMessage):
            self._take_message(found, record)
        elif isinstance(record, (Schema, Channel)):
            self._outside.append(record)
        elif isinstance(record, Attachment):
            index.attachments.append(found.offset)
        elif isinstance(record, Metadata):
            index.metadata[record.name] = found.offset
            if record.name == TOPIC_RECORD:
                self._backups.append(record.metadata)
        elif isinstance(record, Footer):
            index.finished = True

    def _take_chunk(self, found: LocatedRecord, inner: list[Record]) -> None:
        index = self._index
        messages = [record for record in inner if isinstance(record, RawMessage)]
        for record in inner:
            if isinstance(record, Schema):
                index.schemas.setdefault(record.id, record)
            elif isinstance(record, Channel):
                index.channels.setdefault(record.id, record)
        if messages:
            times = [message.log_time_ns for message in messages]
            channels = Counter(message.channel_id for message in messages)
            index.counts.update(channels)
            size = sum(len(message.raw) for message in messages)
            index.extents.append(Extent(found.offset, found.length, min(times), max(times), size, frozenset(channels)))

    def _take_message(self, found: LocatedRecord, message: RawMessage) -> None:
        index = self._index
        index.counts[message.channel_id] += 1
        last = index.extents[-1] if index.extents else None
        time = message.log_time_ns
        if last is not None and last.offset + last.length == found.offset and last.length < _RUN_BYTES:
            index.extents[-1] = Extent(
                last.offset,
                last.length + found.length,
                min(last.start_ns, time),
                max(last.end_ns, time),
                last.size_bytes + found.length,
                last.channels | {message.channel_id},
            )
        else:
            one = frozenset((message.channel_id,))
            index.extents.append(Extent(found.offset, found.length, time, time, found.length, one))

    def complete(self) -> None:
        """Add schemas and channels that no intact chunk contains: from the summary, then from the backup records."""
        index = self._index
        for record in self._outside:
            table: dict[int, Schema] | dict[int, Channel] = (
                index.schemas if isinstance(record, Schema) else index.channels
            )
            table.setdefault(record.id, record)  # type: ignore[arg-type]
        for copy in self._backups:
            self._take_copy(copy)
        index.channels = {
            key: channel for key, channel in index.channels.items() if channel.schema_id in {0, *index.schemas}
        }

    def _take_copy(self, copy: dict[str, str]) -> None:
        index = self._index
        try:
            channel_id, topic, type_name = int(copy["id"]), copy["topic"], copy["type"]
            definition = copy["definition"]
        except (KeyError, ValueError):
            return
        known = index.channels.get(channel_id)
        if known is not None and known.schema_id in index.schemas:
            return
        about = {key: value for key, value in copy.items() if key in {"offered_qos_profiles", "topic_type_hash"}}
        schema_id = 1 + max((*index.schemas, *(channel.schema_id for channel in index.channels.values())), default=0)
        index.schemas[schema_id] = Schema(id=schema_id, data=definition.encode(), encoding="ros2msg", name=type_name)
        index.channels[channel_id] = Channel(
            id=channel_id, topic=topic, message_encoding="cdr", schema_id=schema_id, metadata=about
        )
