# SPDX-License-Identifier: Apache-2.0
"""Logs the drawing of the mechanism to rerun: lines, points, arrows and texts, and the range they cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr

from mech_twin.samples import Shape
from mech_twin.view.extent import DrawnExtent
from mech_twin.view.labels import texts_of
from mech_twin.view.layout import MECHANISM

MIRROR = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
KINDS = ("line", "points", "arrow", "text")
FIGURE = f"{MECHANISM}/figure"
TEXT_RADIUS_M = 1e-9


class Mechanism(DrawnExtent):
    """The drawing of the mechanism: one entity, one row per drawing, in the machine's frame.

    Parameters
    ----------
    stream : rr.RecordingStream
        Destination of the drawing; the caller sets the time.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        super().__init__()
        self._stream = stream
        stream.log(MECHANISM, rr.Transform3D(mat3x3=MIRROR), static=True)  # the viewer's second axis points down

    def show(self, shapes: Sequence[Shape], notes: Sequence[Shape] = ()) -> None:
        """Log the shapes at the stream's time, with notes over them; `widen` sets the range, not this.

        Raises
        ------
        ValueError
            The kind of a shape is unknown.
        """
        bounds = self.bounds()
        width_m = 1.0 if bounds is None else bounds.right_m - bounds.left_m
        every = [shape for shape in (*shapes, *notes) if shape.kind != "text"]
        self.place([*texts_of(shapes, notes, width_m), *every])

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
