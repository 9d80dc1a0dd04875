# SPDX-License-Identifier: Apache-2.0
"""How far a long answer is: whoever computes it tells, whoever asked may listen; nobody needs to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[int, int], None]

_listener: ContextVar[Listener | None] = ContextVar("progress_listener", default=None)


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Pass what is told meanwhile in this thread to ``listener(done, total)``."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(done: int, total: int) -> None:
    """Report the number of steps done and in total; the total may be an estimate, at least the number done."""
    listener = _listener.get()
    if listener is not None:
        listener(done, max(done, total))
