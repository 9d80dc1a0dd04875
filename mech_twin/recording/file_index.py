"""Where the messages of one MCAP file lie: read off its summary, or found by walking through it."""

from __future__ import annotations

import json
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

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

from mech_twin.recording.bag_split import CONFIGURATION_NAME, COUNTERS_RECORD, SPLIT_RECORD, TOPIC_RECORD
from mech_twin.recording.errors import DamagedBagError, ForeignFileError, UnfinishedBagError
from mech_twin.recording.mcap_records import (
    FOOTER_BYTES,
    HEAD_BYTES,
    MAGIC,
    MAX_RECORD_BYTES,
    Damage,
    Found,
    RawMessage,
    Record,
    RecordFile,
    UnreadableRecordError,
    inner_records,
    parse,
    unpacked,
)

_RUN_BYTES = 256 * 1024


class Extent(NamedTuple):
    """A chunk, or a run of messages outside chunks."""

    offset: int
    length: int
    start_ns: int
    end_ns: int
    size_bytes: int
    channels: frozenset[int]


@dataclass
class FileIndex:
    """What one file holds, and where."""

    file: RecordFile
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    extents: list[Extent] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    attachments: list[int] = field(default_factory=list)
    metadata: dict[str, int] = field(default_factory=dict)
    damages: list[Damage] = field(default_factory=list)
    finished: bool = True

    def records_of(self, extent: Extent) -> Iterator[RawMessage]:
        """Yield the messages of an extent.

        Raises
        ------
        DamagedBagError
            The bytes are not what the index says.
        """
        try:
            for record in _contents(self.file, extent):
                if isinstance(record, RawMessage):
                    yield record
        except UnreadableRecordError as error:
            raise DamagedBagError(self.file.path, f"at byte {extent.offset}: {error}") from error

    def metadata_record(self, name: str) -> dict[str, str]:
        """Return the last metadata record of this name, empty where there is none."""
        if name not in self.metadata:
            return {}
        try:
            record = self.file.record_at(self.metadata[name]).record
        except UnreadableRecordError as error:
            raise DamagedBagError(self.file.path, f"metadata '{name}': {error}") from error
        return record.metadata if isinstance(record, Metadata) else {}

    def attachment_records(self) -> Iterator[Attachment]:
        """Yield the attachments."""
        for offset in self.attachments:
            try:
                record = self.file.record_at(offset).record
            except UnreadableRecordError as error:
                raise DamagedBagError(self.file.path, f"attachment at byte {offset}: {error}") from error
            if isinstance(record, Attachment):
                yield record

    def configuration(self) -> str | None:
        """Return the configuration that the recording carries."""
        for attachment in self.attachment_records():
            if attachment.name == CONFIGURATION_NAME:
                return attachment.data.decode("utf-8", "replace")
        return None

    def repeated(self) -> dict[str, int]:
        """Return the sequence number of the latched message repeated from earlier splits, by topic."""
        return {
            key: value
            for key, value in _mapping(self.metadata_record(SPLIT_RECORD).get("repeated", "{}")).items()
            if isinstance(value, int)
        }

    def counters(self) -> dict[str, dict[str, int]]:
        """Return the loss counters by topic, as of the last chunk."""
        rows = {topic: _mapping(text) for topic, text in self.metadata_record(COUNTERS_RECORD).items()}
        return {
            topic: {key: value for key, value in row.items() if isinstance(value, int)} for topic, row in rows.items()
        }


def _mapping(text: str) -> dict[str, object]:
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
            yield from inner_records(unpacked(found.record))
        else:
            yield found.record
        offset += found.length


# From the summary ----------------------------------------------------------------------------------------------------


