# SPDX-License-Identifier: Apache-2.0
"""The contents of a bench's page as a recording for rerun's viewer: drawing, curves, regimes, events, headline.

Recordings also stream to a file.

The mechanism is drawn as lines, points, arrows and texts.
"""

import base64
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from mech_twin.errors import RerunSceneError
from mech_twin.files.output_file import FILE_MODE
from mech_twin.process.closing import Closing
from mech_twin.samples import Shape
from mech_twin.view.bench.picture import Curves
from mech_twin.view.curves import FIRST_COLOUR, SIM_TIME, STEP, send_rows, series_lines, times
from mech_twin.view.extent import Bounds, DrawnExtent, with_placed_texts
from mech_twin.view.layout import BANNER, EVENTS, MECHANISM, banner_view, events_view, mechanism_view, page, plot
from mech_twin.view.shadow_picture import COLOURS

MIRROR = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
KINDS = ("line", "points", "arrow", "text")
FIGURE = f"{MECHANISM}/figure"
TEXT_RADIUS_M = 1e-9
FLUSH_S = 0.1  # drawings within this time (s) go into one chunk of the file
REGIMES = "regimes"
WINDOW_S = 1.0  # shown in the plots
ROOM = 0.1  # share of the height added below the drawing
OWN_PLOTS, OWN_PLOTS_OF_FILE = 3, 4  # plots with a panel of their own; further ones share tabs
FLUSH_LIMIT_S = 0.5  # longest wait for the file to be written at the end
KIND_OF_LETTER = {kind[0]: kind for kind in KINDS}
Values = npt.NDArray[np.float64]


class Mechanism(DrawnExtent):
    """The drawing of the mechanism: one entity, one row per drawing; the caller sets the time."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        super().__init__()
        self._stream = stream
        stream.log(MECHANISM, rr.Transform3D(mat3x3=MIRROR), static=True)  # the viewer's second axis points down

    def show(self, shapes: Sequence[Shape], notes: Sequence[Shape] = ()) -> None:
        """Log the shapes at the stream's time, with notes over them; `widen` sets the range, not this."""
        self.place(with_placed_texts(shapes, notes, self.bounds()))

    def place(self, shapes: Sequence[Shape]) -> None:
        """Log shapes at the stream's time, each text at its own position.

        Raises
        ------
        ValueError
            The kind of a shape is unknown.
        """
        by_kind: dict[str, list[Shape]] = {kind: [] for kind in KINDS}
        for shape in shapes:
            if shape.kind not in by_kind:
                raise ValueError(f"shape {shape.name}: expected one of {', '.join(KINDS)}, got {shape.kind}")
            by_kind[shape.kind].append(shape)
        points = [*by_kind["text"], *by_kind["points"]]
        self._stream.log(FIGURE, _lines(by_kind["line"]), _points(points), _arrows(by_kind["arrow"]))


def _labelled_first(shapes: Sequence[Shape]) -> tuple[list[Shape], list[str]]:
    """Return the shapes, labelled ones first, and the labels.

    The viewer assigns labels in order, and leaves the other shapes without; a single label would go to the centre.
    """
    ordered = sorted(shapes, key=lambda shape: not shape.text)
    texts = [shape.text for shape in ordered if shape.text]
    return ordered, [*texts, ""] if len(texts) == 1 < len(ordered) else texts


def _lines(shapes: Sequence[Shape]) -> rr.LineStrips2D:
    return rr.LineStrips2D(
        [np.array(shape.points_m, dtype=np.float32) for shape in shapes],
        colors=_colours([shape.colour for shape in shapes]),
        radii=np.array([shape.width_m / 2.0 for shape in shapes], dtype=np.float32),
        draw_order=0.0,
    )


def _points(shapes: Sequence[Shape]) -> rr.Points2D:
    """Return the points; a shape of several points has its label at the first one."""
    single = [
        shape._replace(points_m=(point,), text=shape.text if place == 0 else "")
        for shape in shapes
        for place, point in enumerate(shape.points_m)
    ]
    ordered, texts = _labelled_first(single)
    return rr.Points2D(
        np.array([shape.points_m[0] for shape in ordered], dtype=np.float32).reshape(-1, 2),
        colors=_colours([shape.colour for shape in ordered]),
        radii=np.array(
            [TEXT_RADIUS_M if shape.kind == "text" else shape.width_m / 2.0 for shape in ordered], dtype=np.float32
        ),
        labels=texts,
        show_labels=True,
        draw_order=10.0,
    )


def _arrows(shapes: Sequence[Shape]) -> rr.Arrows2D:
    ends = np.array([shape.points_m for shape in shapes], dtype=np.float32).reshape(-1, 2, 2)
    return rr.Arrows2D(
        origins=ends[:, 0],
        vectors=ends[:, 1] - ends[:, 0],
        colors=_colours([shape.colour for shape in shapes]),
        radii=np.array([shape.width_m / 2.0 for shape in shapes], dtype=np.float32),
        draw_order=20.0,
    )


