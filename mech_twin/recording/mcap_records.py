"""Records of an MCAP file, read by offset, within bounds, and trusting nothing.

The package's own record readers parse the fields.  Around them stand the checks they leave out: a record must fit its
file and be used up exactly, a chunk must not unpack to more than it says, and checksums must hold.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import lz4.frame  # type: ignore[import-untyped]
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

from mech_twin.recording.errors import MissingBagError

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 256 << 20
MAX_CHUNK_BYTES = 256 << 20
HEAD_BYTES = 9
FOOTER_BYTES = HEAD_BYTES + 20
_WINDOW = 1 << 20
_MESSAGE = struct.Struct("<HIQQ")
# An opcode and a length below MAX_RECORD_BYTES; looked ahead, so that candidates may overlap.
_HEAD_PATTERN = re.compile(rb"(?=[\x01-\x0f][\s\S]{3}[\x00-\x10]\x00{4})")

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
    """The bytes at this offset are no record."""


class RawMessage(NamedTuple):
    """A message as it lies in the file."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    raw: bytes


Record = McapRecord | RawMessage | None
"""A record, or None for one of a kind this reader does not know."""


class Found(NamedTuple):
    """A record and the bytes it takes."""

    offset: int
    length: int
    record: Record


class Damage(NamedTuple):
    """Bytes that are no record."""

    offset: int
    length: int
    reason: str


class RecordFile:
    """An MCAP file open for reading by offset."""

    def __init__(self, path: Path) -> None:
        try:
            self._stream = path.open("rb", buffering=0)
            self.size = os.fstat(self._stream.fileno()).st_size
        except OSError as error:
            raise MissingBagError(path, f"cannot be read ({error.strerror})") from error
        self.path = path

    def close(self) -> None:
        """Give the file back."""
        self._stream.close()

    def bytes_at(self, offset: int, count: int) -> bytes:
        """Return so many bytes, fewer at the end of the file.

        Raises
        ------
        UnreadableRecordError
            The disk refuses.
        """
        try:
            return os.pread(self._stream.fileno(), count, offset)
        except OSError as error:
            raise UnreadableRecordError(f"the disk refuses to read ({error.strerror})") from error

    def head_at(self, offset: int) -> tuple[int, int]:
        """Return opcode and length of the record at an offset, its length checked against the file."""
        head = self.bytes_at(offset, HEAD_BYTES)
        if len(head) < HEAD_BYTES:
            raise UnreadableRecordError("the file ends within a record")
        opcode, length = struct.unpack("<BQ", head)
        if length > MAX_RECORD_BYTES:
            raise UnreadableRecordError(f"a record of {length} bytes, more than {MAX_RECORD_BYTES}")
        if offset + HEAD_BYTES + length > self.size:
            raise UnreadableRecordError("the file ends within a record")
        return opcode, length

    def record_at(self, offset: int) -> Found:
        """Return the record at an offset.

        Raises
        ------
        UnreadableRecordError
            It does not fit the file, or its fields do not fit it.
        """
        opcode, length = self.head_at(offset)
        return Found(offset, HEAD_BYTES + length, parse(opcode, self.bytes_at(offset + HEAD_BYTES, length)))

    def scan(self, accept: Callable[[Found], None]) -> Iterator[Found | Damage]:
        """Yield every record in the order of the file, and the damage between them.

        Parameters
        ----------
        accept : callable
            Looks into a record; raises UnreadableRecordError where it will not have it.
        """
        offset = len(MAGIC) if self.bytes_at(0, len(MAGIC)) == MAGIC else 0
        while offset < self.size and not self._is_end(offset):
            found = self._record_or_damage(offset, accept)
            yield found
            offset += found.length

    def _record_or_damage(self, offset: int, accept: Callable[[Found], None]) -> Found | Damage:
        try:
            found = self.record_at(offset)
            accept(found)
        except UnreadableRecordError as error:
            return Damage(offset, self._following(offset, accept) - offset, str(error))
        return found

    def _is_end(self, offset: int) -> bool:
        return offset == self.size - len(MAGIC) and self.bytes_at(offset, len(MAGIC)) == MAGIC

    def _plausible(self, offset: int) -> bool:
        """Whether a record can begin here, or the file ends."""
        if offset == self.size or self._is_end(offset):
            return True
        try:
            opcode, _ = self.head_at(offset)
        except UnreadableRecordError:
            return False
        return 0 < opcode <= Opcode.DATA_END

    def _following(self, offset: int, accept: Callable[[Found], None]) -> int:
        """Return where the next record begins after damage at an offset."""
        try:
            _, length = self.head_at(offset)
            after = offset + HEAD_BYTES + length
            if self._plausible(after) and after < self.size:
                return after
        except UnreadableRecordError:
            pass  # the length itself is damaged: search byte by byte
        start = offset + 1
        while start < self.size:
            window = self.bytes_at(start, _WINDOW + HEAD_BYTES)
            for match in _HEAD_PATTERN.finditer(window):
                if match.start() < _WINDOW and self._is_record(start + match.start(), accept):
                    return start + match.start()
            start += _WINDOW
        return self.size

    def _is_record(self, offset: int, accept: Callable[[Found], None]) -> bool:
        try:
            _, length = self.head_at(offset)
            if not self._plausible(offset + HEAD_BYTES + length):
                return False
            accept(self.record_at(offset))
        except UnreadableRecordError:
            return False
        return True


