# SPDX-License-Identifier: Apache-2.0
"""State of a run in progress: metrics, newest events, and regime of its linkage."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from mech_twin.engine.trajectory import frame_events
from mech_twin.roles import Machine, Observer
from mech_twin.samples import Event, Frame

KEPT_EVENTS = 20_000  # 2 kB each; the bound keeps the memory of long runs constant


class RunMetrics:
    """Observer of a run that also stores its newest events.

    Parameters
    ----------
    build : callable
        Returns the machine.  It is called at the first frame or the first request of metrics, since building a machine
        may compile kernels.
    """

    def __init__(self, build: Callable[[], Machine]) -> None:
        self._build = build
        self._machine: Machine | None = None
        self.begin_anew()

    def begin_anew(self) -> None:
        """Clear everything for a new run."""
        self.events: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self.event_count = 0
        self.frames = 0
        self.last: Frame | None = None
        self._observer: Observer | None = None

    def observe(self, frame: Frame) -> tuple[Event, ...]:
        """Add one frame and return its events."""
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
        """Return the metrics so far, including the closed-form ones of a cycle."""
        return {**self._built().report(), **self.running_numbers()}

    def running_numbers(self) -> dict[str, float]:
        """Return only the metrics of the run."""
        return {} if self._observer is None else self._observer.numbers()

    def regime(self, index: int) -> str:
        """Return the name of a regime of the linkage; empty if the machine has none."""
        regimes = self._built().linkage.regimes
        return regimes[index] if regimes else ""

    @property
    def machine(self) -> Machine:
        """The machine, built at the first access."""
        return self._built()

    def _built(self) -> Machine:
        if self._machine is None:
            self._machine = self._build()
        return self._machine
