# SPDX-License-Identifier: Apache-2.0
"""Block-by-block reading of a measurement, so that memory does not grow with its length."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from mech_twin.measurements.measurement_map import Source, TimeSource

Array = npt.NDArray[np.float64]
EPOCH_S = 1e6  # larger times count from an epoch: whole seconds are subtracted before conversion to float


class Block(NamedTuple):
    """Consecutive samples of one channel.

    Attributes
    ----------
    channel : int
        Index of the requested source.
    times_s, values : ndarray
        Shape (n,): stamps, and values in the unit of the source.  A cell without a value is no sample; NaN is one.
    delays_s : ndarray
        Shape (n,): log time minus stamp, relative to the first sample; empty with only one clock.
    """

    channel: int
    times_s: Array
    values: Array
    delays_s: Array


class SourceColumn(NamedTuple):
    """A channel in a measurement, and its unit if the name contains it."""

    source: Source
    unit: str | None


class RunReader(Protocol):
    """One run of a measurement: a bag or a table."""

    path: Path

    def offered(self) -> list[SourceColumn]:
        """Return every channel in the run except that of time."""

    def proposed_time(self) -> TimeSource:
        """Return the probable source of time."""

    def blocks(self, sources: Sequence[Source], time: TimeSource) -> Iterator[Block]:
        """Yield the samples of these channels in blocks, each channel in the order of the run.

        Raises
        ------
        MeasurementError
            A source is not in the run, or a cell of it is not a number.
        """


NO_DELAYS = np.empty(0)