def parse(opcode: int, content: bytes) -> Record:
    """Return the record of these bytes.

    Raises
    ------
    UnreadableRecordError
        The fields do not use the bytes up exactly, or a checksum fails.
    """
    if opcode == Opcode.MESSAGE:
        return _message(content, 0, len(content))
    reader = _READERS.get(opcode)
    if reader is None:
        if opcode == 0:
            raise UnreadableRecordError("no record")
        return None
    stream = ReadDataStream(BytesIO(content))
    try:
        record = reader(stream)
    except (McapError, struct.error, ValueError, OverflowError, MemoryError) as error:
        raise UnreadableRecordError(f"a broken {Opcode(opcode).name.lower()} record") from error
    if stream.count != len(content) or not _whole(record, content):
        raise UnreadableRecordError(f"a broken {Opcode(opcode).name.lower()} record")
    return record


def _whole(record: McapRecord, content: bytes) -> bool:
    """Whether the last field has its full length (the package's stream reads short without a word) and checksum."""
    if isinstance(record, Chunk):
        at = 32 + len(record.compression.encode())
        return bool(struct.unpack_from("<Q", content, at)[0] == len(record.data))
    if isinstance(record, Attachment):
        (crc,) = struct.unpack_from("<I", content, len(content) - 4)
        return crc in {0, zlib.crc32(content[:-4])}
    if isinstance(record, Schema):
        at = 10 + len(record.name.encode()) + len(record.encoding.encode())
        return bool(struct.unpack_from("<I", content, at)[0] == len(record.data))
    return True


def _message(content: bytes, start: int, stop: int) -> RawMessage:
    if stop - start < 22:
        raise UnreadableRecordError("a broken message record")
    channel_id, sequence, log_time_ns, publish_time_ns = _MESSAGE.unpack_from(content, start)
    return RawMessage(channel_id, sequence, log_time_ns, publish_time_ns, content[start + 22 : stop])


def unpacked(chunk: Chunk) -> bytes:
    """Return what a chunk holds, never more than it says, its checksum verified.

    Raises
    ------
    UnreadableRecordError
        It does not unpack, or the checksum fails.
    """
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise UnreadableRecordError(f"a chunk of {size} bytes, more than {MAX_CHUNK_BYTES}")
    try:
        if chunk.compression == "zstd":
            if zstandard.get_frame_parameters(chunk.data).content_size not in {size, zstandard.CONTENTSIZE_UNKNOWN}:
                raise UnreadableRecordError("a chunk whose size is not what it says")
            data = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        elif chunk.compression == "":
            data = chunk.data
        else:
            raise UnreadableRecordError(f"a chunk of unknown compression '{chunk.compression[:16]}'")
    except (zstandard.ZstdError, RuntimeError, ValueError, EOFError, MemoryError) as error:
        raise UnreadableRecordError(f"a chunk that does not unpack ({error})") from error
    if len(data) != size:
        raise UnreadableRecordError("a chunk whose size is not what it says")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise UnreadableRecordError("a chunk whose checksum fails")
    return data


def inner_records(data: bytes) -> Iterator[Record]:
    """Yield the schemas, channels and messages of an unpacked chunk.

    Raises
    ------
    UnreadableRecordError
        At the first record that is none.
    """
    offset, size = 0, len(data)
    while offset < size:
        if size - offset < HEAD_BYTES:
            raise UnreadableRecordError("a chunk that ends within a record")
        opcode, length = struct.unpack_from("<BQ", data, offset)
        start, stop = offset + HEAD_BYTES, offset + HEAD_BYTES + length
        if stop > size:
            raise UnreadableRecordError("a chunk that ends within a record")
        yield _message(data, start, stop) if opcode == Opcode.MESSAGE else parse(opcode, data[start:stop])
        offset = stop
