# SPDX-License-Identifier: Apache-2.0
"""Output file of one split, written in transactions.

The output of the MCAP writer is buffered in memory and written by `commit`, completely or not at all.  A full disk
never leaves a partial record: what was written stays valid, and the buffered bytes wait for the next attempt.

While recording, disk space is reserved on the same file system.  It is released when the disk is full, which leaves
room to write the buffered data, the summary and `metadata.yaml`.
"""

import os
from pathlib import Path

from mech_twin.files.output_file import FILE_MODE, NEW_FILE

RESERVATION_NAME = ".reserve"


class SplitFile:
    """The output stream of an MCAP writer."""

    def __init__(self, path: Path, fsync: bool) -> None:
        self.path = path
        self.committed_bytes = 0
        self._fsync = fsync
        self._buffered: list[bytes] = []
        self._buffered_bytes = 0
        self._descriptor = os.open(path, NEW_FILE, FILE_MODE)

    @property
    def pending(self) -> bool:
        """Whether there are buffered bytes."""
        return self._buffered_bytes > 0

    def write(self, data: bytes) -> int:
        """Buffer bytes."""
        if data:
            self._buffered.append(bytes(data))
            self._buffered_bytes += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the offset of the next byte."""
        return self.committed_bytes + self._buffered_bytes

    def flush(self) -> None:
        """Do nothing: only `commit` writes."""

    def commit(self) -> None:
        """Write everything buffered, or leave the file as it was.

        Raises
        ------
        OSError
            The disk is full or failing; the bytes stay buffered and the file keeps its previous length.
        """
        data = memoryview(b"".join(self._buffered))
        done = 0
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
        self._buffered_bytes = 0

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
