# SPDX-License-Identifier: Apache-2.0
"""When a missing answer is asked for again, and from when its peer counts as gone.  Knows no ROS, reads no clock."""

from __future__ import annotations

ASK_AGAIN_S = 0.3
ASK_AGAIN_WAITING_S = 0.1


class PeerWait:
    """The time since the last step, and how long the run has waited for peers in all.

    Parameters
    ----------
    timeout_s : float
        Time without an answer after which a peer counts as gone.
    now_s : float
        Steady time of the beginning.
    """

    def __init__(self, timeout_s: float, now_s: float) -> None:
        self.count = 0
        self._timeout_s = timeout_s
        self._step_at_s = now_s
        self._asked_at_s = now_s
        self._since_s: float | None = None
        self._ended_s = 0.0

    @property
    def waiting(self) -> bool:
        """Whether the run waits for a peer that is gone."""
        return self._since_s is not None

    def silence_s(self, now_s: float) -> float:
        """Return the time since the last step."""
        return now_s - self._step_at_s

    def total_s(self, now_s: float) -> float:
        """Return how long the run has waited in all, the present wait included."""
        return self._ended_s + (0.0 if self._since_s is None else now_s - self._since_s)

    def due(self, now_s: float) -> bool:
        """Return whether what is missing is to be asked for again."""
        patience_s = ASK_AGAIN_WAITING_S if self.waiting else ASK_AGAIN_S
        return now_s - max(self._step_at_s, self._asked_at_s) > patience_s

    def ask(self, now_s: float) -> bool:
        """Take note of a repeated question; return whether the peer counts as gone from now on."""
        self._asked_at_s = now_s
        if self.waiting or self.silence_s(now_s) <= self._timeout_s:
            return False
        self._since_s = now_s
        self.count += 1
        return True

    def stepped(self, now_s: float) -> None:
        """Take note of a step, which ends a wait."""
        self._ended_s = self.total_s(now_s)
        self._since_s = None
        self._step_at_s = now_s

    def resumed(self, now_s: float) -> None:
        """Measure anew, after this process itself was suspended."""
        self._step_at_s = now_s
