# SPDX-License-Identifier: Apache-2.0
"""How much of a node's time requests from outside may take, however often somebody asks."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Ration:
    """A share of the time of the wall clock, with a burst: what is taken is paid back at that share.

    Parameters
    ----------
    share : float
        Part of the time that requests may take.
    burst_s : float
        Work that may be owed and one more request still be taken (s).
    """

    def __init__(self, share: float, burst_s: float = 0.0) -> None:
        self._share = share
        self._ahead_s = burst_s / share
        self._even_s = 0.0  # when what was taken is paid back

    def refusal(self) -> str:
        """Return why one more request is refused; empty if it is not."""
        wait_s = self._even_s - time.monotonic() - self._ahead_s
        return f"asked too often: ask again in {max(wait_s, 0.1):.1f} s" if wait_s > 0.0 else ""

    @contextmanager
    def taking(self, least_s: float = 0.0) -> Iterator[None]:
        """Count the time within as taken, or more where what it sets off elsewhere takes more."""
        begun = time.monotonic()
        try:
            yield
        finally:
            now = time.monotonic()
            self._even_s = max(self._even_s, now) + max(now - begun, least_s) / self._share
