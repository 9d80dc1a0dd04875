# SPDX-License-Identifier: Apache-2.0
"""A disk of one MiB: a tmpfs where mounting is allowed, else the same refusals injected below the writer."""

from __future__ import annotations

import errno
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

DISK_BYTES = 1 << 20


@contextmanager
def small_disk(path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Make the directory a disk of `DISK_BYTES`."""
    path.mkdir()
    mounting = ["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(path)]
    if os.geteuid() == 0 and subprocess.run(mounting, capture_output=True, check=False).returncode == 0:
        try:
            yield path
        finally:
            subprocess.run(["umount", "--lazy", str(path)], check=True)
        return
    _limit(path, monkeypatch)
    yield path


def _limit(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Refuse writes once the files under a directory hold `DISK_BYTES`."""
    pwrite, fallocate = os.pwrite, os.posix_fallocate

    def free() -> int:
        return DISK_BYTES - sum(file.stat().st_size for file in path.rglob("*") if file.is_file())

    def limited_pwrite(descriptor: int, data: bytes, offset: int) -> int:
        room = free()
        if room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return pwrite(descriptor, data[:room], offset)

    def limited_fallocate(descriptor: int, offset: int, length: int) -> None:
        if offset + length - os.fstat(descriptor).st_size > free():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fallocate(descriptor, offset, length)

    monkeypatch.setattr(os, "pwrite", limited_pwrite)
    monkeypatch.setattr(os, "posix_fallocate", limited_fallocate)