def _colours(triples: Sequence[tuple[int, int, int]]) -> npt.NDArray[np.uint32]:
    """Return the colours packed as 32-bit RGBA, opaque."""
    parts = np.array(triples, dtype=np.uint32).reshape(-1, 3)
    return (parts[:, 0] << 24 | parts[:, 1] << 16 | parts[:, 2] << 8 | 255).astype(np.uint32)


def opened_stream(application_id: str, rrd_path: str | Path) -> rr.RecordingStream:
    """Return a new stream to a file.

    Raises
    ------
    RerunSceneError
        The file cannot be created; one line.
    """
    batches = rr.ChunkBatcherConfig(flush_tick=FLUSH_S)
    stream = without_clock(rr.RecordingStream(application_id, batcher_config=batches))
    _create_file(Path(rrd_path))
    try:
        stream.set_sinks(rr.FileSink(str(rrd_path)))
    except RuntimeError as reason:
        raise RerunSceneError(f"view: file {rrd_path}: cannot be written: {first_line(reason)}") from reason
    return stream


def without_clock(stream: rr.RecordingStream) -> rr.RecordingStream:
    """Return a stream whose data have the times of the run only."""
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


def set_time(stream: rr.RecordingStream, time_s: float, step: int | None = None) -> None:
    """Set the time (s) and the step of the data logged next."""
    stream.reset_time()
    stream.set_time(SIM_TIME, duration=np.timedelta64(round(time_s * 1e9), "ns"))
    if step is not None:
        stream.set_time(STEP, sequence=step)


def closed_stream(stream: rr.RecordingStream) -> None:
    """Write the remaining data, and close the file.

    Raises
    ------
    RerunSceneError
        It could not be written completely.
    """
    try:
        stream.flush(timeout_sec=FLUSH_LIMIT_S)
    except (RuntimeError, ValueError) as reason:
        raise RerunSceneError(f"view: the file could not be written completely: {first_line(reason)}") from reason
    finally:
        stream.disconnect()


def first_line(reason: Exception) -> str:
    """Return the first line of an error's message."""
    return str(reason).partition("\n")[0]


