# SPDX-License-Identifier: Apache-2.0
"""Position in a recording against the wall clock: rate, pause, jumps.  Knows no ROS and reads no clock itself."""

from __future__ import annotations

LARGEST_LAG_S = 0.1


class ReplayClock:
    """Position that runs at a rate.

    Parameters
    ----------
    position_ns : int
        Log time to begin at.
    rate : float
        Recorded seconds per second.
    now_s : float
        Steady time of the beginning.
    """

    def __init__(self, position_ns: int, rate: float, now_s: float) -> None:
        self.rate = rate
        self.paused = False
        self._anchor_ns = position_ns
        self._anchor_s = now_s

    def position_ns(self, now_s: float) -> int:
        """Return the log time that is due at a steady time."""
        if self.paused:
            return self._anchor_ns
        return self._anchor_ns + round((now_s - self._anchor_s) * self.rate * 1e9)

    def wait_s(self, log_time_ns: int, now_s: float) -> float:
        """Return how long to wait until a log time is due; at most 0 if it is, without end while paused."""
        if self.paused:
            return float("inf")
        return (log_time_ns - self._anchor_ns) * 1e-9 / self.rate + self._anchor_s - now_s

    def jump(self, position_ns: int, now_s: float) -> None:
        """Go on from another position."""
        self._anchor_ns, self._anchor_s = position_ns, now_s

    def change_rate(self, rate: float, now_s: float) -> None:
        """Go on at another rate from where the position is."""
        self.jump(self.position_ns(now_s), now_s)
        self.rate = rate

    def pause(self, now_s: float) -> None:
        """Stand still."""
        self.jump(self.position_ns(now_s), now_s)
        self.paused = True

    def resume(self, now_s: float) -> None:
        """Go on from where it stands."""
        self.jump(self.position_ns(now_s), now_s)
        self.paused = False

    def give_way(self, log_time_ns: int, now_s: float) -> bool:
        """Return whether a message is so late that the position was put back to it: slower, rather than a flood."""
        late = -self.wait_s(log_time_ns, now_s) > LARGEST_LAG_S
        if late:
            self.jump(log_time_ns, now_s)
        return late
