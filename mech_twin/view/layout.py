# SPDX-License-Identifier: Apache-2.0
r"""Layout of the panels (rerun blueprint); each plot has one unit, given in its title.

::

    +---------------------------------------+
    | state, speed, rate, energy, alarm     |
    +---------------------+-----------------+
    |                     | torque          |
    |                     +-----------------+
    |     mechanism       | speed           |
    |                     +-----------------+
    |                     | pin forces      |
    |                     +-----------------+
    |                     | others          |
    +----------+----------+--+--------------+
    | phase    | events      | metrics      |
    +----------+-------------+--------------+

The phase portrait of a body joint has angular rate over angle for the recent past, older points fainter::

      rate  ^      . - .
            |   /         \        angle and rate are each scaled by a round number (1, 2 or 5
            |  |     o now |        times a power of ten), which labels the axis
     -------+-------------------> angle
            |   \         /
"""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TimelineColumn

from mech_twin.samples import BodySample
from mech_twin.view.curve_groups import plots
from mech_twin.view.curves import SIM_TIME
from mech_twin.view.extent import Bounds, round_above

MECHANISM = "mechanism"
EVENTS = "events"
IMPACTS = "impacts"
METRICS = "metrics"
BANNER = "banner"
PHASE_PORTRAIT = "phase_portrait"
ASPECT = 2.0
# share of a plot's width kept free right of the curves for the legend: frame, per letter of a name, and maximum
LEGEND_FRAME, LEGEND_LETTER, LEGEND_MOST = 0.09, 0.0135, 0.42
CONTACTS = ("a contact",)  # typical length of a mark's name, which is that of a contact
# plots that share a panel; those left share the last one
SLOTS = (
    (
        "Torque, N m", "Moment on the body, N m", "Force of the drive, N", "Effort of the joints, N m",
        "Effort of the joints, N",
    ),
    ("Speed, rad/s", "Speed, m/s", "Position, rad", "Position, m", "Supply, share of rated"),
    ("Pin reactions, N", "Pin reactions along x, N", "Pin reactions along y, N", "Forces, N"),
)  # fmt: skip
SHADES = 6
TRACE = (86, 180, 233)
NOW = (230, 159, 0)
AXIS = (130, 130, 130)


class SceneContents(NamedTuple):
    """Contents of a scene: curve names and units by entity path, body joints, bounds of the mechanism, events."""

    curves: Mapping[str, tuple[str, ...]]
    portraits: tuple[str, ...]
    bounds: Bounds | None
    impacts: frozenset[str] = frozenset(("impulse", "speed"))
    events: bool = True
    units: Mapping[str, str] = {}


def blueprint(contents: SceneContents, window_s: float) -> rrb.Blueprint:
    """Return the layout for these contents, with curves of ``window_s`` (s); without a body it has no body panels."""
    below = _lower_row(contents, window_s)
    alone = len(below) == 1  # a row with the metrics alone would be half empty
    curves = _curve_stack(contents, window_s, below if alone else [])
    beside = [] if curves is None else [curves]
    above = rrb.Horizontal(mechanism_view(contents.bounds), *beside, column_shares=[5, 4])
    if alone:
        return page(rrb.Vertical(banner_view(), above, row_shares=[5, 95]))
    return page(rrb.Vertical(banner_view(), above, rrb.Horizontal(*below), row_shares=[5, 68, 27]))


