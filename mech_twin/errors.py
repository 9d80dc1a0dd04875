# SPDX-License-Identifier: Apache-2.0
"""Errors of studies, motions, stored states, measurements and the view; each message is one line for the user."""

from pathlib import Path
from typing import Any


class OneLineError(Exception):
    """An error whose message is one line for the user."""


class RerunSceneError(OneLineError):
    """The view cannot show the run or write its file; the message is one line."""


class ViewerError(OneLineError):
    """The page cannot be served; the message is one line."""


class SentError(OneLineError):
    """An error made of more than its line, which a process sends to another one whole."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _received, (type(self), str(self), vars(self))


def _received(kind: type[SentError], line: str, parts: dict[str, Any]) -> SentError:
    """Return an error as another process raised it."""
    error = kind.__new__(kind, line)
    vars(error).update(parts)
    return error


class FileError(SentError):
    """An unusable file or directory, and the reason: why it was refused and what to do."""

    def __init__(self, file: Path | str, reason: str) -> None:
        self.file = Path(file)
        self.reason = " ".join(reason.split())
        super().__init__(f"{self.file}: {self.reason}")


class MeasurementError(FileError):
    """An unusable measurement; the message is one line for the user."""


class MotionError(OneLineError, ArithmeticError):
    """A step for which the integration fails or which has too many events; one line for the user."""


class StateError(ValueError):
    """A text that is no state of a machine, or a state that cannot be stored; one line for the user."""


class StudyError(OneLineError, ValueError):
    """An error in the request; the message is one line for the user."""


class UnknownNameError(StudyError, KeyError):
    """An unknown name; the message lists similar ones."""

    def __str__(self) -> str:  # KeyError would quote the message
        return str(self.args[0])
