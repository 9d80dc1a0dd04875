# SPDX-License-Identifier: Apache-2.0
"""Which publisher is followed on a topic: one at a time, another only when the first is gone.  Knows no ROS.

Each node signs its step messages with a number of its own (row ``~source``).  A message without one comes from
somebody's own program; all of those are one source, `ANONYMOUS`.
"""

from __future__ import annotations

import secrets
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
