# SPDX-License-Identifier: Apache-2.0
"""Index of an MCAP file, read from its summary section."""

from __future__ import annotations

import struct
import zlib
from collections import Counter

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, Footer, MetadataIndex, Schema, Statistics

from mech_twin.files.input_file import TABLE_SUFFIXES
from mech_twin.recording.errors import DamagedBagError, ForeignFileError, UnfinishedBagError
from mech_twin.recording.file_index import Extent, FileIndex, scanned_index
from mech_twin.recording.record_file import (
    FOOTER_BYTES,
    HEAD_BYTES,
    MAGIC,
    MAX_CHUNK_BYTES,
    MAX_RECORD_BYTES,
    Record,
    RecordFile,
    UnreadableRecordError,
    inner_records,
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
