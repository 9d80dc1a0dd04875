# SPDX-License-Identifier: Apache-2.0
"""Logs samples to a rerun file as they arrive.

Everything is logged at simulation time, never wall-clock time.  The names of joints and pins come from the samples, so
recordings of machines outside the catalogue can be shown too.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import rerun as rr

from mech_twin.declarations.captions import metrics_table
from mech_twin.samples import BodySample, Drawing, Event
from mech_twin.view.annotations import AnyStep
from mech_twin.view.curves import FIRST_COLOUR, PALETTE, send_rows, series_lines, times
from mech_twin.view.extent import Bounds, event_line, is_logged
from mech_twin.view.layout import (
    BANNER,
    EVENTS,
    IMPACTS,
    METRICS,
    PHASE_PORTRAIT,
    PhasePortrait,
    SceneContents,
    blueprint,
)
from mech_twin.view.rerun_pictures import Mechanism, closed_stream, opened_stream, set_time
from mech_twin.view.run_scene import RunScene
from mech_twin.view.sending import RECORDED

VIEW_RATE_HZ = 30.0
CURVE_SPAN_S, PORTRAIT_SPAN_S = 1.0, 0.5  # simulated time shown
BATCH_S = 0.1  # simulated time per batch


class RerunScene(RunScene):
    """The rerun recording of one run; a context manager."""

    def __init__(self, application_id: str, rrd_path: str | Path) -> None:
        super().__init__()
        self._stream = opened_stream(application_id, rrd_path)
        self._names: dict[str, tuple[str, ...]] = {}
        self._portraits: tuple[PhasePortrait, ...] = ()
        self._events: list[tuple[float, str]] = []
        self._has_events = False
        self._marks = ImpactMarks(self._stream)
        self._mechanism = Mechanism(self._stream)
        self._shown: SceneContents | None = None
        self._time_s = 0.0
        self._last_picture = -1
        self._closed = False

    def frame(self, step: AnyStep) -> None:
        """Add the samples of a step, all or some; they are sent in batches."""
        self._take(step)
        body, given = step.body, (step.motor, step.linkage, step.forces, step.body)
        self._time_s = max([self._time_s, *(sample.time_s for sample in given if sample is not None)])
        if body is not None:
            self._trace(body)
        if self._roles.spans(BATCH_S):
            self._send()
            if body is not None:
                set_time(self._stream, body.time_s, body.step)
                for portrait in self._portraits:
                    portrait.log(self._stream)

    def drawing_due(self, time_s: float) -> bool:
        """Return whether the mechanism should be drawn at this time (s): at most 30 times per simulated second."""
        return _picture(time_s) != self._last_picture

    def drawing(self, drawing: Drawing) -> None:
        """Show a drawing of the mechanism."""
        self._last_picture = _picture(drawing.time_s)
        set_time(self._stream, drawing.time_s, drawing.step)
        self._mechanism.widen(drawing.shapes)
        notes = self._annotations.shapes(drawing.time_s, self.visible_bounds()) if self._annotations else ()
        self._mechanism.show(drawing.shapes, notes)

    def event(self, event: Event) -> None:
        """Show an event at its exact time: a log line, and for an impact vertical marks and a flash."""
        if is_logged(event):
            self._has_events = True
            self._events.append((event.time_s, event_line(event, self._turning_stops)))
        self._marks.add(event, turns=event.contact in self._turning_stops)
        self._strike(event)

    def metrics(self, metrics: Mapping[str, float]) -> None:
        """Show the metrics of the run as a table; names end in their unit."""
        set_time(self._stream, self._time_s)
        self._stream.log(METRICS, rr.TextDocument(metrics_table(metrics), media_type=rr.MediaType.MARKDOWN))

    def close(self) -> None:
        """Write the remaining data, and close the file; idempotent."""
        if self._closed:
            return
        self._closed = True
        self._send()
        closed_stream(self._stream)

    def _send(self) -> None:
        """Send what has come in since the last time."""
        for curves in self._roles.taken(RECORDED):
            if self._names.get(curves.path) != curves.names:
                self._names[curves.path] = curves.names
                lines = series_lines(curves.names, FIRST_COLOUR.get(curves.path, 0))
                self._stream.log(curves.path, lines, static=True)
            send_rows(self._stream, curves.path, curves.values, curves.time_s, curves.step)
        self._send_events()
        set_time(self._stream, self._time_s)
        self._stream.log(BANNER, rr.TextDocument(self._banner.text(), media_type=rr.MediaType.MARKDOWN))
        self._lay_out()

    def _trace(self, body: BodySample) -> None:
        if tuple(portrait.joint for portrait in self._portraits) != body.joints:
            self._portraits = tuple(
                PhasePortrait(f"{PHASE_PORTRAIT}/{joint}", joint, place, PORTRAIT_SPAN_S)
                for place, joint in enumerate(body.joints)
            )
        for portrait in self._portraits:
            portrait.add(body)

    def _send_events(self) -> None:
        self._marks.send()
        if not self._events:
            return
        time_s, text = zip(*self._events, strict=True)
        self._events = []
        lines = rr.TextLog.columns(text=list(text), level=["INFO"] * len(text))
        self._stream.send_columns(EVENTS, times(time_s), lines)

    def visible_bounds(self) -> Bounds | None:
        """Return the visible range of the machine's plane, or the next one if the drawing has just left it.

        Scale bars and reactions are placed at its edges; at the edges of the whole drawn range they would be cut off.
        """
        return self._mechanism.kept(None if self._shown is None else self._shown.bounds)

    def _lay_out(self) -> None:
        """Send the layout if there is something new to show, or the mechanism has left the visible range."""
        contents = SceneContents(
            curves=dict(self._names),
            portraits=tuple(portrait.joint for portrait in self._portraits),
            bounds=None if self._shown is None else self._shown.bounds,
            impacts=self._marks.kinds,
            events=self._has_events,
            units=self._roles.units,
        )
        within = self._shown is not None and self._mechanism.within(self._shown.bounds)
        if within and contents == self._shown:
            return
        self._shown = contents._replace(bounds=self._mechanism.bounds())
        self._stream.send_blueprint(blueprint(self._shown, CURVE_SPAN_S))


def _picture(time_s: float) -> int:
    """Return the index of the drawing interval of this time."""
    return math.floor(time_s * VIEW_RATE_HZ + 1e-6)


FOOT_S = 1e-9  # resolution of the timeline


class ImpactMarks:
    """Vertical marks of impacts in the plots."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._contacts: set[str] = set()
        self._marks: dict[str, list[tuple[float, float]]] = {}

    @property
    def kinds(self) -> frozenset[str]:
        """Kinds of the marks: ``impulse``, ``speed``."""
        return frozenset(path.split("/")[1] for path in self._contacts)

    def add(self, event: Event, *, turns: bool) -> None:
        """Add the mark of an event, whose contact may turn; one without an impulse has none."""
        if event.impulse_ns == 0.0:
            return
        speed = event.pre_velocity_m_per_s
        for kind, unit, value in (("impulse", "N m s", event.impulse_ns), ("speed", "rad/s", speed)):
            if value != 0.0:
                name = f"{event.contact}, {unit}" if turns else event.contact
                self._mark(f"{IMPACTS}/{kind}/{event.contact}", name, event.time_s, value)

    def send(self) -> None:
        """Send the marks added since the last call."""
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
            # the viewer would merge points that fall into one pixel
            whole = rr.components.AggregationPolicy.Off
            lines = rr.SeriesLines(names=[name], colors=[colour], widths=[1.5], aggregation_policy=whole)
            self._stream.log(path, lines, static=True)
        self._marks.setdefault(path, []).append((time_s, value))
