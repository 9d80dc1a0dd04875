"""The drawing of the mechanism in rerun: lines, points and arrows, and the range of the plane they cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr

from mech_twin.samples import Shape
from mech_twin.view.layout import MECHANISM, Bounds

MARGIN = 0.12
MIRROR = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
KINDS = ("line", "points", "arrow")


class Mechanism:
    """The drawing of the mechanism: one entity for each kind of shape, in the machine's own frame.

    Parameters
    ----------
    stream : rr.RecordingStream
        Destination of the drawing; the caller sets the time.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._extent: Bounds | None = None
        self._drawn: set[str] = set()
        stream.log(MECHANISM, rr.Transform3D(mat3x3=MIRROR), static=True)  # the viewer's second axis points down

    def show(self, shapes: Sequence[Shape]) -> None:
        """Log the shapes at the stream's time.

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
        for kind, chosen in by_kind.items():
            if chosen or kind in self._drawn:  # an emptied kind must be cleared in the viewer
                self._drawn.add(kind)
                getattr(self, f"_log_{kind}")(chosen)
        points = [point for shape in shapes for point in shape.points_m]
        if points:
            self._widen(np.array(points))

    def within(self, bounds: Bounds | None) -> bool:
        """Return whether everything drawn so far lies within these bounds."""
        extent = self._extent
        if extent is None or bounds is None:
            return extent is None
        return (
            bounds.left_m <= extent.left_m
            and extent.right_m <= bounds.right_m
            and bounds.low_m <= extent.low_m
            and extent.high_m <= bounds.high_m
        )

    def bounds(self) -> Bounds | None:
        """Return the range of everything drawn so far plus a margin; None before the first drawing."""
        extent = self._extent
        if extent is None:
            return None
        margin = MARGIN * max(extent.right_m - extent.left_m, extent.high_m - extent.low_m, 1e-3)
        return Bounds(extent.left_m - margin, extent.right_m + margin, extent.low_m - margin, extent.high_m + margin)

    def _widen(self, points: npt.NDArray[np.float64]) -> None:
        (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
        extent = self._extent
        if extent is not None:
            left, right = min(left, extent.left_m), max(right, extent.right_m)
            low, high = min(low, extent.low_m), max(high, extent.high_m)
        self._extent = Bounds(float(left), float(right), float(low), float(high))

    def _log_line(self, shapes: list[Shape]) -> None:
        self._stream.log(
            f"{MECHANISM}/lines",
            rr.LineStrips2D(
                [np.array(shape.points_m, dtype=np.float32) for shape in shapes],
                colors=_colours([shape.colour for shape in shapes]),
                radii=np.array([shape.width_m / 2.0 for shape in shapes], dtype=np.float32),
                labels=[shape.name for shape in shapes],
                show_labels=False,
                draw_order=0.0,
            ),
        )

    def _log_points(self, shapes: list[Shape]) -> None:
        owners = [shape for shape in shapes for _ in shape.points_m]
        self._stream.log(
            f"{MECHANISM}/points",
            rr.Points2D(
                np.array([point for shape in shapes for point in shape.points_m], dtype=np.float32).reshape(-1, 2),
                colors=_colours([shape.colour for shape in owners]),
                radii=np.array([shape.width_m / 2.0 for shape in owners], dtype=np.float32),
                labels=[shape.name for shape in owners],
                show_labels=False,
                draw_order=10.0,
            ),
        )

    def _log_arrow(self, shapes: list[Shape]) -> None:
        ends = np.array([shape.points_m for shape in shapes], dtype=np.float32).reshape(-1, 2, 2)
        self._stream.log(
            f"{MECHANISM}/arrows",
            rr.Arrows2D(
                origins=ends[:, 0],
                vectors=ends[:, 1] - ends[:, 0],
                colors=_colours([shape.colour for shape in shapes]),
                radii=np.array([shape.width_m / 2.0 for shape in shapes], dtype=np.float32),
                labels=[shape.name for shape in shapes],
                show_labels=False,
                draw_order=20.0,
            ),
        )


def _colours(triples: Sequence[tuple[int, int, int]]) -> npt.NDArray[np.uint32]:
    """Return the colours packed as 32-bit RGBA, opaque."""
    parts = np.array(triples, dtype=np.uint32).reshape(-1, 3)
    return (parts[:, 0] << 24 | parts[:, 1] << 16 | parts[:, 2] << 8 | 255).astype(np.uint32)
