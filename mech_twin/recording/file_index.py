# SPDX-License-Identifier: Apache-2.0
"""Index of one MCAP file: where its chunks, attachments and metadata are.

It is read from the summary section.  A linear scan builds the index of a damaged or truncated file.
"""

import json
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from mech_twin.files.input_file import TABLE_SUFFIXES
from mech_twin.recording.bag_split import CONFIGURATION_NAME, COUNTERS_RECORD, SPLIT_RECORD, TOPIC_RECORD
from mech_twin.recording.errors import DamagedBagError, ForeignFileError, UnfinishedBagError
from mech_twin.recording.record_file import (
    FOOTER_BYTES,
    HEAD_BYTES,
    MAGIC,
    MAX_CHUNK_BYTES,
    MAX_RECORD_BYTES,
    Damage,
    LocatedRecord,
    RawMessage,
    Record,
    RecordFile,
    UnreadableRecordError,
    decompressed,
    inner_records,
)

_MAX_PROBLEMS = 50
MAX_CONFIGURATION_BYTES = 1 << 20
MAX_CHANNELS = 10_000
_RUN_BYTES = 256 * 1024
# bound on the decompressed bytes of all chunks of a file: this plus this many times the file size; each record counts
# as RECORD_BYTES in addition, since an empty message takes time and memory too
SCAN_BYTES = 1 << 30
MOST_EXPANSION = 200
RECORD_BYTES = 256


NO_SCHEMA = Schema(id=0, data=b"", encoding="", name="")


class Extent(NamedTuple):
    """A byte range of messages: one chunk, or consecutive messages outside chunks."""

    offset: int
    length: int
    start_ns: int
    end_ns: int
    size_bytes: int
    channels: frozenset[int]


@dataclass
class FileIndex:
    """Schemas, channels and positions of the records of one file."""

    file: RecordFile
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    extents: list[Extent] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    attachments: list[int] = field(default_factory=list)
    metadata: dict[str, int] = field(default_factory=dict)
    damages: list[Damage] = field(default_factory=list)
    repeats: dict[int, int] = field(default_factory=dict)  # channel -> sequence number of the message to skip
    finished: bool = True

    def records_of(self, extent: Extent) -> Iterator[RawMessage]:
        """Yield the messages of an extent.

        Raises
        ------
        DamagedBagError
            The records do not match the index.
        """
        try:
            for record in _contents(self.file, extent):
                if isinstance(record, RawMessage):
                    yield record
        except UnreadableRecordError as error:
            raise DamagedBagError(self.file.path, f"at byte {extent.offset}: {error}") from error

    def schema_of(self, channel: Channel) -> Schema:
        """Return the schema of a channel; an empty one if it has none."""
        return self.schemas.get(channel.schema_id, NO_SCHEMA)

    def problems(self) -> list[str]:
        """Return the damage of the file, one line each; the first fifty."""
        lines = [] if self.finished else [f"{self.file.path}: has no footer, it was truncated"]
        lines += [
            f"{self.file.path}: {damage.length} bytes at {damage.offset}: {damage.reason}"
            for damage in self.damages[:_MAX_PROBLEMS]
        ]
        return lines

    def metadata_record(self, name: str) -> dict[str, str]:
        """Return the last metadata record of this name; empty if there is none."""
        if name not in self.metadata:
            return {}
        record = self._record(self.metadata[name], f"metadata '{name}'")
        return record.metadata if isinstance(record, Metadata) else {}

    def attachment_records(self) -> Iterator[Attachment]:
        """Yield the attachments."""
        for offset in self.attachments:
            record = self._record(offset, f"attachment at byte {offset}")
            if isinstance(record, Attachment):
                yield record

    def _record(self, offset: int, what: str) -> Record:
        try:
            return self.file.record_at(offset).record
        except UnreadableRecordError as error:
            raise DamagedBagError(self.file.path, f"{what}: {error}") from error

    def configuration(self) -> str | None:
        """Return the configuration attached to the file."""
        for attachment in self.attachment_records():
            if attachment.name == CONFIGURATION_NAME:
                if len(attachment.data) > MAX_CONFIGURATION_BYTES:
                    raise ForeignFileError(
                        self.file.path,
                        f"its configuration has {len(attachment.data)} bytes, more than {MAX_CONFIGURATION_BYTES}",
                    )
                return attachment.data.decode("utf-8", "replace")
        return None

    def split_number(self) -> int:
        """Return the number of the file in its bag; 0 for the first file, or if unknown."""
        number = self.metadata_record(SPLIT_RECORD).get("index", "0")
        return int(number) if number.isascii() and number.isdigit() and len(number) < 10 else 0

    def repeated(self) -> dict[str, int]:
        """Return the sequence number of the latched message repeated from earlier splits, by topic."""
        return {
            key: value
            for key, value in parsed_mapping(self.metadata_record(SPLIT_RECORD).get("repeated", "{}")).items()
            if isinstance(value, int)
        }

    def counters(self) -> dict[str, dict[str, int]]:
        """Return the loss counters by topic, as of the last chunk."""
        rows = {topic: parsed_mapping(text) for topic, text in self.metadata_record(COUNTERS_RECORD).items()}
        return counter_rows(rows)


