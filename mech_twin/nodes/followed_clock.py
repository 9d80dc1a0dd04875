# SPDX-License-Identifier: Apache-2.0
"""The time of a machine that is followed: which stamps on its topics are its own, and the newest.  Knows no ROS.

A machine's stamps may begin anywhere, jump where it is started anew, and stand still while it does.  A single stamp
that does not go on from the others is somebody else's, or damaged: it leads no time.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, NamedTuple, TypeVar

SECOND_NS = 10**9
BEHIND_NS = SECOND_NS  # as far as topics of a machine may lag behind each other
AHEAD_NS = SECOND_NS // 4
PACE = 2.0  # of the machine's time, at which it may have gone on while nothing was heard
CONFIRMING = 3  # stamps that go on from each other, before another time is believed
MOST_TIMES = 8  # that are waited for at once
MOST_HELD = 1000
Item = TypeVar("Item")


class Heard(NamedTuple):
    """A stamp (ns), and when it came (s of the steady clock)."""

    stamp_ns: int
    at_s: float

    def goes_on_from(self, before: Heard) -> bool:
        """Return whether it is at most as far ahead as time has passed, and hardly behind."""
        passed_ns = PACE * max(self.at_s - before.at_s, 0.0) * SECOND_NS
        return -BEHIND_NS <= self.stamp_ns - before.stamp_ns <= AHEAD_NS + passed_ns


class FollowedClock:
    """The newest stamp of a machine.

    A stamp is believed that goes on from the newest.  Another time is believed where several go on from each other
    and none from the newest meanwhile; the first, too.

    Attributes
    ----------
    now_ns : int or None
        The newest; None while none is believed.
    jumps : int
        How often another time has been believed.
    led_by : frozenset of int
        The stamps by which the present time was believed.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self.led_by: frozenset[int] = frozenset()
        self._newest: Heard | None = None
        self._others: deque[list[Heard]] = deque(maxlen=MOST_TIMES)

    @property
    def now_ns(self) -> int | None:
        """The newest stamp that is believed."""
        return None if self._newest is None else self._newest.stamp_ns

    def at(self, at_s: float) -> int | None:
        """Return the machine's time at an instant of the steady clock, if any is known."""
        newest = self._newest
        return None if newest is None else newest.stamp_ns + round((at_s - newest.at_s) * SECOND_NS)

    def admit(self, stamp_ns: int, at_s: float) -> bool:
        """Return whether a stamp that came at an instant of the steady clock is believed."""
        heard = Heard(stamp_ns, at_s)
        if stamp_ns < 0:
            return False
        if self._newest is not None and heard.goes_on_from(self._newest):
            self._newest = Heard(max(self._newest.stamp_ns, stamp_ns), at_s)
            self._others.clear()
            return True
        row = next((row for row in self._others if heard.goes_on_from(row[-1])), None)
        if row is None:
            self._others.append(row := [])
        row.append(heard)
        if len(row) < CONFIRMING:
            return False
        self.jumps += self._newest is not None
        self.led_by = frozenset(each.stamp_ns for each in row)
        self._newest = max(row)
        self._others.clear()
        return True


class Admitted(NamedTuple, Generic[Item]):
    """What came, the time that counts for it (ns), and whether its own stamp is believed."""

    item: Item
    at_ns: int
    believed: bool


class StampGate(Generic[Item]):
    """Holds what comes back until it is known what time it is, and gives it out in the order it came."""

    def __init__(self) -> None:
        self.clock = FollowedClock()
        self.held: list[tuple[Item, int | None]] = []

    def take(self, item: Item, stamp_ns: int | None, at_s: float) -> list[Admitted[Item]]:
        """Take something, and its stamp where it has one that leads; return what can be told by now."""
        believed = stamp_ns is not None and self.clock.admit(stamp_ns, at_s)
        if self.clock.now_ns is not None:
            return [*self.released(), Admitted(item, self.clock.now_ns, believed)]
        self.held.append((item, stamp_ns))
        return self.released() if len(self.held) > MOST_HELD else []

    def released(self) -> list[Admitted[Item]]:
        """Return what was held back; where no time is known it counts as come at 0."""
        held, self.held = self.held, []
        led_by, found = self.clock.led_by, []
        at_ns = min(led_by, default=0)
        for item, stamp in held:
            believed = stamp is not None and stamp in led_by
            at_ns = max(at_ns, stamp) if stamp is not None and believed else at_ns
            found.append(Admitted(item, at_ns, believed))
        return found
