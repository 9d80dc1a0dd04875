# SPDX-License-Identifier: Apache-2.0
"""What a run gives, collected frame by frame: of one in progress, and of a whole one."""

import math
from collections import Counter, deque
from collections.abc import Callable
from functools import cached_property
from typing import Any

from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.engine.coupling import is_reset
from mech_twin.engine.trajectory import Residual, RunInvariants, Trajectory, frame_events
from mech_twin.roles import Machine
from mech_twin.samples import Event, Frame

KEPT_EVENTS = 20_000  # 2 kB each; the bound keeps the memory of long runs constant
GAP_S = 0.1  # a twentieth of the two seconds of a breaker's means


class RunMetrics:
    """Metrics of a run, its newest frame and newest events.

    Parameters
    ----------
    build : callable
        Returns the machine.  It is called at the first frame or the first request of metrics, since building a machine
        may compile kernels.
    machine_at : callable, optional
        As for `ChangingObserver`.
    """

    kept_events: int | None = KEPT_EVENTS

    def __init__(self, build: Callable[[], Machine], machine_at: Callable[[int], Machine] | None = None) -> None:
        self._build, self.machine_at = build, machine_at
        self.begin_anew()

    def begin_anew(self) -> None:
        """Clear everything for a new run."""
        self.events: deque[Event] = deque(maxlen=self.kept_events)
        self.event_counts = Counter[str]()  # by kind, of all events
        self.frames = 0
        self.last: Frame | None = None
        self._observer: ChangingObserver | None = None

    def observe(self, frame: Frame) -> tuple[Event, ...]:
        """Add one frame and return its events."""
        self.frames += 1
        self.last = frame
        if self._observer is None:
            self._observer = ChangingObserver(self.machine, self.machine_at)
        self._observer.observe(frame)
        events = frame_events(frame)
        self.events.extend(events)
        self.event_counts.update(event.kind for event in events)
        return events

    def summary(self) -> dict[str, float]:
        """Return the closed-form numbers of a cycle and the metrics of the run so far."""
        return {**self.machine.report(), **self.numbers()}

    def numbers(self) -> dict[str, float]:
        """Return the metrics of the run so far."""
        return {} if self._observer is None else self._observer.numbers()

    def since(self) -> str:
        """Return a line on a run whose numbers do not count from its begin; else an empty one."""
        since_s = None if self._observer is None else self._observer.since_s
        anew = "a reset, or a gap in a recording, begins them anew"
        return "" if since_s is None else f"the numbers of the run count from {since_s:.6g} s: {anew}"

    def regime(self, index: int) -> str:
        """Return the name of a regime of the linkage; empty if the machine has none."""
        regimes = self.machine.linkage.regimes
        return regimes[index] if regimes else ""

    @cached_property
    def machine(self) -> Machine:
        """The machine, built at the first access."""
        return self._build()


class ChangingObserver:
    """Metrics of a run whose parameters may change, and which a reset or a gap begins anew.

    A reset returns crank, works and counts to their start while time goes on: no mean or count holds across it.
    Nor does one across a gap, as between the parts of a snapshot; a lost step or two are none.

    Parameters
    ----------
    machine : Machine
        The machine at the beginning.
    machine_at : callable, optional
        ``machine_at(step)``: the machine with the parameters in force at a step.

    Attributes
    ----------
    since_s : float, optional
        Time from which the numbers count; None without a reset or a gap.
    """

    def __init__(self, machine: Machine, machine_at: Callable[[int], Machine] | None = None) -> None:
        self._machine, self._observer = machine, machine.observer()
        self._machine_at = machine_at or (lambda step: machine)
        self._next_step, self._time_s = 0, math.inf
        self.since_s: float | None = None

    def observe(self, frame: Frame) -> None:
        """Add one frame."""
        machine = self._machine_at(frame.linkage.step)
        if machine is not self._machine:
            self._machine = machine
            machine.goes_on(self._observer)
        step, time_s = frame.linkage[:2]
        if is_reset(frame.linkage) or (step > self._next_step and time_s - self._time_s > GAP_S):
            self._observer, self.since_s = machine.observer(), time_s
        self._next_step, self._time_s = step + 1, time_s
        self._observer.observe(frame)

    def numbers(self) -> dict[str, float]:
        """Return the metrics since the start, or since the last reset."""
        return self._observer.numbers()


class Simulation(RunMetrics):
    """All results of a run: its metrics, every event, the worst residuals; whoever needs columns fills them."""

    kept_events = None

    def __init__(self, machine: Machine, machine_at: Callable[[int], Machine] | None = None) -> None:
        super().__init__(lambda: machine, machine_at)
        self.trajectory = Trajectory()
        self._invariants = RunInvariants(machine)

    def observe(self, frame: Frame) -> tuple[Event, ...]:
        """Add one frame and return its events."""
        self._invariants.observe(frame)
        return super().observe(frame)

    def residuals(self) -> dict[str, Residual]:
        """Return the worst value of each residual, with its limit."""
        return self._invariants.residuals()

    def remarks(self) -> tuple[str, ...]:
        """Return remarks on the validity of the results so far."""
        return tuple(self.machine.remarks(self.summary()))

    def document(self) -> dict[str, Any]:
        """Return all results but the samples as plain values."""
        return {
            "machine": self.machine.name,
            "config": configuration_tree(self.machine.parameters),
            "summary": self.summary(),
            "residuals": {name: residual._asdict() for name, residual in self.residuals().items()},
            "events": [event_record(event) for event in self.events],
        }


def event_record(event: Event) -> dict[str, Any]:
    """Return an event as plain values, its coordinates as lists; without those of a side that has none."""
    record = event._asdict()
    sides = {side: [list(coordinate) for coordinate in record.pop(side)] for side in ("pre", "post")}
    return record | {side: coordinates for side, coordinates in sides.items() if coordinates}
