"""The file under one split: bytes reach it whole or not at all.

The MCAP writer's output is gathered in memory and handed to the operating system by `commit`, so that a full disk
never leaves half a record behind: what was written stays valid, and the gathered bytes wait for the next attempt.

A small reserve is held on the same disk while recording.  It is given up when the disk is full, which leaves room to
write what was gathered, close the file and describe the bag.
"""

from __future__ import annotations

import os
from pathlib import Path


class SplitFile:
    """The stream an MCAP writer writes to."""

    def __init__(self, path: Path, fsync: bool) -> None:
        self.path = path
        self.committed_bytes = 0
        self._fsync = fsync
        self._gathered: list[bytes] = []
        self._gathered_bytes = 0
        self._descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, 0o644)

    @property
    def pending(self) -> bool:
        """Whether there are bytes that the operating system does not have yet."""
        return self._gathered_bytes > 0

    def write(self, data: bytes) -> int:
        """Gather bytes."""
        if data:
            self._gathered.append(bytes(data))
            self._gathered_bytes += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the offset of the next byte."""
        return self.committed_bytes + self._gathered_bytes

    def flush(self) -> None:
        """Do nothing: `commit` is the only way out."""

    def commit(self) -> None:
        """Hand everything gathered to the operating system, or leave the file as it was.

        Raises
        ------
        OSError
            The disk is full or fails; the bytes are kept, and the file ends where it ended before.
        """
        data = memoryview(b"".join(self._gathered))
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
        self._gathered.clear()
        self._gathered_bytes = 0

    def close(self) -> None:
        """Give the file back; idempotent."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class Reserve:
    """Disk space held back for the day the disk is full."""

    def __init__(self, directory: Path) -> None:
        self._path = directory / ".reserve"
        self._held_bytes = 0

    def hold(self, size: int) -> None:
        """Hold at least so many bytes; a no-op where they are held already."""
        if size <= self._held_bytes:
            return
        descriptor = os.open(self._path, os.O_CREAT | os.O_WRONLY | os.O_CLOEXEC, 0o600)
        try:
            os.posix_fallocate(descriptor, 0, size)
        finally:
            os.close(descriptor)
        self._held_bytes = size

    def release(self) -> None:
        """Give the space back; idempotent."""
        self._path.unlink(missing_ok=True)
        self._held_bytes = 0
