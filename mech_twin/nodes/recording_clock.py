# SPDX-License-Identifier: Apache-2.0
"""The time of a recording: that of the newest step of the run that is followed.  Knows no ROS."""

from __future__ import annotations

NS_PER_S = 1_000_000_000
LARGEST_NS = 10**9 * NS_PER_S  # later than 30 years of simulated time: somebody's wall clock
SAME_RUN_NS = 10 * NS_PER_S


class RecordingClock:
    """Log time of what is recorded."""

    def __init__(self) -> None:
        self._now_ns: int | None = None

    @property
    def now_ns(self) -> int:
        """Time of the newest step; 0 before the first."""
        return 0 if self._now_ns is None else self._now_ns

    def lead(self, stamp_ns: int) -> bool:
        """Go to the time of the linkage's step; return whether it is a time a run can have."""
        plausible = 0 <= stamp_ns < LARGEST_NS
        if plausible:
            self._now_ns = stamp_ns
        return plausible

    def belongs(self, stamp_ns: int) -> bool:
        """Return whether a stamp is near the time of the run; before the first step any plausible one is."""
        if self._now_ns is None:
            return 0 <= stamp_ns < LARGEST_NS
        return stamp_ns >= 0 and abs(stamp_ns - self._now_ns) <= SAME_RUN_NS
