"""How a bag is refused: the file, the reason, and where there is one the remedy, in one line."""

from __future__ import annotations

from pathlib import Path


class BagError(Exception):
    """A bag that cannot be used; the message is one line for the user.

    Attributes
    ----------
    file : Path
        What was refused.
    reason : str
        Why, and what to do about it.
    """

    def __init__(self, file: Path | str, reason: str) -> None:
        self.file = Path(file)
        self.reason = " ".join(reason.split())
        super().__init__(f"{self.file}: {self.reason}")


class MissingBagError(BagError):
    """There is nothing at this path, or it may not be read."""


class ForeignFileError(BagError):
    """The file is no MCAP recording."""


class UnfinishedBagError(BagError):
    """The recording was never closed, or still runs."""

    def __init__(self, file: Path | str, reason: str) -> None:
        super().__init__(file, f"{reason}; if no recorder is running, recover it: mech-twin recover {file} OUT")


class DamagedBagError(BagError):
    """The bytes of the recording contradict each other."""

    def __init__(self, file: Path | str, reason: str) -> None:
        super().__init__(file, f"{reason}; save what is intact: mech-twin recover {file} OUT")


class BagBeyondLimitsError(BagError):
    """Reading the bag would need more memory than this reader grants to any file."""


class BagExistsError(BagError):
    """A recording is never written over another one."""


class UnwritableDirectoryError(BagError):
    """The directory cannot be made or written."""


class UnknownTypeError(LookupError):
    """No definition of this message type is installed."""


class DecodeError(ValueError):
    """These bytes are not a message of this type."""
