# SPDX-License-Identifier: Apache-2.0
"""Output files: checked before a computation starts, written completely or not at all, never through a symlink.

Dataclasses and named tuples become plain values for JSON.
"""

import errno
import json
import math
import os
import secrets
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from mech_twin.errors import SentError

FILE_MODE = 0o664  # the umask is applied on top; never writable for everyone
DIRECTORY_MODE = 0o775
NEW_FILE = os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_WRONLY | os.O_CLOEXEC
YAML_SUFFIXES = (".yaml", ".yml")
_NO_HARD_LINKS = {errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK}


def plain(value: Any) -> Any:
    """Return a value as JSON values: dataclasses and named tuples as objects, NaN and infinity as None."""
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    elif hasattr(value, "_asdict"):
        value = value._asdict()
    elif hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def json_text(value: Any) -> str:
    """Return a value as an indented JSON document, see `plain`."""
    return json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


class OutputError(SentError):
    """An output cannot be written; the message is one line with the path and the reason."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}")


def check_output_file(path: Path, *, force: bool = False, suffixes: Sequence[str] = ()) -> None:
    """Raise unless a file can be written at this path.

    Parameters
    ----------
    force : bool
        Whether an existing regular file may be overwritten.
    suffixes : sequence of str
        Allowed suffixes; any if empty.

    Raises
    ------
    OutputError
        It exists, is not a regular file, has another suffix, or its directory does not exist or is not writable.
    """
    if suffixes and path.suffix not in suffixes:
        raise OutputError(path, f"expected a name that ends in {' or '.join(suffixes)}")
    mode = _mode(path)
    if mode is not None and not stat.S_ISREG(mode):
        raise OutputError(path, "is not a regular file; results are written to new or regular files only")
    if mode is not None and not force:
        raise OutputError(path, "exists already; use --force to overwrite it")
    _check_writable(path, path.absolute().parent)


def check_output_directory(path: Path, *, force: bool = False) -> None:
    """Raise unless files can be written in this directory, which need not exist.

    Parameters
    ----------
    force : bool
        Whether it may contain files.

    Raises
    ------
    OutputError
        It is not an empty directory, or it cannot be created or written.
    """
    mode = _mode(path)
    if mode is None:
        _check_writable(path, existing_parent(path))
        return
    if not stat.S_ISDIR(mode):
        raise OutputError(path, "is not a directory")
    try:
        empty = not any(path.iterdir())
    except OSError as error:
        raise OutputError(path, f"cannot be read ({error.strerror})") from error
    if not (empty or force):
        raise OutputError(path, "is not empty; use --force to write into it")
    _check_writable(path, path)


@contextmanager
def written_file(path: Path, *, force: bool = False) -> Iterator[Path]:
    """Provide a temporary path beside the output; it is renamed to the output when the block ends without an error.

    Any other end of the block, including an interrupt, leaves neither the temporary file nor a partial output.

    Raises
    ------
    OutputError
        See `check_output_file`.
    """
    check_output_file(path, force=force)
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        os.close(os.open(temporary, NEW_FILE, FILE_MODE))
        yield temporary
        _publish(temporary, path, force)
    except OSError as error:
        raise OutputError(path, f"cannot be written ({error.strerror or error})") from error
    finally:
        temporary.unlink(missing_ok=True)


def existing_parent(path: Path) -> Path:
    """Return the innermost directory above a path that exists."""
    return next(parent for parent in path.absolute().parents if parent.exists())


def _publish(temporary: Path, path: Path, force: bool) -> None:
    """Rename the finished file to its name; without ``force`` never over a file that appeared meanwhile."""
    if force:
        temporary.replace(path)
        return
    try:
        os.link(temporary, path, follow_symlinks=False)
    except FileExistsError as error:
        raise OutputError(path, "exists already; use --force to overwrite it") from error
    except OSError as error:
        if error.errno not in _NO_HARD_LINKS:
            raise
        check_output_file(path)
        temporary.replace(path)


def _mode(path: Path) -> int | None:
    try:
        return path.lstat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise OutputError(path, f"cannot be written ({error.strerror})") from error


def _check_writable(path: Path, directory: Path) -> None:
    """Create and remove a file: permission bits are not sufficient (root, read-only and special file systems)."""
    if not directory.is_dir():
        raise OutputError(path, f"cannot be written: {directory} is not an existing directory")
    try:
        with tempfile.TemporaryFile(dir=directory, prefix=".mech_twin_"):
            pass
    except OSError as error:
        raise OutputError(path, f"cannot be written: directory {directory} ({error.strerror})") from error
