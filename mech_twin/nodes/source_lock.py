# SPDX-License-Identifier: Apache-2.0
"""Which publisher is followed on a topic: one at a time, another only when the first is gone.  Knows no ROS.

Each node signs its step messages with a number of its own (row ``~source``).  A message without one comes from
somebody's own program; all of those are one source, `ANONYMOUS`.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from enum import Enum

ANONYMOUS = 0.0
SOURCE_BITS = 48  # a float64 holds it exactly


def new_source() -> float:
    """Return a number no other node signs with."""
    return float(1 + secrets.randbits(SOURCE_BITS))


class Admission(Enum):
    """What a lock says of a message's source."""

    FOLLOWED = "followed"
    NEWLY_FOLLOWED = "newly followed"
    REFUSED = "refused"


class SourceLock:
    """The one publisher that is followed on a topic."""

    def __init__(self) -> None:
        self.source: float | None = None

    @property
    def locked(self) -> bool:
        """Whether somebody is followed."""
        return self.source is not None

    def admit(self, source: float, vacant: bool) -> Admission:
        """Return whether a message of this source counts; where the place is vacant, its source is followed on."""
        if source == self.source:
            return Admission.FOLLOWED
        if not vacant:
            return Admission.REFUSED
        self.source = source
        return Admission.NEWLY_FOLLOWED


class HeardSource:
    """The publisher that a mere listener follows: one that signs before one that does not, until it falls silent.

    Parameters
    ----------
    silence_s : float
        Time without a message after which it counts as gone.
    clock : callable
        Steady time in seconds.
    """

    def __init__(self, silence_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._silence_s = silence_s
        self._clock = clock
        self._lock = SourceLock()
        self._heard_s = clock()

    def admit(self, source: float, alone: Callable[[], bool]) -> Admission:
        """Return whether a message of this source counts.

        ``alone`` tells whether nobody else publishes there; it is asked where nobody is followed yet and the message
        is not signed.
        """
        now_s = self._clock()
        if self._lock.locked:
            unsigned = self._lock.source == ANONYMOUS and source != ANONYMOUS
            vacant = unsigned or now_s - self._heard_s > self._silence_s
        else:
            vacant = source != ANONYMOUS or alone()
        admission = self._lock.admit(source, vacant)
        if admission is not Admission.REFUSED:
            self._heard_s = now_s
        return admission
