# SPDX-License-Identifier: Apache-2.0
"""Estimates of the observer: the frame of the model's run that fits best at first, and the result at each sample."""

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_steps import Indices
from mech_twin.engine.sample_vectors import Array
from mech_twin.samples import Event
from mech_twin.studies.observer.model_run import ModelRun, without_turns

CLOSE = 0.05  # of a column's range: unit of the differences
ACCEPTED = 4.0  # largest mean squared difference of an accepted fit


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
    channels, innovations, innovation_sigma : tuple
        Channel numbers of the sample, measured minus predicted (SI units), and the standard deviation of that.
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
    innovation_sigma: tuple[float, ...]
    used: tuple[bool, ...]
    events: tuple[Event, ...]


class SeenSample(NamedTuple):
    """Channels measured together: the machine's time (s), channel numbers, and their values in SI units."""

    time_s: float
    channels: tuple[int, ...]
    values: tuple[float, ...]


class Found(NamedTuple):
    """Step of the model's run at the newest sample, and the mean squared difference of the samples."""

    step: int
    difference: float


def located(run: ModelRun, places: Indices, samples: Sequence[SeenSample]) -> Found | None:
    """Return the best-fitting step of the run at the newest sample; None if the run is shorter than the samples."""
    end_s = samples[-1].time_s
    back = np.array([round((end_s - sample.time_s) / run.bank.step_s) for sample in samples])
    first = int(back.max())
    if first >= len(run.rows):
        return None
    steps = np.arange(first, len(run.rows))
    total, count = np.zeros(len(steps)), 0
    angles = set(run.angles.tolist())
    for sample, ago in zip(samples, back.tolist(), strict=True):
        for channel, value in zip(sample.channels, sample.values, strict=True):
            place = int(places[channel])
            difference = value - run.rows[steps - ago, place]
            if place in angles:
                difference = without_turns(difference)
            total += (difference / (CLOSE * run.spread[place])) ** 2
            count += 1
    best = int(total.argmin())
    return Found(int(steps[best]), float(total[best]) / count)
