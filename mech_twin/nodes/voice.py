"""Whose messages count on a topic: the first publisher heard, until it has fallen silent.  Knows no ROS.

Each node signs its step messages with a number of its own (row ``~source``).  A message without one comes from
somebody's own program; all of those are one source, `ANONYMOUS`.
"""

from __future__ import annotations

import secrets

ANONYMOUS = 0.0
SOURCE_BITS = 48  # a float64 holds it exactly


def new_source() -> float:
    """Return a number no other node signs with."""
    return float(1 + secrets.randbits(SOURCE_BITS))


class Voice:
    """The one publisher that is listened to on a topic."""

    def __init__(self) -> None:
        self._source: float | None = None

    @property
    def known(self) -> bool:
        """Whether somebody is listened to."""
        return self._source is not None

    def speaks(self, source: float) -> bool:
        """Return whether this source is the one that is listened to."""
        return source == self._source

    def follow(self, source: float) -> None:
        """Listen to this source from now on."""
        self._source = source
