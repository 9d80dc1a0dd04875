"""The figures and events of a run, gathered frame by frame."""

from __future__ import annotations

from collections import deque

from mech_twin.engine.trajectory import frame_events
from mech_twin.roles import Machine
from mech_twin.samples import Event, Frame

KEPT_EVENTS = 100_000


class RunFigures:
    """Observer of a run, with its events (the newest of a long run)."""

    def __init__(self, machine: Machine) -> None:
        self.events: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self.event_count = 0
        self.frames = 0
        self._machine = machine
        self._observer = machine.observer()

    def observe(self, frame: Frame) -> tuple[Event, ...]:
        """Take one frame into account and return its events."""
        self.frames += 1
        self._observer.observe(frame)
        events = frame_events(frame)
        self.events.extend(events)
        self.event_count += len(events)
        return events

    def numbers(self) -> dict[str, float]:
        """Return the figures so far, the closed-form ones of a cycle included."""
        return {**self._machine.report(), **self._observer.numbers()} if self.frames else self._machine.report()

    def running_numbers(self) -> dict[str, float]:
        """Return the figures of the run alone."""
        return self._observer.numbers() if self.frames else {}
