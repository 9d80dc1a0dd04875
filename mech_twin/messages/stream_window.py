# SPDX-License-Identifier: Apache-2.0
"""Decimation of streams: samples keep those around impacts, scalar quantities the largest of each window.

::

    step      0  1  2  3  4  5  6  7  8  9 10 11 ...        window of 10 steps
    sent      o                 o  o        o               at step 7 an impact: 6 is before it, 7 after
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Generic, TypeVar

from mech_twin.samples import Event, Load, Wrench

Kept = TypeVar("Kept")

STREAM_RATE_HZ = 100.0


def steps_per_window(rate_hz: float, step_s: float) -> int:
    """Return the number of coupling steps per window of a stream; 1 if the rate (Hz) is that of the steps or higher."""
    return max(1, round(1.0 / (rate_hz * step_s)))


def has_impact(happenings: Sequence[Event] | Sequence[Load]) -> bool:
    """Return whether one of these events or loads has an impulse."""
    if not happenings:
        return False
    return any((each.impulse_ns if isinstance(each, Event) else each.impulse_nms) != 0.0 for each in happenings)


def wrench_size(wrench: Wrench) -> float:
    """Return the magnitude for comparing wrenches in decimation: force (N) plus moment (N m)."""
    return math.hypot(wrench.force_x_n, wrench.force_y_n) + abs(wrench.moment_nm)


class StreamWindow(Generic[Kept]):
    """Selects items of a stream: the first of each window, those around an impact, and the largest of the window.

    Items are returned in order, each at most once.

    Parameters
    ----------
    length : int
        Steps in a window; windows begin at its multiples.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._before: Kept | None = None
        self._greatest: Kept | None = None
        self._largest = 0.0

    def offer(self, step: int, item: Kept, magnitude: float = 0.0, impact: bool = False) -> tuple[Kept, ...]:
        """Add the item of a step; return the items to publish now.

        Parameters
        ----------
        step : int
            Index of the step.
        item : Kept
            Item of the step.
        magnitude : float
            Magnitude for the largest of a window; if always 0, no largest is selected.
        impact : bool
            Whether an impact occurred in the step that ends here.
        """
        begins = step % self._length == 0
        if begins or impact:
            due = (*self.rest(), *(() if self._before is None or not impact else (self._before,)), item)
            self._before = None
            self._largest = magnitude if begins else max(self._largest, magnitude)
            return due
        if magnitude > self._largest:
            self._largest, self._greatest, self._before = magnitude, item, item
        else:
            self._before = item
        return ()

    def rest(self) -> tuple[Kept, ...]:
        """Return the largest item of the window so far, if not yet returned."""
        greatest, self._greatest = self._greatest, None
        if greatest is None:
            return ()
        if greatest is self._before:
            self._before = None
        return (greatest,)


class PeakHoldWindow(Generic[Kept]):
    """Selects items of a stream: the largest of each window, so that peaks are kept.

    Parameters
    ----------
    length : int
        Items in a window.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._seen = 0
        self._largest = -1.0
        self._kept: tuple[Kept, ...] = ()

    def offer(self, magnitude: float, item: Kept) -> tuple[Kept, ...]:
        """Offer an item; at the end of a window return that of the largest magnitude."""
        if magnitude > self._largest:
            self._largest, self._kept = magnitude, (item,)
        self._seen += 1
        return self.rest() if self._seen >= self._length else ()

    def rest(self) -> tuple[Kept, ...]:
        """End the window here, and return its largest item if it has any."""
        kept = self._kept
        self._seen, self._largest, self._kept = 0, -1.0, ()
        return kept
