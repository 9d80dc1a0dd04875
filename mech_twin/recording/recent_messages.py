# SPDX-License-Identifier: Apache-2.0
"""The last seconds of what was heard, kept in memory until somebody wants them on the disk."""

from __future__ import annotations

from collections import Counter, deque
from typing import NamedTuple

NS_PER_S = 1_000_000_000


class RecentMessage(NamedTuple):
    """A message as bytes: full topic name, and log time."""

    topic: str
    raw: bytes
    at_ns: int


class RecentMessages:
    """Messages of the last seconds of log time.

    Parameters
    ----------
    seconds : float
        How long a message is kept.
    """

    def __init__(self, seconds: float) -> None:
        self._keep_ns = round(seconds * NS_PER_S)
        self._kept: deque[RecentMessage] = deque()
        self.heard: Counter[str] = Counter()

    def take(self, message: RecentMessage) -> None:
        """Keep a message, and let go of those that are too old; where time jumps back, of what came before."""
        if self._kept and message.at_ns < self._kept[0].at_ns:
            self._kept.clear()
        self.heard[message.topic] += 1
        self._kept.append(message)
        while message.at_ns - self._kept[0].at_ns > self._keep_ns:
            self._kept.popleft()

    def released(self) -> tuple[RecentMessage, ...]:
        """Return what is kept, and keep it no longer."""
        found = tuple(self._kept)
        self._kept.clear()
        return found
