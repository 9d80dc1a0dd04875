# SPDX-License-Identifier: Apache-2.0
"""An MCAP file read record by record, with every length and checksum verified; a scan resynchronises after damage.

The `mcap` package parses the fields.  This module adds the checks it omits: a record must lie within its file, its
fields within the record, a chunk must decompress to its declared size, and checksums must match.
"""

import os
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from mech_twin.files.input_file import opened_input
from mech_twin.recording.errors import MissingBagError

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 256 << 20
MAX_CHUNK_BYTES = 256 << 20
MAX_CHUNK_RECORDS = 1 << 20
HEAD_BYTES = 9
FOOTER_BYTES = HEAD_BYTES + 20
_MESSAGE = struct.Struct("<HIQQ")

_READERS: dict[int, Callable[[ReadDataStream], records.McapRecord]] = {
    Opcode.HEADER: records.Header.read,
    Opcode.FOOTER: records.Footer.read,
    Opcode.SCHEMA: records.Schema.read,
    Opcode.CHANNEL: records.Channel.read,
    Opcode.CHUNK: records.Chunk.read,
    Opcode.MESSAGE_INDEX: records.MessageIndex.read,
    Opcode.CHUNK_INDEX: records.ChunkIndex.read,
    Opcode.ATTACHMENT: records.Attachment.read,
    Opcode.ATTACHMENT_INDEX: records.AttachmentIndex.read,
    Opcode.STATISTICS: records.Statistics.read,
    Opcode.METADATA: records.Metadata.read,
    Opcode.METADATA_INDEX: records.MetadataIndex.read,
    Opcode.SUMMARY_OFFSET: records.SummaryOffset.read,
    Opcode.DATA_END: records.DataEnd.read,
}
_WINDOW = 1 << 20
# An opcode and a length below MAX_RECORD_BYTES, as a lookahead so that candidates may overlap.
_HEAD_PATTERN = re.compile(rb"(?=[\x01-\x0f][\s\S]{3}[\x00-\x10]\x00{4})")


class UnreadableRecordError(Exception):
    """The bytes at this offset are not a valid record."""


