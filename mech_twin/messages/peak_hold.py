# SPDX-License-Identifier: Apache-2.0
"""Decimation that keeps extremes: of each window the greatest goes out, so that spikes survive."""

from __future__ import annotations

from typing import Generic, TypeVar

Kept = TypeVar("Kept")


class PeakHoldWindow(Generic[Kept]):
    """Window over a stream.

    Parameters
    ----------
    length : int
        Items in a window.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._seen = 0
        self._largest = -1.0
        self._kept: Kept | None = None

    def offer(self, magnitude: float, item: Kept) -> Kept | None:
        """Take an item into account; at the end of a window return its greatest."""
        if magnitude > self._largest:
            self._largest, self._kept = magnitude, item
        self._seen += 1
        return self.rest() if self._seen >= self._length else None

    def rest(self) -> Kept | None:
        """End the window here and return its greatest, if it saw anything."""
        kept = self._kept
        self._seen, self._largest, self._kept = 0, -1.0, None
        return kept
