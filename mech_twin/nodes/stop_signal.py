"""SIGINT, SIGTERM and SIGHUP as a request to stop, so that what is under way is finished and closed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

from mech_twin.interruption import end_at_once, is_in_compiler, is_in_wrapper, send_again

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
EXIT_CODE_BASE = 128


class StopSignal:
    """While this context is open, a signal sets ``asked``; it interrupts only what is marked `interrupting`."""

    def __init__(self) -> None:
        self.asked = False
        self._interrupts = False
        self._before: dict[signal.Signals, Any] = {}

    @contextmanager
    def interrupting(self) -> Iterator[None]:
        """Let a signal end what is done here, code 128 + signal number: the process at once while it compiles.

        So nothing may be open here that needs closing; elsewhere than in the compiler it is SystemExit.
        """
        self._interrupts = True
        try:
            yield
        finally:
            self._interrupts = False

    def __enter__(self) -> StopSignal:
        self._before = {number: signal.signal(number, self._on_signal) for number in SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the signals back; once a stop was asked for, a further Ctrl-C no longer disturbs what it set going."""
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if self.asked and number == signal.SIGINT else handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        if not self._interrupts:
            return
        if is_in_wrapper(frame):
            send_again(number)
        elif is_in_compiler(frame):
            end_at_once(EXIT_CODE_BASE + number)
        else:
            self._interrupts = False  # a second one must not interrupt the clearing up
            raise SystemExit(EXIT_CODE_BASE + number)
