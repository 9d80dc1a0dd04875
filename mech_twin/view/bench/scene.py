# SPDX-License-Identifier: Apache-2.0
"""A run on the bench: each picture has drawing, state, cards and curves of one instant.

A frame, the complete state of a run at a step, becomes plain lists for JSON and back.  The regimes of each part of the
machine are a lane of their own over time.
"""

import math
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import TypeAdapter

from mech_twin.declarations.captions import caption
from mech_twin.engine.trajectory import RunInvariants
from mech_twin.roles import Machine
from mech_twin.samples import Drawing, Event, Frame, LinkageSample
from mech_twin.view.annotations import RESET, AnyStep, is_stalled
from mech_twin.view.bench.link import BenchLink
from mech_twin.view.bench.picture import Curves, Panel, metric_rows, packed_curves, packed_layout, packed_shapes
from mech_twin.view.curve_groups import plots
from mech_twin.view.extent import Bounds, DrawnExtent, event_line, is_logged, with_placed_texts
from mech_twin.view.run_scene import RunScene
from mech_twin.view.sending import PictureRate

MOST_CHANGES = 400  # per lane and picture; the oldest are dropped
SENSE = "_sense"  # suffix of a memory with the direction of friction
SENSES = ("held", "forwards", "backwards")  # for 0, 1, -1
TOOL = ("stands", "moves", "pushed", "blocked")  # values of the memory `tool_regime`


class Lanes:
    """Lanes of a run."""

    def __init__(self, machine: Machine) -> None:
        self._linkage = machine.linkage.regimes
        self._body = () if machine.body is None else machine.body.regimes
        self._now: dict[str, str] = {}
        self._shown: set[str] = set()  # a joint without friction only ever slides forwards, and has no lane
        self._first: dict[str, str] = {}
        self._begin_s: float | None = None
        self._changes: dict[str, list[list[Any]]] = {}

    def add(self, step: AnyStep) -> None:
        """Update with a step."""
        for time_s, lane, word in self._words(step):
            if self._begin_s is None:
                self._begin_s = time_s
            before = self._now.get(lane)
            if word == before:
                continue
            self._now[lane] = word
            if word != SENSES[1]:
                self._shown.add(lane)
            changes = self._changes.setdefault(lane, [])
            changes.append([round(time_s, 9), word])
            del changes[:-MOST_CHANGES]

    def taken(self) -> list[list[Any]]:
        """Return and clear for each lane its name, start time (s), regime at that time, and later changes."""
        begin_s = self._begin_s
        if begin_s is None:
            return []
        rows = [
            [lane, round(begin_s, 9), self._first.get(lane, word), self._changes.get(lane, [])]
            for lane, word in self._now.items()
            if lane in self._shown
        ]
        self._first, self._changes, self._begin_s = dict(self._now), {}, None
        return rows

    def _words(self, step: AnyStep) -> Iterator[tuple[float, str, str]]:
        motor, linkage, body = step.motor, step.linkage, step.body
        if linkage is not None:
            if len(self._linkage) > 1 and not self._body:  # else the regimes are those of the body
                yield linkage.time_s, "machine", _named(self._linkage, linkage.regime)
            yield from self._remembered(linkage)
        if body is not None and self._body:
            yield body.time_s, "body", _named(self._body, body.regime)
        if motor is not None:
            stalled = linkage is not None and is_stalled(linkage)
            yield motor.time_s, "supply", "stalled" if stalled else "on" if motor.command > 0.0 else "off"

    @staticmethod
    def _remembered(linkage: LinkageSample) -> Iterator[tuple[float, str, str]]:
        for name, value in zip(linkage.memory.names, linkage.memory.values, strict=True):
            if name == "tool_regime":
                yield linkage.time_s, "tool", _named(TOOL, int(value))
            elif name.endswith(SENSE) and linkage.step > 0:  # before the first step nothing has slid
                part = name.removesuffix(SENSE)
                yield linkage.time_s, f"{part} friction", SENSES[int(value)]


def _named(words: Sequence[str], number: int) -> str:
    return words[number].replace("_", " ") if 0 <= number < len(words) else str(number)


_FRAME = TypeAdapter(Frame)
LEFT_OUT = ("events", "loads")  # of the step that ends here; not needed to continue
STATE_S = 0.1  # wall-clock time between two states of the run
MOST_EVENTS = 200  # per picture
LOUD = 0.01  # share of the largest impulse so far: weaker impacts are recorded, but not logged
HEALTH_S = 0.5  # wall-clock time between two reports of the residuals
HALTED_S = 0.3  # time without a step that counts as a pause or a wait for a peer, not as lag
TINY = 1e-300


def listed(frame: Frame) -> dict[str, Any]:
    """Return the samples of a frame by role, without events."""
    roles = {name: sample for name, sample in frame._asdict().items() if sample is not None}
    return {
        name: {field: value for field, value in sample._asdict().items() if field not in LEFT_OUT}
        for name, sample in roles.items()
    }


def framed(content: dict[str, Any]) -> Frame:
    """Return the frame made of the lists of `listed`."""
    found: Frame = _FRAME.validate_python({"body": None, **content})
    return found


