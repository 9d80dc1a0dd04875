# SPDX-License-Identifier: Apache-2.0
"""Impacts in the plots: a vertical mark at the exact time of each, as high as its impulse or its speed."""

from __future__ import annotations

import rerun as rr

from mech_twin.samples import Event
from mech_twin.view.curves import PALETTE, times
from mech_twin.view.layout import IMPACTS

FOOT_S = 1e-9  # the finest step of the time line


class ImpactMarks:
    """Marks waiting to be sent.

    Parameters
    ----------
    stream : rr.RecordingStream
        Destination of the marks.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._contacts: set[str] = set()
        self._marks: dict[str, list[tuple[float, float]]] = {}

    @property
    def kinds(self) -> frozenset[str]:
        """What there are marks of: ``impulse``, ``speed``."""
        return frozenset(path.split("/")[1] for path in self._contacts)

    def add(self, event: Event) -> None:
        """Take an event; one without an impulse leaves no mark."""
        if event.impulse_ns == 0.0:
            return
        self._mark(f"{IMPACTS}/impulse/{event.contact}", event.contact, event.time_s, event.impulse_ns)
        if event.pre_velocity_m_per_s != 0.0:
            self._mark(f"{IMPACTS}/speed/{event.contact}", event.contact, event.time_s, event.pre_velocity_m_per_s)

    def send(self) -> None:
        """Send what has been added."""
        for path, marks in self._marks.items():
            stems = [
                row
                for time_s, value in marks
                for row in ((time_s - FOOT_S, 0.0), (time_s, value), (time_s + FOOT_S, 0.0))
            ]
            time_s, values = zip(*stems, strict=True)
            self._stream.send_columns(path, times(time_s), rr.Scalars.columns(scalars=values))
        self._marks.clear()

    def _mark(self, path: str, name: str, time_s: float, value: float) -> None:
        if path not in self._contacts:
            colour = PALETTE[len(self._contacts) // 2 % len(PALETTE)]
            self._contacts.add(path)
            self._stream.log(path, _mark_lines(name, colour), static=True)
        self._marks.setdefault(path, []).append((time_s, value))


def _mark_lines(name: str, colour: tuple[int, int, int]) -> rr.SeriesLines:
    """Return the look of marks; drawn point by point, for the viewer would else join what falls into one pixel."""
    return rr.SeriesLines(
        names=[name], colors=[colour], widths=[1.5], aggregation_policy=rr.components.AggregationPolicy.Off
    )
