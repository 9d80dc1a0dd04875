# SPDX-License-Identifier: Apache-2.0
"""Standard output and standard error at a terminal: once it has closed, what is written is lost, and no error.

The kernel takes a terminal away before it sends SIGHUP, and under ``nohup`` sends none that is answered; a status line
must not end a run then.
"""

from __future__ import annotations

import errno
import io
import sys
from typing import Any, TextIO


def outlive_terminal() -> None:
    """From here on let nothing that is written to a closed terminal raise an error."""
    sys.stdout = _outliving(sys.stdout)
    sys.stderr = _outliving(sys.stderr)


def _outliving(stream: TextIO) -> TextIO:
    if stream is None or not stream.isatty():  # None: the program was started with the stream closed
        return stream
    buffer = io.BufferedWriter(_Terminal(stream.fileno(), "w", closefd=False))
    return io.TextIOWrapper(buffer, encoding=stream.encoding, errors=stream.errors, line_buffering=True)


class _Terminal(io.FileIO):
    def write(self, data: Any, /) -> int:
        """Return the number of bytes written, or lost with the terminal."""
        try:
            return super().write(data)
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            return memoryview(data).nbytes
