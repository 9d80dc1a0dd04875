"""Layout of the panels: mechanism on the left, curves on the right, body, events and metrics below.

::

    +---------------------+-----------------+
    |                     | torque          |
    |                     +-----------------+
    |     mechanism       | speed           |
    |                     +-----------------+
    |                     | pin reactions   |
    |                     +-----------------+
    |                     | pressing force  |
    +----------+----------+--+--------------+
    | phase    | events      | metrics      |
    +----------+-------------+--------------+
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TimelineColumn

from mech_twin.view.curves import SIM_TIME, present, quantity_path

MECHANISM = "mechanism"
EVENTS = "events"
IMPACTS = "impacts"
METRICS = "metrics"
PHASE_PORTRAIT = "phase_portrait"
PAPER = (244, 244, 240)
ASPECT = 2.0


class Bounds(NamedTuple):
    """Visible range of the machine's plane, m."""

    left_m: float
    right_m: float
    low_m: float
    high_m: float


class SceneContents(NamedTuple):
    """What there is to show: curve names by entity path, body joints, bounds of the mechanism."""

    curves: Mapping[str, tuple[str, ...]]
    portraits: tuple[str, ...]
    bounds: Bounds | None


def blueprint(contents: SceneContents, window_s: float) -> rrb.Blueprint:
    """Return the layout for these contents; a machine without body gets no body panels.

    Parameters
    ----------
    contents : SceneContents
        What there is to show.
    window_s : float
        Simulated time span of the curves.
    """
    curves = _curve_stack(contents.curves, window_s)
    above = rrb.Horizontal(_mechanism(contents.bounds), *([curves] if curves is not None else []), column_shares=[5, 4])
    below = rrb.Horizontal(*_lower_row(contents, window_s))
    return rrb.Blueprint(
        rrb.Vertical(above, below, row_shares=[7, 3]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=SIM_TIME, play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _mechanism(bounds: Bounds | None) -> rrb.Spatial2DView:
    visible = None
    if bounds is not None:
        visible = rrb.VisualBounds2D(x_range=(bounds.left_m, bounds.right_m), y_range=(-bounds.high_m, -bounds.low_m))
    return rrb.Spatial2DView(
        origin="/", contents=[f"/{MECHANISM}/**"], name="Mechanism", background=PAPER, visual_bounds=visible
    )


def _curve_stack(curves: Mapping[str, tuple[str, ...]], window_s: float) -> rrb.Vertical | None:
    moments, forces = quantity_path("N m"), quantity_path("N")
    others = [path for path in present(curves, "quantities") if path not in (moments, forces)]
    # without a body the moment on it is zero
    moment = present(curves, "body_moment", "body/effort") if present(curves, "body") else []
    slots: list[dict[str, Sequence[str]]] = [
        {
            "Torque, N m": [*present(curves, "motor/torque"), *present(curves, moments)],
            "Joint efforts": present(curves, "linkage/effort"),
            "Moment on the body, N m": moment,
        },
        {
            "Speed": present(curves, "motor/speed", "linkage/speed"),
            "Position": present(curves, "linkage/position"),
            "Supply": present(curves, "motor/supply"),
        },
        {
            "Pin reactions, N": present(curves, "pins/magnitude"),
            "along x": present(curves, "pins/force_x"),
            "along y": present(curves, "pins/force_y"),
            "Forces, N": present(curves, forces),
            "Other quantities": others,
        },
        {
            "Pressing force, N": present(curves, "body/pressing_force"),
            "Body position": present(curves, "body/position"),
            "Body speed": present(curves, "body/speed"),
            "Residuals, powers of ten": present(curves, "residuals"),
        },
    ]
    stack = [_slot([_plot(name, paths, window_s) for name, paths in slot.items() if paths]) for slot in slots]
    filled = [panel for panel in stack if panel is not None]
    return rrb.Vertical(*filled) if filled else None


def _slot(panels: Sequence[rrb.View]) -> rrb.Tabs | rrb.View | None:
    if len(panels) <= 1:
        return panels[0] if panels else None
    return rrb.Tabs(*panels, active_tab=0)


def _plot(name: str, paths: Sequence[str], window_s: float) -> rrb.TimeSeriesView:
    recent = rr.VisibleTimeRange(
        SIM_TIME,
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-window_s),
        end=rr.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"/{path}/**" for path in paths],
        name=name,
        time_ranges=recent,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
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
    panels: list[rrb.View | rrb.Tabs] = []
    portrait = _slot(portraits)
    if portrait is not None:
        panels.append(portrait)
    columns = rrb.TextLogColumns(
        timeline_columns=[TimelineColumn(SIM_TIME, visible=False)],  # the text contains the time to the microsecond
        text_log_columns=["loglevel", "body"],
    )
    log = rrb.TextLogView(origin="/", contents=[f"/{EVENTS}/**"], name="Events", columns=columns)
    impacts = _plot("Impacts", [IMPACTS], window_s)
    panels.append(rrb.Tabs(log, impacts, active_tab=0))
    panels.append(rrb.TextDocumentView(origin=f"/{METRICS}", name="Metrics"))
    return panels
