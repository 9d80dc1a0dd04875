"""SIGINT, SIGTERM and SIGHUP: as exceptions where those are safe, or as a request to stop that is asked for later.

The wrappers of compiled functions construct named tuples and do not expect that to fail: an exception raised by a
signal handler there ends in a segmentation fault.  In that case the signal is sent again a little later.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
EXIT_CODE_BASE = 128
RETRY_S = 0.001

Handler = Callable[[int, FrameType | None], None]


@contextmanager
def interruptible() -> Iterator[None]:
    """Turn SIGINT into KeyboardInterrupt, and SIGTERM and SIGHUP into SystemExit 128 + N, where that is safe."""
    before = _handled(_raise)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class StopSignal:
    """While this context is open, a signal sets ``asked``; it interrupts only what is marked `interrupting`."""

    def __init__(self) -> None:
        self.asked = False
        self._interrupts = False
        self._before: dict[signal.Signals, Any] = {}

    @contextmanager
    def interrupting(self) -> Iterator[None]:
        """Let a signal end what is done here at once, such as compiling: SystemExit, code 128 + signal number."""
        self._interrupts = True
        try:
            yield
        finally:
            self._interrupts = False

    def __enter__(self) -> StopSignal:
        self._before = _handled(self._on_signal)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the signals back; once a stop was asked for, a further Ctrl-C no longer disturbs what it set going."""
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if self.asked and number == signal.SIGINT else handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        if not self._interrupts or _sent_again(number, frame):
            return
        self._interrupts = False  # a second one must not interrupt the clearing up
        raise SystemExit(EXIT_CODE_BASE + number)


def _handled(handler: Handler) -> dict[signal.Signals, Any]:
    """Set the handler of every signal; return those before."""
    return {number: signal.signal(number, handler) for number in SIGNALS}


def _raise(number: int, frame: FrameType | None) -> None:
    if _sent_again(number, frame):
        return
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(EXIT_CODE_BASE + number)


def _sent_again(number: int, frame: FrameType | None) -> bool:
    """Send the signal again a little later if an exception is not safe now; return whether that was so."""
    if frame is None or not str(frame.f_globals.get("__name__", "")).startswith("namedtuple_"):
        return False
    again = threading.Timer(RETRY_S, signal.pthread_kill, (threading.main_thread().ident, number))
    again.daemon = True
    again.start()
    return True
