# SPDX-License-Identifier: Apache-2.0
"""Logs time series of the samples to rerun.

Curves of a group (one quantity of all joints, one component of all pins) share one entity, one time column and one
call, which is several times faster than one call per curve.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import rerun as rr

from mech_twin.samples import BodySample, ForceSample, LinkageSample, MotorSample
from mech_twin.view.curve_groups import Group, Groups, same_names
from mech_twin.view.sending import extreme_rows, worst_values

SIM_TIME = "sim_time"
STEP = "step"

# legible on dark and light backgrounds, distinguishable by colour-blind readers (after Okabe and Ito)
PALETTE = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 178, 130),
    (204, 121, 167),
    (213, 94, 0),
    (120, 120, 235),
    (178, 168, 40),
    (150, 150, 150),
)
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
WINDOW = 5  # samples, whose extremes are kept
BATCH_S = 0.1  # simulated time per batch
WORST_WINDOWS = 5


Sample = TypeVar("Sample", bound=MotorSample | LinkageSample | ForceSample | BodySample)


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


class Track(Generic[Sample]):
    """Buffers the samples of one role, decimates them and sends them to rerun in batches.

    Parameters
    ----------
    groups : callable
        Converts samples with equal names to groups of curves.
    """

    def __init__(self, stream: rr.RecordingStream, groups: Callable[[Sequence[Sample]], Groups]) -> None:
        self._stream = stream
        self._groups = groups
        self._pending: deque[Sample] = deque()
        self.curves: dict[str, tuple[str, ...]] = {}
        self.units: dict[str, str] = {}

    def add(self, sample: Sample) -> bool:
        """Add a sample; return whether this sent a batch."""
        sent = False
        if self._pending and not same_names(self._pending[0], sample):
            sent = self.flush()
        self._pending.append(sample)
        if sample.time_s - self._pending[0].time_s < BATCH_S:
            return sent
        return self._send(len(self._pending) - len(self._pending) % WINDOW) or sent

    def flush(self) -> bool:
        """Send the remaining samples, including an incomplete window; return whether there were any."""
        return self._send(len(self._pending))

    def _send(self, count: int) -> bool:
        batch = [self._pending.popleft() for _ in range(count)]
        if not batch:
            return False
        time_s = np.array([sample.time_s for sample in batch])
        step = np.array([sample.step for sample in batch])
        for group in self._groups(batch):
            if not group.names:
                continue
            if self.curves.get(group.path) != group.names:
                self.curves[group.path] = group.names
                self.units[group.path] = group.unit
                self._stream.log(group.path, series_lines(group.names, FIRST_COLOUR.get(group.path, 0)), static=True)
            self._send_group(group, time_s, step)
        return True

    def _send_group(self, group: Group, time_s: npt.NDArray[np.float64], step: npt.NDArray[np.int64]) -> None:
        if group.worst:
            rows, values = worst_values(group.values, WORST_WINDOWS * WINDOW)
        else:
            rows = extreme_rows(group.values, WINDOW)
            values = group.values[rows]
        send_rows(self._stream, group.path, values, time_s[rows], step[rows])


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
