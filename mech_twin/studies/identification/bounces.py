# SPDX-License-Identifier: Apache-2.0
"""Coefficient of restitution from positions of a body bouncing under a constant force, in any unit, as from video.

Bounces are the turning points at the stop, all at one level; the other turning points come down with each bounce.  The
durations of successive flights have the ratio of the restitution (`event_estimates`), so neither the scale of the image
nor the force has to be known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats
from scipy.signal import find_peaks

from mech_twin.measurements.blocks import Array
from mech_twin.measurements.errors import MeasurementError
from mech_twin.measurements.event_estimates import Estimate, restitution_from_flights

LEAST_FLIGHT = 0.03  # of the range of positions: lower flights are below the resolution
FEWEST_BOUNCES = 3
FEWEST_CLEAN = 2  # runs without a missed or false bounce; with this many, the others are left out


@dataclass(frozen=True)
class Bounces:
    """Result of one run: its column, the times of its bounces, and the restitution from its flights."""

    path: Path
    column: str
    times_s: Array
    found: Estimate

    @property
    def clean(self) -> bool:
        """Whether no bounce was missed, and none was false."""
        return not self.found.missed and not self.found.false

    @property
    def flaws(self) -> str:
        """Missed and false bounces as text; empty without any."""
        named = (("missed before", self.found.missed), ("false", self.found.false))
        return "; ".join(
            f"{word} {', '.join(f'{self.times_s[i]:.4g} s' for i in places)}" for word, places in named if places
        )


@dataclass(frozen=True)
class Restitution:
    """Restitution over several runs, with its 95 % interval, and the runs that were used."""

    value: float
    standard_error: float
    half_width: float
    used: tuple[Path, ...]


def bounce_times(times_s: Array, positions: Array) -> tuple[Array, float]:
    """Return the times of the lower turning points (s), and the scatter of their levels relative to the range.

    Parameters
    ----------
    times_s, positions : ndarray
        Shape (n,), in the order of time; positions rise away from the stop.
    """
    swing = float(np.ptp(positions))
    if swing <= 0.0:
        return np.zeros(0), np.inf
    padded = np.concatenate([[positions.max()], positions])  # a run may begin at a bounce
    places = find_peaks(-padded, prominence=LEAST_FLIGHT * swing)[0] - 1
    if len(places) < FEWEST_BOUNCES:
        return times_s[places], np.inf
    return times_s[places], float(np.std(positions[places])) / swing


def bounces(path: Path, times_s: Array, columns: Mapping[str, Array]) -> Bounces:
    """Return the bounces of a run, from the column and direction whose turning points have the least scatter.

    Raises
    ------
    MeasurementError
        No column contains a series of bounces.
    """
    tried = [
        (name, sign, *bounce_times(times_s, sign * values)) for name, values in columns.items() for sign in (1, -1)
    ]
    for name, _, times, spread in sorted(tried, key=lambda each: each[3]):
        if not np.isfinite(spread):
            break
        try:
            return Bounces(path, name, times, restitution_from_flights(times))
        except ValueError:
            continue
    raise MeasurementError(
        path, "no column shows bounces: expected at least three, with flights that shorten by one ratio"
    )


def restitution(runs: Sequence[Bounces]) -> Restitution:
    """Return the mean restitution over runs; runs with missed or false bounces are left out if enough are clean.

    The interval comes from the scatter between runs; for one run, from that of its flights.
    """
    clean = [run for run in runs if run.clean]
    used = clean if len(clean) >= FEWEST_CLEAN else list(runs)
    values = np.array([run.found.value for run in used])
    own = float(np.sqrt(np.mean([run.found.standard_deviation**2 for run in used]) / len(used)))
    if len(used) == 1:
        freedom = max(used[0].found.used - 3, 1)
        return Restitution(float(values[0]), own, own * float(stats.t.ppf(0.975, freedom)), (used[0].path,))
    error = max(float(values.std(ddof=1)) / len(used) ** 0.5, own)
    half = error * float(stats.t.ppf(0.975, len(used) - 1))
    return Restitution(float(values.mean()), error, half, tuple(run.path for run in used))
