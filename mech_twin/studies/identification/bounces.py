# SPDX-License-Identifier: Apache-2.0
"""Coefficient of restitution from positions of a body bouncing under a constant force, in any unit, as from video.

Bounces are the turning points at the stop, all at one level; the other turning points come down with each bounce.  The
durations of successive flights have the ratio of the restitution, so neither the scale of the image
nor the force has to be known.

A mass that bounces under a constant force has flights of duration 2 v/a.  Each impact reduces the speed v by the
restitution e, so T(k+1) = e T(k).  A missed impact joins two flights; a false one divides a flight.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import stats
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Array

ON_SERIES = 0.2  # of a flight: tolerance for an impact to belong to a series
MOST_SEEDED = 40  # first impacts, whose pairs of flights are tried
LARGEST_RATIO = 1.2  # of a flight to the previous one: above 1 because of noise
NO_LOSS = 1e-9
ROUNDS = 5
LEAST_FLIGHT = 0.03  # of the range of positions: lower flights are below the resolution
MOST_SCATTER = 0.1  # of the range of positions: turning points farther apart are no bounces off one stop
FEWEST_BOUNCES = 3
FEWEST_CLEAN = 2  # runs without a missed or false bounce; with this many, the others are left out


class Estimate(NamedTuple):
    """A number estimated from several events.

    Attributes
    ----------
    value, standard_deviation : float
        The number, and its standard deviation; NaN where the events are as many as the unknowns.
    used : int
        Number of events used.
    missed, false : tuple of int
        Indices of the events before which one was missed, and of the false events.
    """

    value: float
    standard_deviation: float
    used: int
    missed: tuple[int, ...] = ()
    false: tuple[int, ...] = ()


def restitution_from_flights(impact_times_s: Array) -> Estimate:
    """Return the restitution of a mass bouncing under a constant force, from the times of its impacts.

    Every pair of flights gives a candidate series of impact times.  The series with most impacts is fitted to them by
    least squares in time; assignment and fit are repeated `ROUNDS` times.

    Parameters
    ----------
    impact_times_s : ndarray
        Shape (n,), ascending.

    Returns
    -------
    Estimate
        ``standard_deviation`` is that of the fitted restitution.

    Raises
    ------
    ValueError
        Fewer than three impacts, times that do not ascend, or no series that contains most of them.
    """
    times = np.asarray(impact_times_s, dtype=np.float64)
    if len(times) < 3 or not (np.diff(times) > 0.0).all():
        raise ValueError("expected at least three impacts at rising times")
    head = times[:MOST_SEEDED]
    series = max(_seeds(head), key=lambda each: _agreement(each, head))
    for _ in range(ROUNDS):
        places, numbers = _on(series, times)
        if len(places) < max(3, len(times) / 2):
            raise ValueError("expected flights that shorten by one ratio, found no such ratio")
        series, deviation = _fitted(series, times[places], numbers)
    places, numbers = _on(series, times)
    missed = tuple(int(places[i + 1]) for i in np.flatnonzero(np.diff(numbers) > 1))
    false = tuple(sorted(set(range(int(places[0]), int(places[-1]))) - set(places.tolist())))
    return Estimate(series.ratio, deviation, len(places), missed, false)


class _Series(NamedTuple):
    """Impacts at ``start + flight (1 - ratio^n) / (1 - ratio)``, n any integer."""

    start_s: float
    flight_s: float
    ratio: float

    def number(self, times_s: Array) -> Array:
        """Return n of each time, not rounded; NaN after the end of the series."""
        flown = (times_s - self.start_s) / self.flight_s
        if abs(1.0 - self.ratio) < NO_LOSS:
            return flown
        left = 1.0 - flown * (1.0 - self.ratio)
        return np.asarray(np.log(np.where(left > 0.0, left, np.nan)) / np.log(self.ratio))

    def times_s(self, numbers: Array) -> Array:
        """Return the time of each n."""
        if abs(1.0 - self.ratio) < NO_LOSS:
            return self.start_s + self.flight_s * numbers
        return self.start_s + self.flight_s * (1.0 - self.ratio**numbers) / (1.0 - self.ratio)


def _seeds(times: Array) -> Iterator[_Series]:
    flights = np.diff(times)
    for first in range(len(flights) - 1):
        for second in range(first + 1, len(flights)):
            ratio = float(flights[second] / flights[first]) ** (1.0 / (second - first))
            if ratio <= LARGEST_RATIO:
                yield _Series(float(times[first]), float(flights[first]), ratio)
    yield _Series(float(times[0]), float(flights[0]), 1.0)


def _on(series: _Series, times: Array) -> tuple[npt.NDArray[np.intp], Array]:
    """Return the indices of the impacts in a series, one for each n, and their n."""
    numbers = series.number(times)
    off = np.abs(numbers - np.round(numbers))
    best: dict[float, int] = {}
    for place in np.flatnonzero(off < ON_SERIES).tolist():
        number = float(np.round(numbers[place]))
        if number not in best or off[place] < off[best[number]]:
            best[number] = place
    places = np.array(sorted(best.values()), dtype=np.intp)
    return places, np.round(numbers[places])


def _agreement(series: _Series, times: Array) -> tuple[float, float]:
    """Return the number of impacts in a series minus the missing ones, then the negative mean deviation in time."""
    places, numbers = _on(series, times)
    if len(places) < 2:
        return -np.inf, 0.0
    empty = float(numbers[-1] - numbers[0]) + 1.0 - len(places)
    return len(places) - empty, -float(np.mean(np.abs(series.times_s(numbers) - times[places])))


def _fitted(series: _Series, times: Array, numbers: Array) -> tuple[_Series, float]:
    """Return the series fitted by least squares in time, and the standard deviation of its ratio."""

    def off(x: Array) -> Array:
        return _Series(float(x[0]), float(x[1]), float(x[2])).times_s(numbers) - times

    found = least_squares(
        off, series, x_scale=(series.flight_s, series.flight_s, 0.1), xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    variance = 2.0 * found.cost / (len(times) - 3) if len(times) > 3 else np.nan
    covariance = variance * np.linalg.pinv(found.jac.T @ found.jac)
    return _Series(*(float(value) for value in found.x)), float(np.sqrt(covariance[2, 2]))


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
        if not spread <= MOST_SCATTER:
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

    The interval comes from the scatter between runs; for one run, from that of its flights, which three bounces lack.
    """
    clean = [run for run in runs if run.clean]
    used = clean if len(clean) >= FEWEST_CLEAN else list(runs)
    values = np.array([run.found.value for run in used])
    known = [run.found.standard_deviation for run in used if np.isfinite(run.found.standard_deviation)]
    own = float(np.sqrt(np.mean(np.square(known)) / len(used))) if known else 0.0
    if len(used) == 1:
        own = own if known else np.inf
        freedom = max(used[0].found.used - 3, 1)
        return Restitution(float(values[0]), own, own * float(stats.t.ppf(0.975, freedom)), (used[0].path,))
    error = max(float(values.std(ddof=1)) / len(used) ** 0.5, own)
    half = error * float(stats.t.ppf(0.975, len(used) - 1))
    return Restitution(float(values.mean()), error, half, tuple(run.path for run in used))
