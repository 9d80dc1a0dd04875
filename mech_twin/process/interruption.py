# SPDX-License-Identifier: Apache-2.0
"""Places where a signal handler may raise an exception, and how the process ends at other places.

A process can end when the one that started it does, even by SIGKILL (Linux).

SIGINT, SIGTERM and SIGHUP become exceptions where safe, or a stop request to be polled.  Where an exception is not
safe, the signal is sent again a little later; while a kernel is compiled or a module is imported, the process ends at
once.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from signal import SIG_IGN, SIGHUP, SIGINT, SIGTERM, Signals, getsignal, pthread_kill, raise_signal
from types import FrameType
from typing import Any, ClassVar, NoReturn

SIGNALS = (SIGINT, SIGTERM, SIGHUP)
EXIT_CODE_BASE = 128  # plus the signal number: exit code of a process ended by a signal
INTERRUPTED_LINE = "mech-twin: interrupted\n"
RETRY_S = 0.005
COMPILER = ("numba", "llvmlite")
IMPORTING = "importlib._bootstrap"
MAIN_THREAD = threading.main_thread().ident
PR_SET_PDEATHSIG = 1


def answered_signals() -> tuple[Signals, ...]:
    """Return the signals to handle: without SIGHUP under ``nohup``, so that a run outlives its terminal."""
    return tuple(number for number in SIGNALS if number != SIGHUP or getsignal(number) is not SIG_IGN)


def is_in_wrapper(frame: FrameType | None) -> bool:
    """Return whether the result of a compiled function is being wrapped: an exception there is a segmentation fault.

    The wrapper constructs named tuples, and does not check whether that failed.
    """
    return frame is not None and str(frame.f_globals.get("__name__", "")).startswith("namedtuple_")


def is_in_compiler(frame: FrameType | None) -> bool:
    """Return whether a kernel is being compiled.

    The compiler calls Python from finalizers and C callbacks, which drop an exception: the process would continue to
    compile, or continue without the kernel.
    """
    return any(module.partition(".")[0] in COMPILER for module in _modules(frame))


def is_importing(frame: FrameType | None) -> bool:
    """Return whether a module is being imported.

    An exception there may be dropped by a callback of the import system, or replaced by another one when a class is
    being created.
    """
    return IMPORTING in _modules(frame)


def _modules(frame: FrameType | None) -> Iterator[str]:
    """Yield the names of the modules that a frame and its callers are of."""
    while frame is not None:
        yield str(frame.f_globals.get("__name__", ""))
        frame = frame.f_back


class UninterruptedLock:
    """A reentrant lock that delays signals to the main thread, while this holds it, until the release.

    An exception in between would leave the guarded data half changed.
    """

    _depth = 0  # number of such locks that the main thread holds or waits for
    _held_back: ClassVar[list[int]] = []

    def __init__(self) -> None:
        self._lock = threading.RLock()

    @classmethod
    def holds_back(cls, number: int) -> bool:
        """Delay a signal if the main thread holds such a lock; return whether it does."""
        if cls._depth:
            cls._held_back.append(number)
        return cls._depth > 0

    def __enter__(self) -> None:
        """Count before acquiring, so that a later signal is delayed."""
        if threading.get_ident() == MAIN_THREAD:
            UninterruptedLock._depth += 1
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        """Release the lock, and raise a delayed signal."""
        self._lock.release()
        if threading.get_ident() == MAIN_THREAD:
            UninterruptedLock._depth -= 1
            if self._held_back and not self._depth:
                number = self._held_back.pop()
                self._held_back.clear()
                raise_signal(number)


def send_after_wrapper(number: int, frame: FrameType | None) -> None:
    """Raise the signal again when the function that called a wrapper continues.

    A signal during a kernel's computation is first handled in the wrapper of its result: sent again by a timer, it
    could hit only wrappers every time.
    """
    while is_in_wrapper(frame):
        frame = frame.f_back  # type: ignore[union-attr]  # a wrapper is not None
    if frame is None or sys.gettrace() is not None:  # a debugger or coverage tool uses the trace already
        send_again(number)
        return

    def trace(*_: object) -> None:
        sys.settrace(None)
        raise_signal(number)

    frame.f_trace = trace
    sys.settrace(lambda *_: None)  # traces no calls, only the marked frame


def tell_interrupted() -> None:
    """Write `INTERRUPTED_LINE` to standard error, if possible now."""
    with suppress(OSError, ValueError, AttributeError, RuntimeError):  # RuntimeError: it is being written to
        sys.stderr.write(INTERRUPTED_LINE)


def send_again(number: int) -> None:
    """Send the signal to the main thread again after `RETRY_S`."""
    again = threading.Timer(RETRY_S, pthread_kill, (threading.main_thread().ident, number))
    again.daemon = True
    again.start()


def end_at_once(code: int) -> NoReturn:
    """Flush output and exit without shutdown of interpreter and compiler, which takes up to 1 s; close files before."""
    for stream in (sys.stdout, sys.stderr):
        # the reader is gone, there is no stream, or it is being written to
        with suppress(OSError, ValueError, AttributeError, RuntimeError):
            stream.flush()
    os._exit(code)


def end_with_parent(parent: int, number: int = signal.SIGTERM) -> None:
    """Let the kernel send a signal when the parent process ends; exit at once if it has ended already.

    Raises
    ------
    OSError
        If the kernel refuses.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, number) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    if os.getppid() != parent:
        end_at_once(EXIT_CODE_BASE + number)


Handler = Callable[[int, FrameType | None], None]
_to_close: list[bool] = []
_raised: list[int] = []


def raised_signal() -> int:
    """Return the signal that was last raised as an exception since `interruptible` began, 0 without one.

    A C library that calls Python may raise an error of its own in the place of that exception.
    """
    return _raised[-1] if _raised else 0


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on SIGINT, and SystemExit 128 + N on SIGTERM and SIGHUP, where that is safe."""
    before = _handled(_raise)
    _raised.clear()
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
        _raised.append(number)
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
    _raised.append(number)
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
