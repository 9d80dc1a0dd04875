# SPDX-License-Identifier: Apache-2.0
"""Records of an MCAP file, parsed with every length and checksum verified.

The `mcap` package parses the fields.  This module adds the checks it omits: a record must lie within its file, its
fields within the record, a chunk must decompress to its declared size, and checksums must match.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 256 << 20
MAX_CHUNK_BYTES = 256 << 20
MAX_CHUNK_RECORDS = 1 << 20
HEAD_BYTES = 9
FOOTER_BYTES = HEAD_BYTES + 20
_MESSAGE = struct.Struct("<HIQQ")

_READERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.HEADER: Header.read,
    Opcode.FOOTER: Footer.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.MESSAGE_INDEX: MessageIndex.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex.read,
    Opcode.STATISTICS: Statistics.read,
    Opcode.METADATA: Metadata.read,
    Opcode.METADATA_INDEX: MetadataIndex.read,
    Opcode.SUMMARY_OFFSET: SummaryOffset.read,
    Opcode.DATA_END: DataEnd.read,
}


class UnreadableRecordError(Exception):
    """The bytes at this offset are not a valid record."""


class RawMessage(NamedTuple):
    """A message record with serialized payload."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    raw: bytes


Record = McapRecord | RawMessage | None
"""A record; None for an unknown record type."""


class LocatedRecord(NamedTuple):
    """A record with its position in the file."""

    offset: int
    length: int
    record: Record


class Damage(NamedTuple):
    """A range of bytes that are not valid records."""

    offset: int
    length: int
    reason: str


def parse(opcode: int, content: bytes) -> Record:
    """Return the record parsed from its content.

    Raises
    ------
    UnreadableRecordError
        The fields exceed the content, or a checksum fails.  Bytes after the known fields are ignored, as MCAP requires.
    """
    if opcode == Opcode.MESSAGE:
        return _message(content, 0, len(content))
    reader = _READERS.get(opcode)
    if reader is None:
        if opcode == 0:
            raise UnreadableRecordError("not a record")
        return None
    stream = ReadDataStream(BytesIO(content))
    try:
        record = reader(stream)
    except (McapError, struct.error, ValueError, OverflowError, MemoryError) as error:
        raise UnreadableRecordError(f"a broken {Opcode(opcode).name.lower()} record") from error
    if stream.count > len(content) or not _is_complete(record, content, stream.count):
        raise UnreadableRecordError(f"a broken {Opcode(opcode).name.lower()} record")
    return record


def _is_complete(record: McapRecord, content: bytes, end: int) -> bool:
    """Whether the last field has its declared length (`mcap` truncates silently) and its checksum matches."""
    if isinstance(record, Chunk):
        at = 32 + len(record.compression.encode())
        return bool(struct.unpack_from("<Q", content, at)[0] == len(record.data))
    if isinstance(record, Attachment):
        (crc,) = struct.unpack_from("<I", content, end - 4)
        return crc in {0, zlib.crc32(content[: end - 4])}
    if isinstance(record, Schema):
        at = 10 + len(record.name.encode()) + len(record.encoding.encode())
        return bool(struct.unpack_from("<I", content, at)[0] == len(record.data))
    return True


def _message(content: bytes, start: int, stop: int) -> RawMessage:
    if stop - start < 22:
        raise UnreadableRecordError("a broken message record")
    channel_id, sequence, log_time_ns, publish_time_ns = _MESSAGE.unpack_from(content, start)
    return RawMessage(channel_id, sequence, log_time_ns, publish_time_ns, content[start + 22 : stop])


def decompressed(chunk: Chunk) -> bytes:
    """Return the decompressed content of a chunk, after verification of its size and checksum.

    Raises
    ------
    UnreadableRecordError
        It cannot be decompressed, is larger than declared or than allowed, or the checksum fails.
    """
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise UnreadableRecordError(f"a chunk of {size} bytes, more than {MAX_CHUNK_BYTES}")
    try:
        if chunk.compression == "zstd":
            if zstandard.get_frame_parameters(chunk.data).content_size not in {size, zstandard.CONTENTSIZE_UNKNOWN}:
                raise UnreadableRecordError("a chunk whose size differs from the declared one")
            data = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        elif chunk.compression == "":
            data = chunk.data
        else:
            raise UnreadableRecordError(f"a chunk of unknown compression '{chunk.compression[:16]}'")
    except (zstandard.ZstdError, RuntimeError, ValueError, EOFError, MemoryError) as error:
        raise UnreadableRecordError(f"a chunk that cannot be decompressed ({error})") from error
    if len(data) != size:
        raise UnreadableRecordError("a chunk whose size differs from the declared one")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise UnreadableRecordError("a chunk whose checksum fails")
    return data


def inner_records(data: bytes) -> Iterator[Record]:
    """Yield the schemas, channels and messages of a decompressed chunk.

    Raises
    ------
    UnreadableRecordError
        At the first invalid record.
    """
    offset, size, count = 0, len(data), 0
    while offset < size:
        count += 1
        if count > MAX_CHUNK_RECORDS:
            raise UnreadableRecordError(f"a chunk of more than {MAX_CHUNK_RECORDS} records")
        if size - offset < HEAD_BYTES:
            raise UnreadableRecordError("a chunk that ends within a record")
        opcode, length = struct.unpack_from("<BQ", data, offset)
        start, stop = offset + HEAD_BYTES, offset + HEAD_BYTES + length
        if stop > size:
            raise UnreadableRecordError("a chunk that ends within a record")
        yield _message(data, start, stop) if opcode == Opcode.MESSAGE else parse(opcode, data[start:stop])
        offset = stop