def page(panels: rrb.Container) -> rrb.Blueprint:
    """Return the layout of a page that follows the run, without the viewer's own panels."""
    return rrb.Blueprint(
        panels,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=SIM_TIME, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def banner_view() -> rrb.TextDocumentView:
    """Return the panel of the state line above the picture."""
    return rrb.TextDocumentView(origin=f"/{BANNER}", name="Run", titlebar=False)


def mechanism_view(bounds: Bounds | None) -> rrb.Spatial2DView:
    """Return the panel of the mechanism."""
    # background of the theme: the viewer's labels are light boxes on a light theme, dark boxes on a dark one
    visible = None
    if bounds is not None:
        visible = rrb.VisualBounds2D(x_range=(bounds.left_m, bounds.right_m), y_range=(-bounds.high_m, -bounds.low_m))
    return rrb.Spatial2DView(origin="/", contents=[f"/{MECHANISM}/**"], name="Mechanism", visual_bounds=visible)


def events_view(*, has_level: bool) -> rrb.TextLogView:
    """Return the panel of events: the text contains the time to the microsecond."""
    columns = rrb.TextLogColumns(
        timeline_columns=[TimelineColumn(SIM_TIME, visible=False)],
        text_log_columns=["loglevel", "body"] if has_level else ["body"],
    )
    return rrb.TextLogView(origin="/", contents=[f"/{EVENTS}/**"], name="Events", columns=columns)


def _curve_stack(contents: SceneContents, window_s: float, last: Sequence[rrb.View | rrb.Tabs]) -> rrb.Vertical | None:
    shown = plots(contents.curves, contents.units)
    titles = [*SLOTS, [title for title in shown if not any(title in slot for slot in SLOTS)]]
    names = {title: [name for path in paths for name in contents.curves[path]] for title, paths in shown.items()}
    stack = [[plot(title, shown[title], window_s, names[title]) for title in slot if title in shown] for slot in titles]
    panels = [_slot([*views, *last] if place == len(stack) - 1 else views) for place, views in enumerate(stack)]
    filled = [panel for panel in panels if panel is not None]
    return rrb.Vertical(*filled) if filled else None


def _slot(panels: Sequence[rrb.View | rrb.Tabs]) -> rrb.Tabs | rrb.View | None:
    if len(panels) <= 1:
        return panels[0] if panels else None
    return rrb.Tabs(*panels, active_tab=0)


def legend_share(names: Iterable[str]) -> float:
    """Return the share of the shown time to add after the newest data, so that the legend covers no curve.

    The legend is as wide as its longest name, including names scrolled out of sight.
    """
    width = min(LEGEND_FRAME + LEGEND_LETTER * max(map(len, names), default=0), LEGEND_MOST)
    return width / (1.0 - width)


def plot(name: str, paths: Sequence[str], window_s: float, names: Iterable[str]) -> rrb.TimeSeriesView:
    """Return a panel of curves over the last ``window_s`` (s), with room for the legend beside them."""
    begin = rr.TimeRangeBoundary.cursor_relative(seconds=-window_s)
    recent = rr.VisibleTimeRange(SIM_TIME, start=begin, end=rr.TimeRangeBoundary.cursor_relative())
    beside = rr.TimeRangeBoundary.cursor_relative(seconds=legend_share(names) * window_s)
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"/{path}/**" for path in paths],
        name=name,
        time_ranges=recent,
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=begin, end=beside)),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def _lower_row(contents: SceneContents, window_s: float) -> list[rrb.View | rrb.Tabs]:
    portraits = [
        rrb.Spatial2DView(
            origin="/",
            contents=[f"/{PHASE_PORTRAIT}/{joint}/**"],
            name=f"Phase portrait: {joint}",
            visual_bounds=rrb.VisualBounds2D(x_range=(-1.3 * ASPECT, 1.3 * ASPECT), y_range=(-1.35, 1.35)),
        )
        for joint in contents.portraits
    ]
    log = events_view(has_level=True)
    titles = {"impulse": "Impacts, N s", "speed": "Impact speed, m/s"}
    marks = [
        plot(title, [f"{IMPACTS}/{kind}"], window_s, CONTACTS)
        for kind, title in titles.items()
        if kind in contents.impacts
    ]
    happened = [*marks, *([log] if contents.events else [])]
    slots = [_slot(portraits), _slot(happened), rrb.TextDocumentView(origin=f"/{METRICS}", name="Metrics")]
    return [panel for panel in slots if panel is not None]


class PhasePortrait:
    """Motion of one body joint over the last ``span_s`` of simulated time, drawn in a rectangle of height 2.

    Parameters
    ----------
    place : int
        Index of the joint in the body sample.
    """

    def __init__(self, path: str, joint: str, place: int, span_s: float) -> None:
        self.path = path
        self.joint = joint
        self._place = place
        self._span_s = span_s
        self._points: deque[tuple[float, float, float]] = deque()
        self._scale: tuple[float, ...] = (0.0, 0.0)

    def add(self, sample: BodySample) -> None:
        """Add a sample; drop those older than the span."""
        points = self._points
        points.append((sample.time_s, sample.position[self._place], sample.velocity[self._place]))
        while points[0][0] < sample.time_s - self._span_s:
            points.popleft()

    def log(self, stream: rr.RecordingStream) -> None:
        """Log the trace, the current point and, after a change of scale, the axes, at the time set on the stream."""
        motion = np.array(self._points)[:, 1:]
        largest = np.abs(motion).max(axis=0)
        # the scale only grows, so that it does not oscillate with the motion
        scale = tuple(
            max(known, round_above(size)) if size > 0.0 else known
            for known, size in zip(self._scale, largest, strict=True)
        )
        if 0.0 in scale:  # no motion yet, no scale
            return
        if scale != self._scale:
            self._scale = scale
            self._log_axes(stream)
        square = motion / scale * (ASPECT, -1.0)  # the second axis of the viewer points down
        edges = np.linspace(0, len(square) - 1, SHADES + 1).astype(int)
        strips = [square[a : b + 1] for a, b in pairwise(edges)]
        faint = [(*TRACE, round(255 * (shade + 1) / SHADES)) for shade in range(SHADES)]
        stream.log(f"{self.path}/trace", rr.LineStrips2D(strips, colors=faint, radii=-1.0))
        stream.log(f"{self.path}/now", rr.Points2D(square[-1:], colors=[NOW], radii=-5.0))

    def _log_axes(self, stream: rr.RecordingStream) -> None:
        angle, rate = self._scale
        cross = [[(-1.08 * ASPECT, 0.0), (1.08 * ASPECT, 0.0)], [(0.0, 1.08), (0.0, -1.08)]]
        parts = (-1.0, -0.5, 0.5, 1.0)
        ticks = [[(part * ASPECT, -0.04), (part * ASPECT, 0.04)] for part in parts]
        ticks += [[(-0.04, part), (0.04, part)] for part in parts]
        stream.log(f"{self.path}/axes", rr.LineStrips2D(cross + ticks, colors=[AXIS], radii=-0.7))
        labels = [f"{self.joint} {angle:g} rad", f"rate {rate:g} rad/s", f"-{angle:g} rad", f"-{rate:g} rad/s"]
        ends = [(ASPECT, 0.0), (0.0, -1.0), (-ASPECT, 0.0), (0.0, 1.0)]
        stream.log(f"{self.path}/labels", rr.Points2D(ends, labels=labels, show_labels=True, colors=[AXIS], radii=-1.0))
