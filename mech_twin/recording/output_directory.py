# SPDX-License-Identifier: Apache-2.0
"""The directory of a new recording: checked before a run, created for it, free of other files."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from mech_twin.files.output_file import DIRECTORY_MODE, OutputError, check_output_directory
from mech_twin.recording.bag_metadata import FILE_NAME
from mech_twin.recording.errors import BagExistsError, UnwritableDirectoryError
from mech_twin.recording.split_file import RESERVATION_NAME


def check_recording_directory(directory: Path, *, force: bool = False) -> None:
    """Check that a recording can be created in this directory.

    Parameters
    ----------
    directory : Path
        The directory; it may be empty or not exist yet.
    force : bool
        Whether it may contain another recording, which `remove_recording` deletes.

    Raises
    ------
    BagExistsError
        It is not empty; with ``force``, it contains files that do not belong to a recording.
    UnwritableDirectoryError
        It cannot be created or written.
    """
    if _occupied(directory):
        if not force:
            raise BagExistsError(directory, "exists already and is not empty; use --force to overwrite the recording")
        _recording_files(directory)
    try:
        check_output_directory(directory, force=True)
    except OutputError as error:
        raise UnwritableDirectoryError(directory, str(error).removeprefix(f"{directory}: ")) from error


def remove_recording(directory: Path) -> None:
    """Delete the recording in this directory, if there is one, but not the directory.

    Raises
    ------
    BagExistsError
        It holds files that do not belong to a recording; nothing is deleted.
    """
    if _occupied(directory):
        for path in _recording_files(directory):
            path.unlink()


def new_directory(wanted: Path, if_exists: str) -> tuple[Path, list[Path]]:
    """Return an empty directory and the directories created for it, innermost first.

    Raises
    ------
    BagExistsError, UnwritableDirectoryError
        The directory is not empty or cannot be created; nothing is left behind.
    """
    directory, number = wanted.absolute(), 1
    while _occupied(directory):
        if if_exists != "rename":
            raise BagExistsError(directory, "is not empty; nothing is overwritten, choose another directory")
        number += 1
        directory = wanted.absolute().with_name(f"{wanted.name}_{number}")
    made: list[Path] = []
    try:
        missing = [path for path in (directory, *directory.parents) if not path.exists()]
        for path in reversed(missing):
            path.mkdir(DIRECTORY_MODE)
            made.insert(0, path)
    except OSError as error:
        for path in made:
            path.rmdir()
        raise UnwritableDirectoryError(directory, f"cannot be created ({error.strerror})") from error
    return directory, made


def _recording_files(directory: Path) -> list[Path]:
    """Return the files of a directory, which must contain a recording and nothing else."""
    if not directory.is_dir():
        raise BagExistsError(directory, "is not a directory")
    files = list(directory.iterdir())
    for path in files:
        belongs = path.suffix == ".mcap" or path.name in {FILE_NAME, RESERVATION_NAME}
        if not (belongs and stat.S_ISREG(path.lstat().st_mode)):
            raise BagExistsError(
                directory, f"holds '{path.name}', which is not part of a recording; nothing is deleted"
            )
    return files


def _occupied(directory: Path) -> bool:
    """Whether the path is a non-empty directory, another file, or a symbolic link, which is never followed."""
    try:
        if not os.path.lexists(directory):
            return False
        return directory.is_symlink() or not directory.is_dir() or any(directory.iterdir())
    except OSError as error:
        raise UnwritableDirectoryError(directory, f"cannot be read ({error.strerror})") from error
