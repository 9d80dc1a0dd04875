# SPDX-License-Identifier: Apache-2.0
"""Robust standard output and standard error: they may be a terminal that closes, a full disk, or closed from the start.

Output to a closed terminal is discarded without an error: the kernel detaches a terminal before it sends SIGHUP, and
``nohup`` ignores that signal.  A failed write to standard error is discarded too.  A result that cannot be written is
an error, `StandardOutputError`.
"""

import codecs
import errno
import io
import os
import re
import sys
from contextlib import suppress
from typing import Any, TextIO

ESCAPED = "mech_twin.escaped"  # what a terminal's encoding lacks, as JSON escapes
STANDARD_INPUT, STANDARD_OUTPUT, STANDARD_ERROR = 0, 1, 2
_NOT_IN_JSON = re.compile(r"[\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


class StandardOutputError(OSError):
    """A result cannot be written to standard output."""

    def __str__(self) -> str:
        return f"standard output: cannot be written: {self.strerror}"


def printable(text: str) -> str:
    r"""Return a text with control characters and other unprintable ones written as escapes.

    Examples
    --------
    >>> print(printable("N·m \x1b[31m"))
    N·m \x1b[31m
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode("ascii") for c in text)


def printable_json(text: str) -> str:
    """Return JSON with control characters and other unprintable ones written as JSON escapes."""
    return _NOT_IN_JSON.sub(lambda found: f"\\u{ord(found.group()):04x}", text)


def outlive_terminal() -> None:
    """Replace both streams: messages no longer raise errors; standard output that was closed cannot be written."""
    _fill_closed()
    sys.stdout = _outliving(sys.stdout, STANDARD_OUTPUT, _Results)
    sys.stderr = _outliving(sys.stderr, STANDARD_ERROR, _Messages)


def _escaped(error: UnicodeError) -> tuple[str, int]:
    """Return the characters that an encoding lacks as JSON escapes, two beyond the first 65536."""
    assert isinstance(error, UnicodeEncodeError)
    units = error.object[error.start : error.end].encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[i : i + 4]}" for i in range(0, len(units), 4)), error.end


codecs.register_error(ESCAPED, _escaped)


def give_up_output() -> None:
    """Redirect standard output to the null device, as the interpreter's last flush would fail again."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _fill_closed() -> None:
    """Open the null device for closed standard streams, so that no other file gets their descriptors and the output."""
    ways = {STANDARD_INPUT: os.O_RDONLY, STANDARD_OUTPUT: os.O_RDONLY, STANDARD_ERROR: os.O_WRONLY}
    for number, way in ways.items():  # in rising order: open() takes the lowest free descriptor
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, way), True)


def _outliving(stream: TextIO | None, number: int, kind: type[io.FileIO]) -> TextIO:
    """Return a text stream on a file of this class; ``stream`` is None if the program was started with it closed."""
    try:
        descriptor = number if stream is None else stream.fileno()
    except (OSError, ValueError):  # not a file, but a test's stream
        assert stream is not None
        return stream
    encoding, errors = ("utf-8", "strict") if stream is None else (stream.encoding, stream.errors)
    if number == STANDARD_OUTPUT and codecs.lookup(encoding).name != "utf-8":
        errors = ESCAPED
    file = kind(descriptor, "w", closefd=False)
    lines = number == STANDARD_ERROR or file.isatty()
    return io.TextIOWrapper(io.BufferedWriter(file), encoding=encoding, errors=errors, line_buffering=lines)


class _Results(io.FileIO):
    def write(self, data: Any, /) -> int:
        """Return the number of bytes written, or discarded after the terminal has closed."""
        try:
            return super().write(data)
        except BrokenPipeError:  # the reader has closed the pipe
            raise
        except OSError as error:
            if error.errno != errno.EIO:
                raise StandardOutputError(error.errno, error.strerror) from error
            return memoryview(data).nbytes


class _Messages(io.FileIO):
    def write(self, data: Any, /) -> int:
        """Return the number of bytes written, or discarded after an error."""
        try:
            return super().write(data)
        except OSError:
            return memoryview(data).nbytes
