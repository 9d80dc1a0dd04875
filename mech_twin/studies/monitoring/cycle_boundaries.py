# SPDX-License-Identifier: Apache-2.0
"""Start of a cycle: the instant an angle crosses its boundary, or a signal rises through its level."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, isnan, nextafter, pi

import numpy as np

from mech_twin.capabilities.cycle import CycleReference
from mech_twin.capabilities.cycle_kernels import TURN, Array, crossed_turn, first_rise

CROSSING_RAD = pi / 12.0  # on either side of a boundary: a line through these samples gives the crossing


@dataclass
class ChannelBuffer:
    """Samples of a channel that may still be needed, and its newest stamp."""

    times_s: Array = field(default_factory=lambda: np.empty(0))
    values: Array = field(default_factory=lambda: np.empty(0))
    newest_s: float = -np.inf

    def add(self, times_s: Array, values: Array) -> None:
        """Append samples later than the newest one; drop earlier ones and those that are not finite."""
        latest = np.maximum.accumulate(np.concatenate([[self.newest_s], times_s]))
        kept = (times_s > latest[:-1]) & np.isfinite(values) & np.isfinite(times_s)
        self.times_s = np.concatenate([self.times_s, times_s[kept]])
        self.values = np.concatenate([self.values, values[kept]])
        if kept.any():
            self.newest_s = float(self.times_s[-1])

    def between(self, begin_s: float, end_s: float) -> tuple[Array, Array]:
        """Return stamps and values of the samples in [begin, end)."""
        first, last = self.times_s.searchsorted(begin_s), self.times_s.searchsorted(end_s)
        return self.times_s[first:last], self.values[first:last]

    def forget(self, before_s: float) -> None:
        """Drop the samples before an instant (s)."""
        first = int(self.times_s.searchsorted(before_s))
        if first > 0:
            self.times_s, self.values = self.times_s[first:], self.values[first:]


def turn_crossing(
    reference: CycleReference, buffer: ChannelBuffer, boundary: float | None, since_s: float
) -> tuple[float, float] | None:
    """Return when the angle (rad) first crosses the boundary, by a line through nearby samples; and the next boundary.

    None while samples are missing.  Without a boundary, the first one ahead of the first sample is taken.
    """
    angles = buffer.values
    if boundary is None:
        turns = ceil((angles[0] + CROSSING_RAD - reference.begin) / TURN)
        boundary = reference.begin + TURN * turns
    first = int(buffer.times_s.searchsorted(since_s))
    crossed_s, following = crossed_turn(buffer.times_s, angles, first, boundary, CROSSING_RAD)
    return None if isnan(crossed_s) else (crossed_s, following)


def rise_crossing(
    reference: CycleReference, buffer: ChannelBuffer, boundary: float | None, since_s: float
) -> tuple[float, float] | None:
    """Return when the signal first rises through the level at or after ``since_s``, interpolated between samples."""
    place = first_rise(buffer.values, int(buffer.times_s.searchsorted(since_s)), reference.begin)
    if place < 0:
        return None
    (t0, t1), (x0, x1) = buffer.times_s[place : place + 2], buffer.values[place : place + 2]
    crossed_s = float(t0 + (t1 - t0) * (reference.begin - x0) / (x1 - x0))
    return max(crossed_s, nextafter(t0, t1)), 0.0  # a rise to 1e300 is at the sample before it, and is not found again
