# SPDX-License-Identifier: Apache-2.0
"""The range of the machine's plane covered by its drawings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mech_twin.samples import Shape

MARGIN = 0.08
CAPTION = 0.16  # share of the figure's height below the drawing, for values and scales
ASPECT = 1.3  # width to height of the panel the figure is made for


class Bounds(NamedTuple):
    """Visible range of the machine's plane, m."""

    left_m: float
    right_m: float
    low_m: float
    high_m: float


class DrawnExtent:
    """Range covered by all drawings so far."""

    def __init__(self) -> None:
        self._extent: Bounds | None = None

    def widen(self, shapes: Sequence[Shape]) -> None:
        """Extend the visible range to these shapes."""
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
        width, height = extent.right_m - extent.left_m + 2.0 * margin, extent.high_m - extent.low_m + 2.0 * margin
        below = CAPTION * max(height, width / ASPECT)
        width, height = max(width, ASPECT * (height + below)), max(height + below, width / ASPECT)
        x = 0.5 * (extent.left_m + extent.right_m)
        low = 0.5 * (extent.low_m + extent.high_m - below - height)
        return Bounds(x - 0.5 * width, x + 0.5 * width, low, low + height)

    def _widen(self, points: npt.NDArray[np.float64]) -> None:
        (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
        extent = self._extent
        if extent is not None:
            left, right = min(left, extent.left_m), max(right, extent.right_m)
            low, high = min(low, extent.low_m), max(high, extent.high_m)
        self._extent = Bounds(float(left), float(right), float(low), float(high))
