# SPDX-License-Identifier: Apache-2.0
r"""The phase portrait of a body joint: angular rate over angle for the recent past, older points fainter.

::

      rate  ^      . - .
            |   /         \        angle and rate are each scaled by a round number (1, 2 or 5
            |  |     o now |        times a power of ten), which labels the axis
     -------+-------------------> angle
            |   \         /
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import numpy as np
import rerun as rr

from mech_twin.samples import BodySample
from mech_twin.view.layout import ASPECT
from mech_twin.view.scale import round_above

SHADES = 6
TRACE = (86, 180, 233)
NOW = (230, 159, 0)
AXIS = (130, 130, 130)


class PhasePortrait:
    """Recent motion of one body joint, drawn in a rectangle of height 2.

    Parameters
    ----------
    path : str
        Entity path of the phase portrait.
    joint : str
        Joint name, shown on the axis.
    place : int
        Index of the joint in the body sample.
    span_s : float
        Simulated time span of the trace.
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
