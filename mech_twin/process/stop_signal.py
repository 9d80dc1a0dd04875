# SPDX-License-Identifier: Apache-2.0
"""Handling of SIGINT, SIGTERM and SIGHUP: as exceptions where safe, or as a stop request to be polled.

Where an exception is not safe (`mech_twin.process.interruption`) the signal is sent again a little later; while a
kernel is compiled or a module is imported, the process ends at once.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from mech_twin.process.interruption import (
    EXIT_CODE_BASE,
    UninterruptedLock,
    answered_signals,
    end_at_once,
    is_importing,
    is_in_compiler,
    is_in_wrapper,
    send_after_wrapper,
    send_again,
    tell_interrupted,
)

Handler = Callable[[int, FrameType | None], None]
_to_close: list[bool] = []


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on SIGINT, and SystemExit 128 + N on SIGTERM and SIGHUP, where that is safe."""
    before = _handled(_raise)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def closed_first() -> Iterator[None]:
    """Postpone signals while kernels or modules are loaded in the block, as it has open resources."""
    _to_close.append(True)
    try:
        yield
    finally:
        _to_close.pop()


@contextmanager
def raising_interrupt() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt in the block, delayed until it is safe; for functions called from Python.

    Changes nothing where a handler other than Python's own is set, or outside of the main thread.
    """
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):
        yield
        return
    signal.signal(signal.SIGINT, _raise_when_safe)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


class StopSignal:
    """A context in which a signal sets ``asked`` and ``number``; it interrupts only a block of `interrupting`."""

    def __init__(self) -> None:
        self.asked = False
        self.number = 0
        self._interrupts = False
        self._before: dict[signal.Signals, Any] = {}

    @contextmanager
    def interrupting(self) -> Iterator[None]:
        """Let a signal end the block with SystemExit 128 + N, at once even while it compiles or imports.

        So nothing may be open in it that needs closing.  Within `closed_first` a signal only requests a stop.  An
        earlier signal ends the block at its start.
        """
        self._interrupts = True
        try:
            if self.asked:
                raise SystemExit(EXIT_CODE_BASE + self.number)
            yield
        finally:
            self._interrupts = False

    def __enter__(self) -> StopSignal:
        self._before = _handled(self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the signal handlers; after a stop request Ctrl-C is ignored, so as not to disturb the shutdown."""
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if self.asked and number == signal.SIGINT else handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.asked, self.number = True, number
        if not self._interrupts or _to_close or _sent_again(number, frame):
            return
        if is_in_compiler(frame) or is_importing(frame):
            end_at_once(EXIT_CODE_BASE + number)
        self._interrupts = False  # a second signal must not interrupt the clean-up
        raise SystemExit(EXIT_CODE_BASE + number)


def _handled(handler: Handler) -> dict[signal.Signals, Any]:
    """Set the handler of all handled signals; return the previous handlers."""
    return {number: signal.signal(number, handler) for number in answered_signals()}


def _raise(number: int, frame: FrameType | None) -> None:
    if _sent_again(number, frame):
        return
    if is_in_compiler(frame) or is_importing(frame):
        if _to_close:
            send_again(number)
            return
        if number == signal.SIGINT:
            tell_interrupted()
        end_at_once(EXIT_CODE_BASE + number)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(EXIT_CODE_BASE + number)


def _raise_when_safe(number: int, frame: FrameType | None) -> None:
    if is_in_compiler(frame):
        send_again(number)
        return
    if not _sent_again(number, frame):
        raise KeyboardInterrupt


def _sent_again(number: int, frame: FrameType | None) -> bool:
    """Postpone the signal if an exception is not safe now; return whether it was postponed."""
    if UninterruptedLock.holds_back(number):
        return True
    if is_in_wrapper(frame):
        send_after_wrapper(number, frame)
        return True
    return False
