# SPDX-License-Identifier: Apache-2.0
"""Progress of long computations: reported by the computing code, received by an optional listener."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[int, int], None]

_listener: ContextVar[Listener | None] = ContextVar("progress_listener", default=None)


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Pass progress reported in this context and thread to ``listener(done, total)``."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(done: int, total: int) -> None:
    """Report the steps done and in total; the total may be an estimate and is at least ``done``."""
    listener = _listener.get()
    if listener is not None:
        listener(done, max(done, total))
