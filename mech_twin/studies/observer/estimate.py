# SPDX-License-Identifier: Apache-2.0
"""What the observer says of a machine at a sample."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from mech_twin.engine.sample_vectors import Array
from mech_twin.samples import Event


class ObserverState(Enum):
    """Whether estimates are to be had."""

    SEARCHING = "searching"  # not yet locked on, or lost
    LOCKED = "locked"


class SensedChannel(NamedTuple):
    """A measured column of the machine: name, and standard deviation of its sensor (SI units; nan: not known)."""

    column: str
    sigma: float


class FrameEstimate(NamedTuple):
    """Estimated frame at a sample.

    Attributes
    ----------
    time_s : float
        The machine's time.
    step : int
        Step of the model at or after the sample.
    row, sigma : ndarray, shape (w,)
        Every number of the frame, as the roles compute them (`PhaseLockedObserver.frame` makes samples of it), and the
        standard deviation of each.
    channels, innovations : tuple
        Which channels the sample had, and how much more they showed than was predicted (SI units).
    used : tuple of bool
        Whether a channel was used; one too far off to be believed is not.
    events : tuple of Event
        Events of the estimated motion since the estimate before, at the machine's time.
    """

    time_s: float
    step: int
    row: Array
    sigma: Array
    channels: tuple[int, ...]
    innovations: tuple[float, ...]
    used: tuple[bool, ...]
    events: tuple[Event, ...]
