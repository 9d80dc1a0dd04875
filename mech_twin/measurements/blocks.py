# SPDX-License-Identifier: Apache-2.0
"""How a measurement is read: block by block, so that memory does not grow with its length."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from mech_twin.measurements.measurement_map import Source, TimeSource

Array = npt.NDArray[np.float64]
EPOCH_S = 1e6  # times beyond are counted from an epoch: their whole seconds are taken off before they become floats


class Block(NamedTuple):
    """Consecutive samples of one channel.

    Attributes
    ----------
    channel : int
        Index of the source that was asked for.
    times_s, values : ndarray
        Shape (n,): stamps, and values in the unit of the source.  A cell without a value is no sample; NaN is one.
    delays_s : ndarray
        Shape (n,): log time less stamp, less that of the first sample; empty where there is one clock only.
    """

    channel: int
    times_s: Array
    values: Array
    delays_s: Array


class SourceColumn(NamedTuple):
    """A channel that a measurement offers, and the first words about it: its unit, if its name tells it."""

    source: Source
    unit: str | None


class RunReader(Protocol):
    """One run of a measurement: a bag or a table."""

    path: Path

    def offered(self) -> list[SourceColumn]:
        """Return every channel that the run offers, that of the time left out."""

    def proposed_time(self) -> TimeSource:
        """Return where the time seems to stand."""

    def blocks(self, sources: Sequence[Source], time: TimeSource) -> Iterator[Block]:
        """Yield the samples of these channels, of each channel in the order of the run.

        Raises
        ------
        MeasurementError
            A source is not in the run, or a cell of it is no number.
        """


NO_DELAYS = np.empty(0)