def summarised(file: RecordFile) -> FileIndex:
    """Return the index that the file's own summary gives; where it has none, the one found by walking through it.

    Raises
    ------
    ForeignFileError, UnfinishedBagError, DamagedBagError
    """
    path = file.path
    try:
        head = file.bytes_at(0, len(MAGIC))
        if head != MAGIC:
            raise ForeignFileError(
                path, "is empty" if not head else "is no MCAP recording (its first bytes are not MCAP's)"
            )
        footer_at = file.size - FOOTER_BYTES - len(MAGIC)
        if footer_at < len(MAGIC) or file.bytes_at(file.size - len(MAGIC), len(MAGIC)) != MAGIC:
            raise UnfinishedBagError(path, "has no end, it was cut off")
        footer = file.record_at(footer_at).record
        if not isinstance(footer, Footer):
            raise DamagedBagError(path, "has no footer")
        records = _summary_records(file, footer, footer_at)
    except UnreadableRecordError as error:
        raise DamagedBagError(path, f"its summary is damaged ({error})") from error
    index = _from_summary(file, records)
    if index is None:
        index = walked(file)
        if index.damages:
            damage = index.damages[0]
            raise DamagedBagError(path, f"at byte {damage.offset}: {damage.reason}")
    return index


def _summary_records(file: RecordFile, footer: Footer, footer_at: int) -> list[Record]:
    if footer.summary_start == 0:
        return []
    if not len(MAGIC) <= footer.summary_start <= footer_at or footer_at - footer.summary_start > MAX_RECORD_BYTES:
        raise UnreadableRecordError("it does not lie in the file")
    data = file.bytes_at(footer.summary_start, footer_at + FOOTER_BYTES - footer.summary_start)
    if footer.summary_crc and zlib.crc32(data[:-4]) != footer.summary_crc:
        raise UnreadableRecordError("its checksum fails")
    records: list[Record] = []
    offset = 0
    while offset < len(data) - FOOTER_BYTES:
        opcode, length = struct.unpack_from("<BQ", data, offset)
        if offset + HEAD_BYTES + length > len(data):
            raise UnreadableRecordError("a record does not fit it")
        records.append(parse(opcode, data[offset + HEAD_BYTES : offset + HEAD_BYTES + length]))
        offset += HEAD_BYTES + length
    return records


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
    if statistics is None or unlisted or (statistics.message_count and not index.extents):
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


# By walking ----------------------------------------------------------------------------------------------------------


def walked(file: RecordFile) -> FileIndex:
    """Return the index of every record that is intact, and the damage between them; never raises on content."""
    index = FileIndex(file, finished=False)
    walk = _Walk(index)
    for found in file.scan(walk.accept):
        if isinstance(found, Damage):
            index.damages.append(found)
        else:
            walk.take(found)
    walk.complete()
    return index


class _Walk:
    """Gathers an index record by record."""

    def __init__(self, index: FileIndex) -> None:
        self._index = index
        self._looked_into: tuple[int, list[Record]] = (-1, [])
        self._second_copies: list[dict[str, str]] = []
        self._outside: list[Schema | Channel] = []

    def accept(self, found: Found) -> None:
        """Look into a chunk, whose records must be intact too."""
        record = found.record
        if isinstance(record, Chunk):
            if self._looked_into[0] != found.offset:
                inner = list(inner_records(unpacked(record)))
                self._looked_into = (found.offset, inner)
        elif isinstance(record, Footer):
            end = found.offset + found.length
            if end != self._index.file.size - len(MAGIC):
                raise UnreadableRecordError("a footer within the file")

    def take(self, found: Found) -> None:
        """Take a record into the index."""
        index, record = self._index, found.record
        if isinstance(record, Chunk):
            self._take_chunk(found, self._looked_into[1])
        elif isinstance(record, RawMessage):
            self._take_message(found, record)
        elif isinstance(record, (Schema, Channel)):
            self._outside.append(record)
        elif isinstance(record, Attachment):
            index.attachments.append(found.offset)
        elif isinstance(record, Metadata):
            index.metadata[record.name] = found.offset
            if record.name == TOPIC_RECORD:
                self._second_copies.append(record.metadata)
        elif isinstance(record, Footer):
            index.finished = True

    def _take_chunk(self, found: Found, inner: list[Record]) -> None:
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

    def _take_message(self, found: Found, message: RawMessage) -> None:
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
        """Fill in the schemas and channels that no intact chunk gave: first from the summary, then from copies."""
        index = self._index
        for record in self._outside:
            table: dict[int, Schema] | dict[int, Channel] = (
                index.schemas if isinstance(record, Schema) else index.channels
            )
            table.setdefault(record.id, record)  # type: ignore[arg-type]
        for copy in self._second_copies:
            self._take_copy(copy)
        index.channels = {key: channel for key, channel in index.channels.items() if channel.schema_id in index.schemas}

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
