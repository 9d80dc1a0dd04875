# SPDX-License-Identifier: Apache-2.0
"""An MCAP file read record by record; a scan resynchronises after damage."""

from __future__ import annotations

import os
import re
import stat
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

from mcap.opcode import Opcode

from mech_twin.recording.errors import MissingBagError
from mech_twin.recording.mcap_records import (
    HEAD_BYTES,
    MAGIC,
    MAX_RECORD_BYTES,
    Damage,
    LocatedRecord,
    RawMessage,
    UnreadableRecordError,
    parse,
)

_WINDOW = 1 << 20
# An opcode and a length below MAX_RECORD_BYTES, as a lookahead so that candidates may overlap.
_HEAD_PATTERN = re.compile(rb"(?=[\x01-\x0f][\s\S]{3}[\x00-\x10]\x00{4})")


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
            # without O_NONBLOCK, opening a named pipe waits for a writer
            self._descriptor = os.open(content or path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise MissingBagError(path, f"cannot be read ({error.strerror})") from error
        status = os.fstat(self._descriptor)
        if not stat.S_ISREG(status.st_mode):
            os.close(self._descriptor)
            raise MissingBagError(path, "is not a regular file")
        self.size = status.st_size
        self.path = path

    def close(self) -> None:
        """Close the file; idempotent."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def bytes_at(self, offset: int, count: int) -> bytes:
        """Return `count` bytes, fewer at the end of the file.

        Raises
        ------
        UnreadableRecordError
            The operating system reports a read error.
        """
        try:
            return os.pread(self._descriptor, count, offset)
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
