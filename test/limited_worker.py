# SPDX-License-Identifier: Apache-2.0
"""A process that takes one piece of work at a time, and is ended where it does not come back."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any


class NoAnswerError(Exception):
    """The work ended its process, or did not end."""


class LimitedWorker:
    """Another process that applies a function; a new one takes the place of one that was lost.

    Parameters
    ----------
    function : callable
        Importable by name; its argument and its result are pickled.
    limit_s : float
        Longest time for one piece of work (s).
    """

    def __init__(self, function: Callable[[Any], Any], limit_s: float) -> None:
        self._function, self._limit_s = function, limit_s
        self._begin()

    def answer(self, work: Any) -> Any:
        """Return the function's result.

        Raises
        ------
        NoAnswerError
            If the process ends, or the time is over.
        """
        self._pipe.send(work)
        reason = f"does not end within {self._limit_s:g} s"
        try:
            if self._pipe.poll(self._limit_s):
                return self._pipe.recv()
        except EOFError:
            reason = "ended the process"
        self.close()
        self._begin()
        raise NoAnswerError(reason)

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self._pipe.close()

    def _begin(self) -> None:
        self._pipe, other = multiprocessing.Pipe()
        context = multiprocessing.get_context("spawn")
        self._process = context.Process(target=_serve, args=(self._function, other), daemon=True)
        self._process.start()
        other.close()


def _serve(function: Callable[[Any], Any], pipe: Connection) -> None:
    while True:
        try:
            work = pipe.recv()
        except EOFError:
            return
        pipe.send(function(work))
