# SPDX-License-Identifier: Apache-2.0
"""Logs time series of the samples to rerun.

Curves of a group (one quantity of all joints, one component of all pins) share one entity, one time column and one
call, which is several times faster than one call per curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import rerun as rr

SIM_TIME = "sim_time"
STEP = "step"

# legible on dark and light backgrounds, distinguishable by colour-blind readers (after Okabe and Ito)
PALETTE = (
    (86, 180, 233), (230, 159, 0), (0, 178, 130), (204, 121, 167), (213, 94, 0), (120, 120, 235), (178, 168, 40),
    (150, 150, 150),
)  # fmt: skip
# groups that share a panel with others start at a later palette colour
FIRST_COLOUR = {
    "motor/torque": 4,
    "motor/speed": 4,
    "linkage_sliding/speed": 2,
    "linkage_sliding/position": 2,
    "linkage_sliding/effort": 2,
    "body_moment": 1,
    "residuals/forces": 3,
    "residuals/body": 6,
}


class Times(NamedTuple):
    """A time column for rerun; its own ``TimeColumn`` is thirty times slower for durations."""

    name: str
    values: pa.Array

    def timeline_name(self) -> str:
        """Return the name of the timeline."""
        return self.name

    def as_arrow_array(self) -> pa.Array:
        """Return the times."""
        return self.values


def times(time_s: npt.ArrayLike, step: npt.ArrayLike | None = None) -> list[Times]:
    """Return the time columns: simulation time (rounded to nanoseconds) and, if given, the step."""
    nanoseconds = np.round(np.asarray(time_s, dtype=np.float64) * 1e9).astype(np.int64)
    columns = [Times(SIM_TIME, pa.array(nanoseconds).view(pa.duration("ns")))]
    if step is not None:
        columns.append(Times(STEP, pa.array(np.asarray(step, dtype=np.int64))))
    return columns


def send_rows(
    stream: rr.RecordingStream,
    path: str,
    values: npt.NDArray[np.float64],
    time_s: npt.NDArray[np.float64],
    step: npt.NDArray[np.int64] | None = None,
) -> None:
    """Send rows of curves that share an entity, values of shape (n, k)."""
    columns = rr.Scalars.columns(scalars=values.ravel())
    stream.send_columns(path, times(time_s, step), columns.partition(np.full(len(values), values.shape[1])))


def series_lines(
    names: Sequence[str], first_colour: int = 0, colours: Sequence[tuple[int, int, int]] | None = None
) -> rr.SeriesLines:
    """Return names, colours and width of curves; a joint or pin has the same colour in every panel."""
    given = colours or [PALETTE[(first_colour + place) % len(PALETTE)] for place in range(len(names))]
    return rr.SeriesLines(names=list(names), colors=list(given), widths=[1.5] * len(names))
