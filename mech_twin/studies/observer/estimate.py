# SPDX-License-Identifier: Apache-2.0
"""Result of the observer at a sample."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from mech_twin.engine.sample_vectors import Array
from mech_twin.samples import Event


class ObserverState(Enum):
    """Whether the observer follows the machine."""

    SEARCHING = "searching"  # not yet locked on, or lost
    LOCKED = "locked"


class SensedChannel(NamedTuple):
    """A measured column of the machine: name, and standard deviation of its sensor (SI units; nan: unknown)."""

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
        All columns of the frame, as the roles compute them (`PhaseLockedObserver.frame` converts them to samples), and
        the standard deviation of each.
    channels, innovations : tuple
        Channel numbers of the sample, and measured minus predicted (SI units).
    used : tuple of bool
        Whether each channel was used; one with too large an innovation is rejected.
    events : tuple of Event
        Events of the estimated motion since the previous estimate, in the machine's time.
    """

    time_s: float
    step: int
    row: Array
    sigma: Array
    channels: tuple[int, ...]
    innovations: tuple[float, ...]
    used: tuple[bool, ...]
    events: tuple[Event, ...]
