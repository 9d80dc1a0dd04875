# SPDX-License-Identifier: Apache-2.0
"""Where compiled kernels are kept on disk: directories tried in turn, files that are whole or not there.

Each file holds the code of one kernel for one signature, under a name made of its key, and is put in place whole.
There is no index, so processes that store at the same time have nothing to tear or to overwrite.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import logging
import os
import shutil
import stat
import tempfile
import time
import uuid
from functools import lru_cache
from pathlib import Path

DIRECTORY_VARIABLE = "MECH_TWIN_CACHE_DIR"
DAY_S = 86400.0
UNUSED_DAYS = 30

_log = logging.getLogger("mech_twin.kernels")


@lru_cache(maxsize=1)
def directories() -> tuple[Path, ...]:
    """Return the directories compiled kernels are looked for in, the preferred one first."""
    chosen = _user_directory()
    shared = _temporary_directory()
    return tuple(path for path in (chosen, shared) if path is not None)


def load(folder: str, name: str) -> bytes | None:
    """Return what is stored under a name, None if there is nothing or it is not whole."""
    for root in directories():
        try:
            content = (root / folder / name).read_bytes()
        except OSError:  # not there, or not ours to read: the next directory, or the compiler
            continue
        digest, payload = content[:32], content[32:]
        if hashlib.sha256(payload).digest() == digest:
            _mark_used(root / folder)
            return payload
        _log.warning("%s: damaged, compiled anew", root / folder / name)
    return None


def save(folder: str, name: str, payload: bytes) -> None:
    """Store a payload in the first directory that takes it; log once if none does."""
    content = hashlib.sha256(payload).digest() + payload
    for root in directories():
        try:
            _put(root / folder, name, content)
        except OSError:  # read-only, full, or not a directory: the next one
            continue
        _prune_daily(root)
        return
    _warn_unstored()


@lru_cache(maxsize=1)
def _warn_unstored() -> None:
    """Log, once a process, that kernels are compiled in memory only."""
    tried = ", ".join(map(str, directories())) or "no directory for them"
    _log.warning("compiled kernels cannot be kept (%s); set %s to a directory to write in", tried, DIRECTORY_VARIABLE)


def _user_directory() -> Path | None:
    """Return the directory the user named, or the one the XDG convention has; None without a home."""
    if named := os.environ.get(DIRECTORY_VARIABLE):
        return Path(named).absolute()
    cache, home = os.environ.get("XDG_CACHE_HOME", ""), os.environ.get("HOME", "")
    if Path(cache).is_absolute():
        return Path(cache) / "mech_twin" / "kernels"
    return Path(home) / ".cache" / "mech_twin" / "kernels" if Path(home).is_absolute() else None


def _temporary_directory() -> Path | None:
    """Return this user's directory under the one for temporary files, None if another could have written there."""
    try:
        path = Path(tempfile.gettempdir()) / f"mech_twin-kernels-{os.geteuid()}"
    except FileNotFoundError:  # no directory for temporary files either
        return None
    with contextlib.suppress(OSError):
        path.mkdir(mode=0o700)
    try:
        status = path.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & 0o077
    return path if private else None


def _put(directory: Path, name: str, content: bytes) -> None:
    """Write a file under another name and move it into its place, so that readers see all of it or nothing."""
    directory.mkdir(parents=True, exist_ok=True)
    unfinished = directory / f".{name}.{uuid.uuid4().hex}"
    try:
        unfinished.write_bytes(content)
        unfinished.replace(directory / name)
    except OSError:
        with contextlib.suppress(OSError):
            unfinished.unlink()
        raise


def _mark_used(directory: Path) -> None:
    """Date a directory of kernels today, at most once a day; one that cannot be written is not pruned."""
    with contextlib.suppress(OSError):
        if time.time() - directory.stat().st_mtime > DAY_S:
            os.utime(directory)


def _prune_daily(root: Path) -> None:
    """Delete directories of kernels unused for 30 days, at most once a day and in one process at a time.

    A directory is moved out of sight before it is emptied: another process finds its files, or none and compiles.
    """
    with contextlib.suppress(OSError), (root / ".pruned").open("a+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.seek(0)
        now = time.time()
        if now - _seconds(lock.read()) < DAY_S:
            return
        lock.truncate(0)
        lock.write(str(now))
        for directory in [path for path in root.iterdir() if path.is_dir() and not path.is_symlink()]:
            if now - directory.stat().st_mtime > UNUSED_DAYS * DAY_S:
                hidden = root / f".removed-{uuid.uuid4().hex}"
                directory.rename(hidden)
                shutil.rmtree(hidden, ignore_errors=True)


def _seconds(text: str) -> float:
    """Return the time in a marker, zero if it holds none."""
    try:
        return float(text)
    except ValueError:
        return 0.0
