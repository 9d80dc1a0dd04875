# SPDX-License-Identifier: Apache-2.0
"""Ring buffer in memory of the messages of the last seconds, for a snapshot to disk on request."""

from __future__ import annotations

from collections import Counter, deque
from typing import NamedTuple

NS_PER_S = 1_000_000_000


class RecentMessage(NamedTuple):
    """A serialized message: full topic name, and log time (ns)."""

    topic: str
    raw: bytes
    at_ns: int


class RecentMessages:
    """Buffer of the messages of the last seconds of log time.

    Parameters
    ----------
    seconds : float
        Log time for which a message is kept (s).
    """

    def __init__(self, seconds: float) -> None:
        self._keep_ns = round(seconds * NS_PER_S)
        self._kept: deque[RecentMessage] = deque()
        self.received: Counter[str] = Counter()

    def take(self, message: RecentMessage) -> None:
        """Add a message and drop those that are too old; if log time jumps back, drop all earlier ones."""
        if self._kept and message.at_ns < self._kept[0].at_ns:
            self._kept.clear()
        self.received[message.topic] += 1
        self._kept.append(message)
        while message.at_ns - self._kept[0].at_ns > self._keep_ns:
            self._kept.popleft()

    def released(self) -> tuple[RecentMessage, ...]:
        """Return the buffered messages, and clear the buffer."""
        found = tuple(self._kept)
        self._kept.clear()
        return found
