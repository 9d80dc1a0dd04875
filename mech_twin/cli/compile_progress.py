# SPDX-License-Identifier: Apache-2.0
"""What a terminal is told while kernels compile: that they do, how many so far, and at the end that they are kept.

Nothing is imported for it: the compiler's own first line on its logger is what begins it.  Whole lines, at growing
intervals, so that they disturb no status line and no table.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LOGGER = "mech_twin.kernels"
FIRST_TOLD_S = 5.0
GROWTH = 2.0  # of the time until the next line


class CompileProgress(logging.Handler):
    """Handler of the compiler's logger.

    Parameters
    ----------
    write : callable
        Takes a line with its end.
    clock : callable, optional
        Time in seconds.
    """

    def __init__(self, write: Callable[[str], object], clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(logging.INFO)
        self._write, self._clock = write, clock
        self._begun_s = clock()
        self._due_s = FIRST_TOLD_S
        self._count = 0
        self._end: Callable[[], None] | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a line of the compiler on; the one with which it begins starts the counting."""
        self._write(f"{record.getMessage()}\n")
        if record.levelno == logging.INFO and self._end is None:
            from mech_twin.kernels.cache import on_compile

            self._begun_s = self._clock()
            self._end = on_compile(self.compiling)

    def compiling(self, kernel: str, count: int) -> None:
        """Take note of the kernel that is compiled now, the ``count``-th; say so where a line is due."""
        self._count, spent_s = count, self._clock() - self._begun_s
        if spent_s >= self._due_s:
            self._due_s = GROWTH * spent_s
            self._write(f"  kernels compiled: {count - 1} in {spent_s:.0f} s, going on\n")

    def close(self) -> None:
        """Say what was compiled, if anything was, and observe no longer."""
        if self._end is not None:
            self._end()
            self._end = None
            spent_s = self._clock() - self._begun_s
            if spent_s >= FIRST_TOLD_S:
                self._write(f"  kernels compiled: {self._count}; they are kept, the next time begins at once\n")
        super().close()


def _to_standard_error(line: str) -> None:
    """Write a line to whatever standard error is now: a progress bar that runs moves out of its way."""
    sys.stderr.write(line)


@contextmanager
def compiling_shown() -> Iterator[None]:
    """Show on a terminal how compiling goes; elsewhere do nothing."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield
        return
    logger, handler = logging.getLogger(LOGGER), CompileProgress(_to_standard_error)
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        handler.close()
