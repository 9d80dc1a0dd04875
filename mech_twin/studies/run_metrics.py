# SPDX-License-Identifier: Apache-2.0
"""What is known of a run while it goes on: its numbers, its newest events, the regime of its linkage."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from mech_twin.engine.trajectory import frame_events
from mech_twin.roles import Machine, Observer
from mech_twin.samples import Event, Frame

KEPT_EVENTS = 20_000  # 2 kB each: more would grow a process for hours


class RunMetrics:
    """Observer of a run, with its events (the newest of a long run).

    Parameters
    ----------
    build : callable
        Returns the machine.  Called when the first frame comes, or the metrics are asked for: building a machine may
        compile, which a process that waits for a run need not.
    """

    def __init__(self, build: Callable[[], Machine]) -> None:
        self._build = build
        self._machine: Machine | None = None
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget the run so far: another begins."""
        self.events: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self.event_count = 0
        self.frames = 0
        self.last: Frame | None = None
        self._observer: Observer | None = None

    def observe(self, frame: Frame) -> tuple[Event, ...]:
        """Take one frame into account and return its events."""
        self.frames += 1
        self.last = frame
        if self._observer is None:
            self._observer = self._built().observer()
        self._observer.observe(frame)
        events = frame_events(frame)
        self.events.extend(events)
        self.event_count += len(events)
        return events

    def numbers(self) -> dict[str, float]:
        """Return the metrics so far, the closed-form ones of a cycle included."""
        return {**self._built().report(), **self.running_numbers()}

    def running_numbers(self) -> dict[str, float]:
        """Return the metrics of the run alone."""
        return {} if self._observer is None else self._observer.numbers()

    def regime(self, index: int) -> str:
        """Return the name of a regime of the linkage, empty where the machine has none."""
        regimes = self._built().linkage.regimes
        return regimes[index] if regimes else ""

    @property
    def machine(self) -> Machine:
        """The machine, built when it is first asked for."""
        return self._built()

    def _built(self) -> Machine:
        if self._machine is None:
            self._machine = self._build()
        return self._machine
