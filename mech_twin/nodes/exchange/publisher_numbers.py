# SPDX-License-Identifier: Apache-2.0
"""Whose a message is that bears a node's source, by what the middleware knows of its publisher.  Knows no ROS.

The middleware numbers what each publisher sends: 1, 2, 3 without a gap.  So the messages of one publisher go on from
each other, and those of another that copies its source do not.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

SOURCES = 64  # of a topic that are remembered


class PublisherNumbers:
    """The publisher of each source heard on one topic: the first that signed with it.

    Parameters
    ----------
    silence_s : float
        Time after which that publisher counts as gone, and another number of the source as its successor's.
    clock : callable
        Steady time in seconds.
    """

    def __init__(self, silence_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._silence_s, self._clock = silence_s, clock
        self._newest: OrderedDict[float, tuple[int, float]] = OrderedDict()  # its number, and when it came

    def is_own(self, source: float, number: int | None, alone: Callable[[], bool]) -> bool:
        """Return whether a message comes from the publisher of the source it bears.

        Parameters
        ----------
        source : float
            What it is signed with.
        number : int or None
            What the middleware numbers it with; None where it does not, and then every message is believed.
        alone : callable
            Whether nobody else publishes the topic: a gap is then a loss.  Asked where the number does not go on.
        """
        if number is None:
            return True
        now_s, known = self._clock(), self._newest.get(source)
        if known is not None and number != known[0] + 1 and now_s - known[1] <= self._silence_s and not alone():
            return False
        self._newest[source] = number, now_s
        self._newest.move_to_end(source)
        if len(self._newest) > SOURCES:
            self._newest.popitem(last=False)
        return True