class RawMessage(NamedTuple):
    """A message record with serialized payload."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    raw: bytes


Record = records.McapRecord | RawMessage | None
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


def _is_complete(record: records.McapRecord, content: bytes, end: int) -> bool:
    """Whether the last field has its declared length (`mcap` truncates silently) and its checksum matches."""
    if isinstance(record, records.Chunk):
        at = 32 + len(record.compression.encode())
        return bool(struct.unpack_from("<Q", content, at)[0] == len(record.data))
    if isinstance(record, records.Attachment):
        (crc,) = struct.unpack_from("<I", content, end - 4)
        return crc in {0, zlib.crc32(content[: end - 4])}
    if isinstance(record, records.Schema):
        at = 10 + len(record.name.encode()) + len(record.encoding.encode())
        return bool(struct.unpack_from("<I", content, at)[0] == len(record.data))
    return True


def _message(content: bytes, start: int, stop: int) -> RawMessage:
    if stop - start < 22:
        raise UnreadableRecordError("a broken message record")
    channel_id, sequence, log_time_ns, publish_time_ns = _MESSAGE.unpack_from(content, start)
    return RawMessage(channel_id, sequence, log_time_ns, publish_time_ns, content[start + 22 : stop])


def decompressed(chunk: records.Chunk) -> bytes:
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


def inner_records(data: bytes, whole: str = "chunk") -> Iterator[Record]:
    """Yield the schemas, channels and messages of a decompressed chunk, or the records of another whole.

    Raises
    ------
    UnreadableRecordError
        At the first invalid record.
    """
    offset, size, count = 0, len(data), 0
    while offset < size:
        count += 1
        if count > MAX_CHUNK_RECORDS:
            raise UnreadableRecordError(f"a {whole} of more than {MAX_CHUNK_RECORDS} records")
        if size - offset < HEAD_BYTES:
            raise UnreadableRecordError(f"a {whole} that ends within a record")
        opcode, length = struct.unpack_from("<BQ", data, offset)
        start, stop = offset + HEAD_BYTES, offset + HEAD_BYTES + length
        if stop > size:
            raise UnreadableRecordError(f"a {whole} that ends within a record")
        yield _message(data, start, stop) if opcode == Opcode.MESSAGE else parse(opcode, data[start:stop])
        offset = stop


class RecordFile:
    """An MCAP file open for reading by offset.

    Parameters
    ----------
    path : Path
        Path of the file, used in errors.
    content : Path, optional
        The file to read instead if ``path`` is compressed.
    """

    def __init__(self, path: Path, content: Path | None = None) -> None:
        try:
            self._file = opened_input(content or path)
        except OSError as error:
            raise MissingBagError(path, f"cannot be read ({error.strerror})") from error
        self.size = os.fstat(self._file.fileno()).st_size
        self.path = path

    def close(self) -> None:
        """Close the file; idempotent."""
        self._file.close()

    def bytes_at(self, offset: int, count: int) -> bytes:
        """Return `count` bytes, fewer at the end of the file.

        Raises
        ------
        UnreadableRecordError
            The operating system reports a read error.
        """
        try:
            return os.pread(self._file.fileno(), count, offset)
        except OSError as error:
            raise UnreadableRecordError(f"read error ({error.strerror})") from error

    def head_at(self, offset: int) -> tuple[int, int]:
        """Return opcode and length of the record at an offset; the length is checked against the file size."""
        head = self.bytes_at(offset, HEAD_BYTES)
        if len(head) < HEAD_BYTES:
            raise UnreadableRecordError("the file ends within a record")
        opcode, length = struct.unpack("<BQ", head)
        if length > MAX_RECORD_BYTES:
            raise UnreadableRecordError(f"a record of {length} bytes, more than {MAX_RECORD_BYTES}")
        if offset + HEAD_BYTES + length > self.size:
            raise UnreadableRecordError("the file ends within a record")
        return opcode, length

    def record_at(self, offset: int) -> LocatedRecord:
        """Return the record at an offset.

        Raises
        ------
        UnreadableRecordError
            It exceeds the file, or its fields are invalid.
        """
        opcode, length = self.head_at(offset)
        return LocatedRecord(offset, HEAD_BYTES + length, parse(opcode, self.bytes_at(offset + HEAD_BYTES, length)))

    def scan(self, accept: Callable[[LocatedRecord], None]) -> Iterator[LocatedRecord | Damage]:
        """Yield every record in the order of the file, and the damage between them.

        Parameters
        ----------
        accept : callable
            Verifies a record; raises UnreadableRecordError to reject it.
        """
        offset = len(MAGIC) if self.bytes_at(0, len(MAGIC)) == MAGIC else 0
        while offset < self.size and not self._is_end(offset):
            found = self._record_or_damage(offset, accept)
            yield found
            offset += found.length

    def _record_or_damage(self, offset: int, accept: Callable[[LocatedRecord], None]) -> LocatedRecord | Damage:
        try:
            found = self.record_at(offset)
            accept(found)
            if isinstance(found.record, RawMessage) and not self._may_follow(offset + found.length):
                raise UnreadableRecordError("a message whose length does not lead to another record")
        except UnreadableRecordError as error:
            return Damage(offset, self._following(offset, accept) - offset, str(error))
        return found

    def _is_end(self, offset: int) -> bool:
        return offset == self.size - len(MAGIC) and self.bytes_at(offset, len(MAGIC)) == MAGIC

    def _may_follow(self, offset: int) -> bool:
        """Whether a record, or the head of a truncated one, follows here: the only check a message record allows."""
        head = self.bytes_at(offset, HEAD_BYTES)
        if len(head) < HEAD_BYTES or self._is_end(offset):
            return True
        opcode, length = struct.unpack("<BQ", head)
        return bool(0 < opcode <= Opcode.DATA_END and length <= MAX_RECORD_BYTES)

    def _plausible(self, offset: int) -> bool:
        """Whether a record may begin here, or the file ends."""
        if offset == self.size or self._is_end(offset):
            return True
        try:
            opcode, _ = self.head_at(offset)
        except UnreadableRecordError:
            return False
        return 0 < opcode <= Opcode.DATA_END

    def _following(self, offset: int, accept: Callable[[LocatedRecord], None]) -> int:
        """Return the offset of the next record after damage at an offset."""
        try:
            _, length = self.head_at(offset)
            after = offset + HEAD_BYTES + length
            if self._plausible(after) and after < self.size:
                return after
        except UnreadableRecordError:
            pass  # the length field itself is damaged: search byte by byte
        start = offset + 1
        while start < self.size:
            window = self.bytes_at(start, _WINDOW + HEAD_BYTES)
            for match in _HEAD_PATTERN.finditer(window):
                if match.start() < _WINDOW and self._is_record(start + match.start(), accept):
                    return start + match.start()
            start += _WINDOW
        return self.size

    def _is_record(self, offset: int, accept: Callable[[LocatedRecord], None]) -> bool:
        try:
            _, length = self.head_at(offset)
            if not self._plausible(offset + HEAD_BYTES + length):
                return False
            accept(self.record_at(offset))
        except UnreadableRecordError:
            return False
        return True
