# SPDX-License-Identifier: Apache-2.0
"""When the next step is due by the clock, and what is told of a run that falls behind.  Knows no ROS."""

from __future__ import annotations

import time
from collections.abc import Callable

TOLD_FROM_S = 0.5  # of a lag; less is made up for unnoticed
GIVEN_UP_FROM_S = 10.0  # of a lag: more is not caught up
TOLD_EVERY_S = 10.0
BEGINNING_S = 1.0  # after the first step: what is done for the first time holds the run up
NOTICEABLE_S = 0.05


class StepPacer:
    """Schedule of the steps.

    On a machine that is too slow the run falls behind the wall clock.  It takes its steps without waiting until it has
    caught up; a lag of more than 10 s is given up, and the schedule begins anew from the wall clock as it is.  So it
    does within the first second, in which kernels and libraries are loaded that only a run under way asks for.

    Parameters
    ----------
    step_s : float
        Length of a step in simulated time.
    realtime : bool
        Follow the wall clock; otherwise every step is due at once.
    clock : callable
        Steady time in seconds.
    """

    def __init__(self, step_s: float, realtime: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self.realtime = realtime
        self.lag_s = 0.0
        self.worst_lag_s = 0.0
        self.given_up_s = 0.0
        self._step_s = step_s
        self._clock = clock
        self._zero_s: float | None = None
        self._begun_s: float | None = None

    def wait_s(self, step: int) -> float:
        """Return how long to wait until a step is due (0 if it is)."""
        if not self.realtime:
            return 0.0
        now = self._clock()
        if self._zero_s is None:
            self._zero_s = now - step * self._step_s
            self._begun_s = now if self._begun_s is None else self._begun_s
        return max(0.0, self._zero_s + step * self._step_s - now)

    def passed(self, step: int) -> None:
        """Take note that a step is taken now, and how late."""
        if not self.realtime or self._zero_s is None or self._begun_s is None:
            return
        now = self._clock()
        self.lag_s = now - self._zero_s - step * self._step_s
        if self.lag_s > NOTICEABLE_S and now - self._begun_s < BEGINNING_S:
            self.resume()
        self.worst_lag_s = max(self.worst_lag_s, self.lag_s)
        if self.lag_s > GIVEN_UP_FROM_S:
            self.given_up_s += self.lag_s
            self.resume()

    def resume(self) -> None:
        """Start anew from the wall clock as it is, after a wait."""
        self._zero_s = None
        self.lag_s = 0.0


class LagNotice:
    """What is said of a run that falls behind: at once, every ten seconds, and when that is over."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._told_s: float | None = None
        self._given_up_s = 0.0

    def lines(self, pacer: StepPacer) -> tuple[str, str]:
        """Return what is so now, and what is to be said in the log; empty where nothing is."""
        now = self._clock()
        if pacer.given_up_s > self._given_up_s:
            given_up, self._given_up_s = pacer.given_up_s - self._given_up_s, pacer.given_up_s
            self._told_s = now
            line = f"gave up {given_up:.1f} s it was behind; this machine is too slow for real time"
            return line, line
        if pacer.lag_s < TOLD_FROM_S:
            said, self._told_s = self._told_s is not None, None
            return "", "caught up with the wall clock" if said else ""
        behind = f"behind by {pacer.lag_s:.1f} s"
        if self._told_s is not None and now - self._told_s < TOLD_EVERY_S:
            return behind, ""
        self._told_s = now
        return behind, behind