def counter_rows(rows: Mapping[str, object]) -> dict[str, dict[str, int]]:
    """Return loss counters by topic, without values that are not integers."""
    return {
        topic: {key: value for key, value in row.items() if isinstance(value, int)}
        for topic, row in rows.items()
        if isinstance(row, dict)
    }


def parsed_mapping(text: str) -> dict[str, object]:
    """Return a JSON object; empty if the text is not one."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}


def _contents(file: RecordFile, extent: Extent) -> Iterator[Record]:
    offset = extent.offset
    while offset < extent.offset + extent.length:
        found = file.record_at(offset)
        if isinstance(found.record, Chunk):
            yield from inner_records(decompressed(found.record))
        else:
            yield found.record
        offset += found.length


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
        self._loose = FileIndex(index.file)  # the messages outside chunks
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
        index = self._loose
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
        """Add what no intact chunk contains: loose messages, and schemas and channels of summary and backups."""
        index = self._index
        self._add_loose_messages()
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

    def _add_loose_messages(self) -> None:
        """Add the messages outside chunks, unless the file has chunks: one is a record of another kind then.

        A message has no checksum, and one flipped bit makes a message of a channel, an index or the header.  Writers
        put all messages of a file in chunks, or none.
        """
        index = self._index
        if index.extents:
            reason = "a message outside the chunks"
            index.damages += [Damage(extent.offset, extent.length, reason) for extent in self._loose.extents]
            index.damages.sort()
        else:
            index.extents, index.counts = self._loose.extents, self._loose.counts

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


_MESSAGE_INDEX = struct.Struct("<HI")  # channel, size of the entries
_ENTRY_BYTES = 16


def summary_index(file: RecordFile) -> FileIndex:
    """Return the index from the summary section; if the file has none, from a linear scan.

    Raises
    ------
    ForeignFileError, UnfinishedBagError, DamagedBagError
    """
    path = file.path
    try:
        head = file.bytes_at(0, len(MAGIC))
        if head != MAGIC:
            table = path.suffix.lower() in TABLE_SUFFIXES
            found = "is a table, no MCAP recording" if table else "is not an MCAP recording (wrong magic bytes)"
            found += "" if table or path.suffix == ".mcap" else ", nor a table of text or Parquet"
            raise ForeignFileError(path, found if head else "is empty")
        footer_at = file.size - FOOTER_BYTES - len(MAGIC)
        if footer_at < len(MAGIC) or file.bytes_at(file.size - len(MAGIC), len(MAGIC)) != MAGIC:
            raise UnfinishedBagError(path, "has no footer, it was truncated")
        footer = file.record_at(footer_at).record
        if not isinstance(footer, Footer):
            raise DamagedBagError(path, "has no footer")
        records = _summary_records(file, footer, footer_at)
    except UnreadableRecordError as error:
        raise DamagedBagError(path, f"its summary is damaged ({error})") from error
    index = _from_summary(file, records)
    if index is not None:
        try:
            _check_against_data(index, footer)
        except (UnreadableRecordError, struct.error) as error:
            raise DamagedBagError(path, f"its data do not match its summary ({error})") from error
    else:
        index = scanned_index(file)
        if index.damages:
            damage = index.damages[0]
            raise DamagedBagError(path, f"at byte {damage.offset}: {damage.reason}")
    return index


def _summary_records(file: RecordFile, footer: Footer, footer_at: int) -> list[Record]:
    if footer.summary_start == 0:
        return []
    if not len(MAGIC) <= footer.summary_start <= footer_at or footer_at - footer.summary_start > MAX_RECORD_BYTES:
        raise UnreadableRecordError("it lies outside the file")
    data = file.bytes_at(footer.summary_start, footer_at + FOOTER_BYTES - footer.summary_start)
    if footer.summary_crc and zlib.crc32(data[:-4]) != footer.summary_crc:
        raise UnreadableRecordError("its checksum fails")
    return list(inner_records(data[:-FOOTER_BYTES], "summary"))


def _from_summary(file: RecordFile, records: list[Record]) -> FileIndex | None:
    index = FileIndex(file)
    statistics = None
    for record in records:
        if isinstance(record, Schema):
            index.schemas[record.id] = record
        elif isinstance(record, Channel):
            index.channels[record.id] = record
        elif isinstance(record, ChunkIndex):
            index.extents.append(_chunk_extent(file, record))
        elif isinstance(record, AttachmentIndex):
            index.attachments.append(record.offset)
        elif isinstance(record, MetadataIndex):
            index.metadata[record.name] = record.offset
        elif isinstance(record, Statistics):
            statistics = record
            index.counts.update(record.channel_message_counts)
    unlisted = index.counts.keys() - index.channels.keys()
    untyped = {channel.schema_id for channel in index.channels.values()} - {0, *index.schemas}
    if statistics is None or unlisted or untyped or (statistics.message_count and not index.extents):
        return None
    return index


def _chunk_extent(file: RecordFile, record: ChunkIndex) -> Extent:
    if record.chunk_start_offset + record.chunk_length > file.size:
        raise DamagedBagError(file.path, "its summary names a chunk beyond its end")
    return Extent(
        record.chunk_start_offset,
        record.chunk_length,
        record.message_start_time,
        record.message_end_time,
        record.uncompressed_size,
        frozenset(record.message_index_offsets),
    )


def _check_against_data(index: FileIndex, footer: Footer) -> None:
    """Compare chunks and message counts in the summary with the heads of the records in the data section."""
    file, path = index.file, index.file.path
    indexed = {extent.offset: extent for extent in index.extents}
    if len(indexed) != len(index.extents):
        raise DamagedBagError(path, "its summary names a chunk twice")
    counted: Counter[int] = Counter()
    offset = len(MAGIC)
    while offset < footer.summary_start:
        opcode, length = file.head_at(offset)
        if opcode == Opcode.CHUNK:
            extent = indexed.pop(offset, None)
            if extent is None:
                raise DamagedBagError(path, f"its summary leaves out the chunk at byte {offset}")
            _check_chunk(file, extent, HEAD_BYTES + length)
        elif opcode == Opcode.MESSAGE:
            raise DamagedBagError(path, f"its summary leaves out the message at byte {offset}")
        elif opcode == Opcode.MESSAGE_INDEX:
            head = file.bytes_at(offset + HEAD_BYTES, _MESSAGE_INDEX.size)
            if length >= _MESSAGE_INDEX.size:
                channel, size = _MESSAGE_INDEX.unpack(head)
                counted[channel] += size // _ENTRY_BYTES
        elif opcode == Opcode.DATA_END:
            break
        offset += HEAD_BYTES + length
    if indexed:
        raise DamagedBagError(path, f"its summary names a chunk at byte {min(indexed)}, where there is none")
    if counted and counted != +index.counts:
        raise DamagedBagError(
            path, f"its summary counts {index.counts.total()} messages, the indexes of its chunks {counted.total()}"
        )


def _check_chunk(file: RecordFile, extent: Extent, length: int) -> None:
    start_ns, end_ns, size = struct.unpack("<QQQ", file.bytes_at(extent.offset + HEAD_BYTES, 24))
    largest = max(size, extent.size_bytes)
    if largest > MAX_CHUNK_BYTES:
        raise DamagedBagError(file.path, f"has a chunk of {largest} bytes, more than {MAX_CHUNK_BYTES}")
    if (length, start_ns, end_ns, size) != (extent.length, extent.start_ns, extent.end_ns, extent.size_bytes):
        raise DamagedBagError(file.path, f"its summary contradicts the chunk at byte {extent.offset}")
