# SPDX-License-Identifier: Apache-2.0
"""Placement of the names of links and forces: beside their lines, without overlap.

The viewer writes in pixels, centred below a point; a figure of a given width (m) is taken to fill a usual panel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mech_twin.samples import Shape

PANEL_PX, LETTER_PX, LINE_PX = 700.0, 6.6, 20.0  # width of a usual panel, of a letter, height of a line
FRAME_PX = 12.0  # padding of the box of a text, both sides together
SHIFTS = (0.0, 1.15, -1.15, 2.3, -2.3, 3.45, -3.45)  # vertical shifts in lines, tried in this order
SIDES = (0.0, 1.1, -1.1, 2.2, -2.2)  # horizontal shifts in half text widths, tried if no vertical shift is free


class _Box(NamedTuple):
    """A rectangle: centre, half width and half height (m)."""

    x: float
    y: float
    half_width: float
    half_height: float

    def overlap(self, other: _Box) -> float:
        """Return the overlapping area (m2)."""
        wide = self.half_width + other.half_width - abs(self.x - other.x)
        high = self.half_height + other.half_height - abs(self.y - other.y)
        return wide * high if wide > 0.0 and high > 0.0 else 0.0


def written_beside(shape: Shape, width_m: float) -> Shape:
    """Return the text of a line or arrow as a separate text beside its middle, or inside a closed line."""
    points = np.array(shape.points_m)
    pixel_m = width_m / PANEL_PX
    text_m, line_m = (len(shape.text) * LETTER_PX + FRAME_PX) * pixel_m, LINE_PX * pixel_m
    if len(points) > 3 and np.array_equal(points[0], points[-1]):
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    else:
        place = (len(points) - 1) // 2
        along = points[place + 1] - points[place]
        normal = np.array([along[1], -along[0]]) / (np.hypot(*along) or 1.0)
        normal *= 1.0 if normal[0] > 0.0 else -1.0  # to the right
        away = 0.5 * np.abs(normal) @ (text_m, line_m) + 0.5 * shape.width_m + 3.0 * pixel_m
        middle = 0.5 * (points[place] + points[place + 1]) + away * normal
    top = (float(middle[0]), float(middle[1]) + 0.5 * line_m)
    return Shape(f"{shape.name}_text", "text", (top,), shape.colour, line_m, shape.text)


def texts_of(shapes: Sequence[Shape], notes: Sequence[Shape], width_m: float) -> list[Shape]:
    """Return the texts of a drawing that have no fixed position.

    Those of the notes - letters of the pins, values, scales - have their places first; names make room for them and for
    each other.
    """
    every = (*shapes, *notes)
    letters = [shape for shape in every if shape.kind == "points" and shape.text]
    first = apart([shape for shape in notes if shape.kind == "text"], letters, width_m)
    names = [shape for shape in shapes if shape.kind == "text"]
    names += [written_beside(shape, width_m) for shape in every if shape.kind in ("line", "arrow") and shape.text]
    return [*first, *apart(names, [*first, *letters], width_m)]


def apart(texts: Sequence[Shape], fixed: Sequence[Shape], width_m: float) -> list[Shape]:
    """Return texts, shifted by a few lines at most if they would cover each other or a fixed text."""
    line_m = LINE_PX * width_m / PANEL_PX
    taken = [_box(shape, width_m) for shape in fixed]
    placed = []
    for shape in texts:
        box = _box(shape, width_m)
        best = _freest(box, taken, line_m)
        taken.append(best)
        ((x, y),) = shape.points_m
        placed.append(shape._replace(points_m=((x + best.x - box.x, y + best.y - box.y),)))
    return placed


def _freest(box: _Box, taken: Sequence[_Box], line_m: float) -> _Box:
    """Return the first place without overlap, usually the wanted one, else the one with the least overlap."""
    least, best = np.inf, box
    for side in SIDES:
        for shift in SHIFTS:
            tried = box._replace(x=box.x + side * box.half_width, y=box.y + shift * line_m)
            covered = sum([tried.overlap(other) for other in taken])
            if covered == 0.0:
                return tried
            if covered < least:
                least, best = covered, tried
    return best


def _box(shape: Shape, width_m: float) -> _Box:
    pixel_m = width_m / PANEL_PX
    rows = shape.text.split("\n")
    half_height = 0.5 * LINE_PX * len(rows) * pixel_m
    x, y = shape.points_m[0]
    return _Box(x, y - half_height, 0.5 * (max(map(len, rows)) * LETTER_PX + FRAME_PX) * pixel_m, half_height)