def _create_file(path: Path) -> None:
    """Create the file, or check that it is a regular one: rerun itself would follow a symbolic link."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_NOFOLLOW | os.O_WRONLY | os.O_CLOEXEC, FILE_MODE))
    except OSError as reason:
        raise RerunSceneError(f"view: file {path}: cannot be written: {reason.strerror}") from reason


class RerunPictures:
    """The rerun recording of a run, with the plots of the page, extended with each picture."""

    def __init__(
        self, stream: rr.RecordingStream, panels: Sequence[Mapping[str, Any]], own_plots: int = OWN_PLOTS
    ) -> None:
        self._stream, self._own_plots = stream, own_plots
        self._mechanism = Mechanism(self._stream)
        self._lanes: set[str] = set()
        self._bounds: Bounds | None = None
        self._panels = panels
        self._names = {curve["path"]: curve["names"] for panel in panels for curve in panel["curves"]}
        for path, names in self._names.items():
            lines = series_lines(names, FIRST_COLOUR.get(path, 0), COLOURS.get(tuple(names)))
            self._stream.log(path, lines, static=True)

    def add(self, pictures: Iterable[Mapping[str, Any]]) -> None:
        """Add pictures in the order of arrival."""
        curves: dict[str, list[tuple[Values, Values]]] = {}
        for picture in pictures:
            for path, rows in picture["curves"].items():
                curves.setdefault(path, []).append(rows)
            self._show(picture)
        for path, parts in curves.items():
            self._send(path, parts)

    def _show(self, picture: Mapping[str, Any]) -> None:
        set_time(self._stream, picture["time_s"])
        words = [f"**{picture['state']}**", f"t = {picture['time_s']:.2f} s"]
        words += [f"{card[0]} {card[1]}" for card in picture["cards"]]
        words += [f"**ALARM: {picture['alarm']}**"] if picture["alarm"] else []
        line = picture.get("banner") or "  ·  ".join(words)
        self._stream.log(BANNER, rr.TextDocument(line, media_type=rr.MediaType.MARKDOWN))
        if picture.get("shapes"):
            self._mechanism.place(picture["shapes"])
        if picture["events"]:
            time_s, text = zip(*picture["events"], strict=True)
            self._stream.send_columns(EVENTS, times(time_s), rr.TextLog.columns(text=list(text)))
        lanes = {name for name, *_ in picture["lanes"]}
        for name, begin_s, word, changes in picture["lanes"]:
            since = [] if name in self._lanes else [(begin_s, word)]
            time_s, states = zip(*(since + changes), strict=True) if since + changes else ((), ())
            if states:
                path = f"{REGIMES}/{name.replace(' ', '_')}"
                self._stream.send_columns(path, times(time_s), rr.StateChange.columns(state=list(states)))
        bounds = None if picture.get("bounds") is None else Bounds(*picture["bounds"])
        if bounds != self._bounds or not lanes <= self._lanes:
            self._bounds, self._lanes = bounds, self._lanes | lanes
            self._stream.send_blueprint(self._layout())

    def _send(self, path: str, parts: Sequence[tuple[Values, Values]]) -> None:
        if path not in self._names:
            return
        time_s, values = (np.concatenate(column) for column in zip(*parts, strict=True))
        send_rows(self._stream, path, values.reshape(len(time_s), len(self._names[path])), time_s)

    def _layout(self) -> rrb.Blueprint:
        plots = [
            plot(
                panel["title"],
                [curve["path"] for curve in panel["curves"]],
                WINDOW_S,
                [name for curve in panel["curves"] for name in curve["names"]],
            )
            for panel in self._panels
        ]
        rest = plots[self._own_plots :]
        beside: list[rrb.View | rrb.Container] = [
            *plots[: self._own_plots],
            *([rrb.Tabs(*rest, active_tab=0)] if rest else []),
        ]
        regimes = rrb.StateTimelineView(origin="/", contents=[f"/{REGIMES}/**"], name="Regimes")
        below = rrb.Tabs(*([regimes] if self._lanes else []), events_view(has_level=False), active_tab=0)
        bounds = self._bounds
        if bounds is not None:  # in a small panel the texts at the edge need more room
            bounds = bounds._replace(low_m=bounds.low_m - ROOM * (bounds.high_m - bounds.low_m))
        left = rrb.Vertical(mechanism_view(bounds), below, row_shares=[3, 1])
        middle = rrb.Horizontal(left, *([rrb.Vertical(*beside)] if beside else []))
        return page(rrb.Vertical(banner_view(), middle, row_shares=[5, 95]))


def converter(name: str, panels: Sequence[Mapping[str, Any]]) -> Callable[[Sequence[Mapping[str, Any]]], bytes]:
    """Return a function that adds packed pictures to a recording, and returns its next bytes for the viewer."""
    stream = without_clock(rr.RecordingStream(name))
    found, pictures = rr.binary_stream(stream), RerunPictures(stream, panels)

    def taken(packed: Sequence[Mapping[str, Any]]) -> bytes:
        pictures.add(map(unpacked_picture, packed))
        return found.read() or b""

    return taken


class RerunFile(Closing):
    """A file for rerun in the place of a bench; see `BenchLink`."""

    is_live = False

    def __init__(self, name: str, rrd_path: str | Path) -> None:
        self._stream: rr.RecordingStream | None = opened_stream(name, rrd_path)
        self._pictures: RerunPictures | None = None

    @staticmethod
    def shapes(shapes: Iterable[Shape]) -> list[Shape]:
        """Return the shapes."""
        return list(shapes)

    @staticmethod
    def curves(curves: Iterable[Curves]) -> dict[str, tuple[Values, Values]]:
        """Return times and values by path."""
        return {each.path: (each.time_s, each.values) for each in curves}

    def tell(self, kind: str, content: Mapping[str, Any]) -> bool:
        """Take the layout; other messages are for a page only."""
        if kind == "layout" and self._stream is not None:
            self._pictures = RerunPictures(self._stream, content["panels"], OWN_PLOTS_OF_FILE)
        return True

    def show(self, picture: Mapping[str, Any]) -> bool:
        """Write a picture."""
        if self._pictures is not None:
            self._pictures.add([picture])
        return True

    def close(self) -> None:
        """Write the remaining data, and close the file; idempotent."""
        stream, self._stream, self._pictures = self._stream, None, None
        if stream is not None:
            closed_stream(stream)


def unpacked_picture(packed: Mapping[str, Any]) -> dict[str, Any]:
    """Return a picture with its curves and shapes unpacked."""
    rows = packed["curves"].items()
    curves = {path: (_unpacked(time_s, "<f8"), _unpacked(values, "<f4")) for path, (time_s, values) in rows}
    return {**packed, "curves": curves, "shapes": unpacked_shapes(packed["shapes"]) if packed.get("shapes") else None}


def unpacked_shapes(packed: Mapping[str, Any]) -> list[Shape]:
    """Return the shapes of a picture from its packed arrays."""
    points = _unpacked(packed["points"], "<f4").reshape(-1, 2)
    ends = np.cumsum(packed["counts"])
    fields = zip(
        packed["kinds"], packed["colours"], packed["widths"], packed["texts"], packed["counts"], ends, strict=True
    )
    return [
        Shape(
            "",
            KIND_OF_LETTER[letter],
            tuple(map(tuple, points[end - count : end].tolist())),
            tuple(colour),
            width,
            text,
        )
        for letter, colour, width, text, count, end in fields
    ]


def _unpacked(text: str, kind: str) -> Values:
    return np.frombuffer(base64.b64decode(text), dtype=kind).astype(np.float64)
