# SPDX-License-Identifier: Apache-2.0
"""Errors of recordings: one line with file, reason and, if known, remedy."""

from pathlib import Path

from mech_twin.errors import FileError


class BagError(FileError):
    """A bag that cannot be used; the message is one line for the user."""


class MissingBagError(BagError):
    """The path does not exist or cannot be read."""


class MissingPartError(MissingBagError):
    """A file of a bag in sqlite3 storage, which `recover` does not support, is missing."""

    def __init__(self, bag: Path, file: Path, index: str) -> None:
        super().__init__(file, f"is listed in {index} but does not exist; to read the rest, move {bag / index} away")


class ForeignFileError(BagError):
    """The file is not an MCAP recording."""


class UnfinishedBagError(BagError):
    """The recording was never closed, or is still being written."""

    def __init__(self, file: Path | str, reason: str) -> None:
        super().__init__(file, f"{reason}; if no recorder is running, {salvage(file)}")


class DamagedBagError(BagError):
    """The recording is corrupt; the default remedy is `recover`."""

    def __init__(self, file: Path | str, reason: str, remedy: str = "") -> None:
        super().__init__(file, f"{reason}; {remedy or salvage(file)}")


def salvage(bag: Path | str) -> str:
    """Return the remedy for a bag that `recover` supports; for a file of a directory that is the whole bag."""
    directory = Path(bag).parent
    whole = directory if Path(bag).is_file() and (directory / "metadata.yaml").exists() else bag
    return f"salvage the intact part: mech-twin recover {whole} OUT"


class OutsideBagError(BagError):
    """A file of the bag lies outside its directory."""


class BagBeyondLimitsError(BagError):
    """Reading the bag would exceed the reader's memory limit."""


class BagExistsError(BagError):
    """The output exists; recordings are never overwritten."""


class UnwritableDirectoryError(BagError):
    """The directory cannot be created or written."""


class UnknownTypeError(LookupError):
    """The message type is not installed."""


class DecodeError(ValueError):
    """The bytes are not a message of this type."""
