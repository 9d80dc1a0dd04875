# SPDX-License-Identifier: Apache-2.0
"""The range of the machine's plane covered by its drawings, round numbers for scale bars, and places of labels.

Names of links and forces stand beside their lines, without overlap.  The viewer writes in pixels, centred below a
point; a figure of a given width (m) is taken to fill a usual panel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mech_twin.samples import Event, Shape

LEAST_SPEED_M_PER_S = 1e-3  # slower impacts are not logged: they are the end of a series of bounces
ROUNDING_M_PER_S = 1e-9  # a slower contact is at rest except for rounding
PANEL_PX, LETTER_PX, LINE_PX = 700.0, 6.6, 20.0  # width of a usual panel, of a letter, height of a line
FRAME_PX = 12.0  # padding of the box of a text, both sides together
SHIFTS = (0.0, 1.15, -1.15, 2.3, -2.3, 3.45, -3.45)  # vertical shifts in lines, tried in this order
SIDES = (0.0, 1.1, -1.1, 2.2, -2.2)  # horizontal shifts in half text widths, tried if no vertical shift is free
PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"))
MARGIN = 0.08
CAPTION = 0.16  # share of the figure's height below the drawing, for values and scales
ASPECT = 1.3  # width to height of the panel the figure is made for


def is_logged(event: Event) -> bool:
    """Return whether an event is logged: a change of state, or an impact above a minimum speed."""
    speed = max(abs(event.pre_velocity_m_per_s), abs(event.post_velocity_m_per_s))
    return event.impulse_ns == 0.0 or speed >= LEAST_SPEED_M_PER_S


def event_line(event: Event, turning_stops: frozenset[str] = frozenset()) -> str:
    """Return the event as text: kind, contact, velocities before and after, impulse, cycle."""
    speed, impulse = ("rad/s", "N m s") if event.contact in turning_stops else ("m/s", "N s")
    words = [f"{event.time_s:.6f} s  {event.kind} ({event.contact})"]
    if max(abs(event.pre_velocity_m_per_s), abs(event.post_velocity_m_per_s)) > ROUNDING_M_PER_S:
        words.append(f"{event.pre_velocity_m_per_s:+.4g} -> {event.post_velocity_m_per_s:+.4g} {speed}")
    if event.impulse_ns != 0.0:
        words.append(f"{event.impulse_ns:.4g} {impulse}")
    return "  ".join([*words, f"cycle {event.period}"])


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


def with_placed_texts(shapes: Sequence[Shape], notes: Sequence[Shape], bounds: Bounds | None) -> list[Shape]:
    """Return a drawing and the notes over it, then their texts without a fixed position, placed within the bounds.

    Those of the notes - letters of the pins, values, scales - have their places first; names make room for them and for
    each other.
    """
    every, width_m = (*shapes, *notes), 1.0 if bounds is None else bounds.width_m
    letters = [shape for shape in every if shape.kind == "points" and shape.text]
    first = apart([shape for shape in notes if shape.kind == "text"], letters, width_m)
    names = [shape for shape in shapes if shape.kind == "text"]
    names += [written_beside(shape, width_m) for shape in every if shape.kind in ("line", "arrow") and shape.text]
    drawn = [shape for shape in every if shape.kind != "text"]
    return [*drawn, *first, *apart(names, [*first, *letters], width_m)]


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


def round_above(value: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is not below the value; 1 for zero."""
    if not (value > 0.0 and math.isfinite(value)):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0, 20.0) if step * power >= value)


def with_prefix(value: float, unit: str) -> str:
    """Return a value to three digits with an SI prefix: 1731 N is ``1.73 kN``; a value below 1e-6 is 0."""
    rounded = abs(float(f"{value:.3g}"))  # 999.6 is 1 k
    for factor, prefix in PREFIXES:
        if rounded >= factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    return f"0 {unit}" if rounded < PREFIXES[-1][0] else f"{value} {unit}"


class Bounds(NamedTuple):
    """Visible range of the machine's plane, m."""

    left_m: float
    right_m: float
    low_m: float
    high_m: float

    @property
    def width_m(self) -> float:
        """Its width."""
        return self.right_m - self.left_m


class DrawnExtent:
    """Range covered by all drawings so far."""

    def __init__(self) -> None:
        self._extent: Bounds | None = None

    def widen(self, shapes: Sequence[Shape]) -> None:
        """Extend the visible range to these shapes."""
        points = np.array([point for shape in shapes for point in shape.points_m]).reshape(-1, 2)
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            return
        (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
        extent = self._extent
        if extent is not None:
            left, right = min(left, extent.left_m), max(right, extent.right_m)
            low, high = min(low, extent.low_m), max(high, extent.high_m)
        self._extent = Bounds(float(left), float(right), float(low), float(high))

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
        width, height = extent.right_m - extent.left_m + 2.0 * margin, extent.high_m - extent.low_m + 2.0 * margin
        below = CAPTION * max(height, width / ASPECT)
        width, height = max(width, ASPECT * (height + below)), max(height + below, width / ASPECT)
        x = 0.5 * (extent.left_m + extent.right_m)
        low = 0.5 * (extent.low_m + extent.high_m - below - height)
        return Bounds(x - 0.5 * width, x + 0.5 * width, low, low + height)

    def kept(self, bounds: Bounds | None) -> Bounds | None:
        """Return these bounds while everything drawn lies within them, else those of everything drawn."""
        return bounds if self.within(bounds) else self.bounds()