class BenchScene(RunScene):
    """A run on the bench; a context manager."""

    def __init__(self, link: BenchLink, sending: PictureRate) -> None:
        super().__init__()
        self._link, self._sending = link, sending
        self._extent = DrawnExtent()
        self._bounds: Bounds | None = None
        self._names: dict[str, tuple[str, ...]] = {}
        self._events: deque[list[Any]] = deque(maxlen=MOST_EVENTS)
        self._sent_at = self._state_at = -1.0
        self._drawn_s = -math.inf
        self._time_s = 0.0
        self._lanes: Lanes | None = None
        self._invariants: RunInvariants | None = None
        self._hardest_ns = 0.0
        self._health_at = self._stepped_at = -1.0
        self._zero_s: float | None = None

    def watch(self, machine: Machine) -> None:
        """Add regimes, and residuals with their limits, and what else the machine tells; call before the first step."""
        super().watch(machine)
        self._lanes, self._invariants = Lanes(machine), RunInvariants(machine)

    def frame(self, step: AnyStep) -> None:
        """Add the samples of a step, all or some."""
        for sample in (step.motor, step.linkage, step.forces, step.body):
            if sample is not None:
                if sample.time_s < self._time_s - 1.0:
                    self._link.tell("anew", {})
                    self._scale_anew()
                    self._time_s = sample.time_s
                    self._drawn_s = -math.inf
                self._time_s = max(self._time_s, sample.time_s)
        self._take(step)
        if self._lanes is not None:
            self._lanes.add(step)
        whole = step if isinstance(step, Frame) else step.frame(has_body=False)
        if self._invariants is not None and whole is not None:
            self._invariants.observe(whole)

    def state(self, frame: Frame) -> None:
        """Send the whole state of the run from time to time; the bench can roll out from it."""
        now = time.monotonic()
        behind_s = self._behind_s(frame.linkage.time_s, now)
        if now - self._state_at >= STATE_S:
            self._state_at = now
            self._link.tell("frame", listed(frame))
        if now - self._health_at >= HEALTH_S:
            self._health_at = now
            self._tell_health(behind_s)

    def drawing_due(self, time_s: float) -> bool:
        """Return whether the next picture is due, by the wall clock and by simulated time."""
        if time_s - self._drawn_s < self._sending.drawing_s - 1e-9:
            return False
        return time.monotonic() - self._sent_at >= self._sending.picture_s

    def drawing(self, drawing: Drawing) -> None:
        """Send a picture: this drawing, and the data of the run up to it."""
        self._drawn_s = drawing.time_s
        self._extent.widen(drawing.shapes)
        self._bounds = self._extent.kept(self._bounds)
        notes = self._annotations.shapes(drawing.time_s, self._bounds) if self._annotations else ()
        self._show(drawing.time_s, packed_shapes(with_placed_texts(drawing.shapes, notes, self._bounds)))

    def _show(self, time_s: float, shapes: dict[str, Any] | None) -> None:
        """Send a picture; without shapes the page keeps the last drawing."""
        before = time.monotonic()
        curves = self._roles.taken(self._sending)
        self._lay_out(curves)
        picture = {
            "time_s": round(time_s, 9),
            "sent_s": time.time(),
            "state": self._banner.state(),
            "alarm": self._banner.alarm(),
            "command": self._banner.command,
            "cards": self._banner.cards(),
            "bounds": self._bounds,
            "shapes": shapes,
            "curves": packed_curves(curves),
            "events": list(self._events),
            "lanes": [] if self._lanes is None else self._lanes.taken(),
        }
        if self._link.show(picture):
            self._events.clear()
        self._sent_at = before

    def event(self, event: Event) -> None:
        """Show an event: a log line, and a flash."""
        size_ns = abs(event.impulse_ns)
        self._hardest_ns = max(self._hardest_ns, size_ns)
        if is_logged(event) and (size_ns == 0.0 or size_ns >= LOUD * self._hardest_ns):
            self._events.append([event.time_s, event_line(event, self._turning_stops)])
        if event.kind == RESET:
            self._scale_anew()
        self._strike(event)

    def _scale_anew(self) -> None:
        """Clear range and largest impulse of the previous run, so that they set no scale of this one."""
        self._extent, self._bounds, self._hardest_ns = DrawnExtent(), None, 0.0
        if self._annotations is not None:
            self._annotations.largest_n = 0.0

    def metrics(self, metrics: Mapping[str, float]) -> None:
        """Show the numbers of the run."""
        self._link.tell("metrics", {"rows": metric_rows(metrics)})

    def close(self) -> None:
        """Send what no picture holds yet, and the residuals of the whole run, and close the connection."""
        if self._roles.waiting or self._events:
            self._show(self._time_s, None)
        self._tell_health(None)
        self._link.close()

    def _behind_s(self, time_s: float, now_s: float) -> float:
        """Return the lag (s) behind the wall clock since the last pause or wait."""
        ahead_s = time_s - now_s
        halted = now_s - self._stepped_at > HALTED_S
        self._stepped_at = now_s
        if self._zero_s is None or halted or ahead_s > self._zero_s:
            self._zero_s = ahead_s
        return self._zero_s - ahead_s

    def _tell_health(self, behind_s: float | None) -> None:
        """Send the largest residuals so far with their limits, the one nearest to its limit first."""
        if self._invariants is None:
            return
        found = sorted(self._invariants.residuals().items(), key=lambda each: -each[1].worst / max(each[1].limit, TINY))
        rows = [
            [", ".join(filter(None, caption(name))), f"{r.worst:.2g}", f"{r.limit:.2g}", r.broken] for name, r in found
        ]
        self._link.tell("health", {"residuals": rows, "behind_s": behind_s})

    def _lay_out(self, curves: Sequence[Curves]) -> None:
        """Send the list of plots if it has changed."""
        names = self._names | {curve.path: curve.names for curve in curves}
        if names != self._names:
            self._names = names
            panels = [Panel(title, tuple(paths)) for title, paths in plots(names, self._roles.units).items()]
            self._link.tell("layout", packed_layout(panels, names))
