# SPDX-License-Identifier: Apache-2.0
"""Results of a run in one process: metrics, worst residuals and events, collected frame by frame."""

from __future__ import annotations

from typing import Any

from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.engine.trajectory import Residual, RunInvariants, Trajectory, frame_events
from mech_twin.roles import Machine
from mech_twin.samples import Event, Frame


class Simulation:
    """Collects the results of a run, frame by frame."""

    def __init__(self, machine: Machine) -> None:
        self.events: list[Event] = []
        self.trajectory = Trajectory()
        self._machine = machine
        self._observer = machine.observer()
        self._invariants = RunInvariants(machine)

    def observe(self, frame: Frame) -> None:
        """Add one frame."""
        self._observer.observe(frame)
        self._invariants.observe(frame)
        self.events.extend(frame_events(frame))

    def residuals(self) -> dict[str, Residual]:
        """Return the worst value of each residual, with its limit."""
        return self._invariants.residuals()

    def summary(self) -> dict[str, float]:
        """Return the closed-form numbers of a cycle and the metrics of the run so far."""
        return {**self._machine.report(), **self.numbers()}

    def numbers(self) -> dict[str, float]:
        """Return the metrics of the run so far."""
        return self._observer.numbers()

    def remarks(self) -> tuple[str, ...]:
        """Return remarks on the validity of the results so far."""
        return tuple(self._machine.remarks(self.summary()))

    def document(self) -> dict[str, Any]:
        """Return all results but the samples as plain values."""
        return {
            "machine": self._machine.name,
            "config": configuration_tree(self._machine.parameters),
            "summary": self.summary(),
            "residuals": {name: residual._asdict() for name, residual in self.residuals().items()},
            "events": [event_record(event) for event in self.events],
        }


def event_record(event: Event) -> dict[str, Any]:
    """Return an event as plain values."""
    return {
        "time_s": event.time_s,
        "kind": event.kind,
        "contact": event.contact,
        "pre_velocity_m_per_s": event.pre_velocity_m_per_s,
        "post_velocity_m_per_s": event.post_velocity_m_per_s,
        "impulse_ns": event.impulse_ns,
        "period": event.period,
        **{
            side: list(map(list, coordinates))
            for side, coordinates in (("pre", event.pre), ("post", event.post))
            if coordinates
        },
    }
