"""When a step is due: at once, or when the wall clock has come as far.  Reads the steady clock and nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable


class StepPacer:
    """Schedule of the steps.

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
        self.worst_lag_s = 0.0
        self._step_s = step_s
        self._clock = clock
        self._zero_s: float | None = None

    def wait_s(self, step: int) -> float:
        """Return how long to wait until a step is due (0 if it is)."""
        if not self.realtime:
            return 0.0
        now = self._clock()
        if self._zero_s is None:
            self._zero_s = now - step * self._step_s
        return max(0.0, self._zero_s + step * self._step_s - now)

    def passed(self, step: int) -> None:
        """Take note that a step is taken now, and how late."""
        if self.realtime and self._zero_s is not None:
            lag = self._clock() - self._zero_s - step * self._step_s
            self.worst_lag_s = max(self.worst_lag_s, lag)

    def resume(self) -> None:
        """Start anew from the wall clock as it is, after a wait."""
        self._zero_s = None
