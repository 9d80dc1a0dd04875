# SPDX-License-Identifier: Apache-2.0
"""Where a signal may raise an exception, and how a process ends where it may not."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress
from signal import SIG_IGN, SIGHUP, SIGINT, SIGTERM, Signals, getsignal, pthread_kill, raise_signal
from types import FrameType
from typing import ClassVar, NoReturn

SIGNALS = (SIGINT, SIGTERM, SIGHUP)
EXIT_CODE_BASE = 128  # of a process that a signal ends, and its number
INTERRUPTED_LINE = "mech-twin: interrupted\n"
RETRY_S = 0.005
COMPILER = ("numba", "llvmlite")
IMPORTING = "importlib._bootstrap"
MAIN_THREAD = threading.main_thread().ident


def answered_signals() -> tuple[Signals, ...]:
    """Return the signals to answer: under ``nohup``, which ignores SIGHUP, a run outlives its terminal."""
    return tuple(number for number in SIGNALS if number != SIGHUP or getsignal(number) is not SIG_IGN)


def is_in_wrapper(frame: FrameType | None) -> bool:
    """Return whether a compiled function's result is being wrapped: an exception there is a segmentation fault.

    The wrapper constructs named tuples and does not expect that to fail.
    """
    return frame is not None and str(frame.f_globals.get("__name__", "")).startswith("namedtuple_")


def is_in_compiler(frame: FrameType | None) -> bool:
    """Return whether a kernel is being compiled.

    The compiler calls Python from finalizers and from callbacks of C, which drop an exception: the process would go on
    compiling, or go on with a kernel that is not there.
    """
    while frame is not None:
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] in COMPILER:
            return True
        frame = frame.f_back
    return False


def is_importing(frame: FrameType | None) -> bool:
    """Return whether a module is being imported.

    An exception there may be dropped by a callback of the import system, or turned into another one by the class that
    is being made.
    """
    while frame is not None:
        if frame.f_globals.get("__name__") == IMPORTING:
            return True
        frame = frame.f_back
    return False


class UninterruptedLock:
    """A reentrant lock; a signal to the main thread while that holds it comes when it is released.

    An exception in between would leave what the lock guards half changed.
    """

    _depth = 0  # of all locks that the main thread holds or waits for
    _held_back: ClassVar[list[int]] = []

    def __init__(self) -> None:
        self._lock = threading.RLock()

    @classmethod
    def holds_back(cls, number: int) -> bool:
        """Keep a signal for later, if the main thread holds such a lock; return whether that is so."""
        if cls._depth:
            cls._held_back.append(number)
        return cls._depth > 0

    def __enter__(self) -> None:
        """Count first: a signal after that waits."""
        if threading.get_ident() == MAIN_THREAD:
            UninterruptedLock._depth += 1
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        """Release, and send what was held back."""
        self._lock.release()
        if threading.get_ident() == MAIN_THREAD:
            UninterruptedLock._depth -= 1
            if self._held_back and not self._depth:
                number = self._held_back.pop()
                self._held_back.clear()
                raise_signal(number)


def send_after_wrapper(number: int, frame: FrameType | None) -> None:
    """Send the main thread the signal again as the function that called a wrapper goes on.

    A signal that comes while a kernel computes is seen first in the wrapper of its result: sent again by the clock, it
    could meet every wrapper and nothing else.
    """
    while is_in_wrapper(frame):
        frame = frame.f_back  # type: ignore[union-attr]  # a wrapper is not None
    if frame is None or sys.gettrace() is not None:  # a debugger or a measure of coverage traces already
        send_again(number)
        return

    def trace(*_: object) -> None:
        sys.settrace(None)
        raise_signal(number)

    frame.f_trace = trace
    sys.settrace(lambda *_: None)  # calls are not traced, but the marked function is


def tell_interrupted() -> None:
    """Write the line of an interrupted program to standard error, if that can be done now."""
    with suppress(OSError, ValueError, AttributeError, RuntimeError):  # RuntimeError: it is being written to
        sys.stderr.write(INTERRUPTED_LINE)


def send_again(number: int) -> None:
    """Send the main thread the signal again a little later."""
    again = threading.Timer(RETRY_S, pthread_kill, (threading.main_thread().ident, number))
    again.daemon = True
    again.start()


def end_at_once(code: int) -> NoReturn:
    """End the process without taking down interpreter and compiler, which takes up to a second; all is closed."""
    for stream in (sys.stdout, sys.stderr):
        # nobody reads it any more, there is none, or it is being written to
        with suppress(OSError, ValueError, AttributeError, RuntimeError):
            stream.flush()
    os._exit(code)
