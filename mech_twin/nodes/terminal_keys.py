# SPDX-License-Identifier: Apache-2.0
"""Single keys from the terminal, where somebody sits at one."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from contextlib import suppress
from types import TracebackType
from typing import Any


class TerminalKeys:
    """While this context is open, keys arrive at once and are not echoed; without a terminal there are none."""

    def __init__(self) -> None:
        self._fd: int | None = None
        self._before: list[Any] = []

    @property
    def listening(self) -> bool:
        """Whether there is a terminal to listen to."""
        return self._fd is not None

    def __enter__(self) -> TerminalKeys:
        fd = _terminal()
        if fd is not None:
            self._before = termios.tcgetattr(fd)
            tty.setcbreak(fd)
            self._fd = fd
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._fd is not None:
            with suppress(termios.error):  # the terminal has closed
                termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)
            self._fd = None

    def pressed(self) -> str:
        """Return the keys pressed since the last call."""
        if self._fd is None or not select.select([self._fd], [], [], 0.0)[0]:
            return ""
        try:
            keys = os.read(self._fd, 64)
        except OSError:
            keys = b""
        if not keys:  # the terminal is gone
            self._fd = None
        return keys.decode("ascii", "ignore")


def _terminal() -> int | None:
    """Return the terminal on standard input, unless this process runs behind the one in front of it."""
    try:
        fd = sys.stdin.fileno()
        return fd if os.isatty(fd) and os.tcgetpgrp(fd) == os.getpgrp() else None
    except (OSError, ValueError, AttributeError):
        return None
