# SPDX-License-Identifier: Apache-2.0
"""Control charts of prewhitened features: two-sided CUSUM of each, jump of the vector (GLR), chi-square of the vector.

With u the innovation of a feature over its standard deviation and z the whitened vector::

    up_t = max(0, up_(t-1) + u_t - k),   down_t = max(0, down_(t-1) - u_t - k),   k = 0.5      (drift)
    glr_t = max over n <= N of |z_(t-n+1) + ... + z_t|^2/n                                   (jump n cycles ago)
    chi_t = |z_t|^2                                                                      (single outlying cycle)

The thresholds follow from one required mean time between false alarms (ARL0) of all charts together.  The charts run
over long bootstrap sequences of the healthy innovations.  Moving blocks, several times as long as the window of the
charts, keep the dependence that prewhitening left.  Each sequence is evaluated with a baseline refitted to a draw of
the original baseline's length.  With M the largest value in a block of B cycles, the nominal rate of alarms at a
threshold h is r(h) = -ln P(M <= h)/B.  All charts have the same nominal rate.

The nominal rate is too low, since the baseline was fitted to the cycles that are drawn: on independent normal values,
19 features and 10 000 cycles, alarms were 1.1 times as frequent as required.  A second bootstrap corrects it.
Baselines of the same length are drawn; each gets its own curves and evaluates further draws from the original
innovations.  The rate at which any chart falls below a nominal rate estimates the true rate of alarms.

Sources: PageInspection1954, SiegmundSequential1985 (run length), LaiSequential1995 (window), HotellingQuality1947;
KunschBootstrap1989 (moving blocks), BeranPrepivoting1987 (second bootstrap), JensenEstimated2006 (estimated values).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field
from scipy.linalg import cholesky

from mech_twin.capabilities.cycle import Array
from mech_twin.kernels.kernel import kernel
from mech_twin.studies.monitoring.baseline import LARGEST_ORDER, Baseline, Size, baseline_of_runs

ALLOWANCE = 0.5  # k, in standard deviations: best against a drift of one
WINDOW = 60  # N, cycles that the jump chart looks back
SEQUENCES, SEQUENCE_CYCLES = 40, 10_000
REDRAWN, REDRAWN_SEQUENCES, JUDGED_SEQUENCES = 16, 16, 4  # redrawn baselines; sequences for the curves, and to evaluate
MOST_CALIBRATED = 1000.0  # largest correction: with few cycles or no noise, redrawn baselines are not representative
BLOCK_CYCLES = 250  # over which the largest value is taken
MOVING_BLOCK = 4 * WINDOW  # cycles per block: a joint inside the window hides dependence that is slower than a block
SHORTEST_BLOCK, LEAST_BLOCKS = 20, 20  # for a short baseline, which needs enough blocks to draw from
SETTLING = 500  # cycles dropped at the start of a draw, which begins at the mean
LONGEST_REDRAWN = 20_000  # cycles of a redrawn baseline; a longer one counts with the estimation error of this length
GAUSSIAN_BELOW = 200  # cycles: a shorter baseline cannot show its tails, so normal values are drawn
CLEAR_CYCLES = 50.0  # mean run length at the level below which a chart counts as quiet
LEAST_OVER = 10  # blocks above a level, for its rate to count as measured
RAREST = -100.0  # ln of the rate to which a curve is extrapolated
LEAST_ALARM_CYCLES = 3.0


class ChartValues(NamedTuple):
    """Statistics of a cycle: largest CUSUM, jump, chi-square; index of the drifting feature, age of the jump."""

    cusum: float
    glr: float
    chi_square: float
    feature: int
    jump_cycles: int

    @property
    def statistics(self) -> tuple[float, float, float]:
        """The three statistics in the order of `CHARTS`."""
        return self.cusum, self.glr, self.chi_square


@kernel
def advance_cusum(u: Array, allowance: float, cap: float, up: Array, down: Array) -> tuple[float, int]:
    """Advance both sums of each feature by one cycle, at most ``cap``; return the largest and its feature's index."""
    largest, feature = 0.0, 0
    for i in range(len(u)):
        up[i] = min(max(0.0, up[i] + u[i] - allowance), cap)
        down[i] = min(max(0.0, down[i] - u[i] - allowance), cap)
        here = max(up[i], down[i])
        if here > largest:
            largest, feature = here, i
    return largest, feature


@kernel
def advance_jumps(z: Array, newest: int, count: int, sums: Array, squares: Array) -> tuple[float, int]:
    """Add a cycle to ``sums`` (d, N), each since another of the last N cycles; return the largest |sum|^2/n, and n.

    The sum since this cycle takes place ``newest``; ``count`` places are in use.  ``squares`` (N,) is a work array.
    """
    width, length = sums.shape
    for place in range(length):
        squares[place] = 0.0
    for i in range(width):
        value, since = z[i], sums[i]
        since[newest] = 0.0
        for place in range(length):
            since[place] += value
            squares[place] += since[place] * since[place]
    best, age, place = 0.0, 0, newest
    for n in range(1, count + 1):
        if squares[place] > best * n:
            best, age = squares[place] / n, n
        place = place - 1 if place > 0 else length - 1
    return best, age


@kernel
def chart_rows(u: Array, z: Array, allowance: float, window: int) -> Array:
    """Return the three statistics (n, 3) of a run of standardised (n, d) and whitened (n, d) innovations."""
    cycles, width = z.shape
    up, down, sums, squares = np.zeros(width), np.zeros(width), np.zeros((width, window)), np.zeros(window)
    found = np.zeros((cycles, 3))
    for t in range(cycles):
        found[t, 0], _ = advance_cusum(u[t], allowance, 1e300, up, down)
        found[t, 1], _ = advance_jumps(z[t], t % window, min(t + 1, window), sums, squares)
        for i in range(width):
            found[t, 2] += z[t, i] * z[t, i]
    return found


@dataclass
class ChartState:
    """State of the charts of one monitor; `advance` takes one cycle.

    Parameters
    ----------
    cap : float
        Upper bound of the sums, so that they fall back soon after a long fault.
    """

    width: int
    cap: float

    def __post_init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Reset the charts, for example after a fault has gone."""
        self._up, self._down = np.zeros(self.width), np.zeros(self.width)
        self._sums, self._squares = np.zeros((self.width, WINDOW)), np.zeros(WINDOW)
        self._cycles = 0

    def advance(self, u: Array, z: Array) -> ChartValues:
        """Return the statistics after a cycle of standardised (d,) and whitened (d,) innovations."""
        cusum, feature = advance_cusum(u, ALLOWANCE, self.cap, self._up, self._down)
        newest = self._cycles % WINDOW
        self._cycles += 1
        glr, age = advance_jumps(z, newest, min(self._cycles, WINDOW), self._sums, self._squares)
        return ChartValues(float(cusum), float(glr), float(z @ z), int(feature), int(age))


def siegmund_run_length(threshold: float, allowance: float = ALLOWANCE, shift: float = 0.0) -> float:
    """Return Siegmund's approximate mean run length of the two-sided CUSUM of normal values of unit variance.

    One-sided, with D = shift - k and b = h + 1.166: (exp(-2 D b) + 2 D b - 1)/(2 D^2), b^2 for D = 0; two-sided,
    1/ARL = 1/ARL+ + 1/ARL-.  Source: SiegmundSequential1985; MontgomeryQuality2013, chapter 9.
    """
    b = threshold + 1.166

    def one_sided(drift: float) -> float:
        if abs(drift) < 1e-9:
            return b * b
        return (exp(min(-2.0 * drift * b, 700.0)) + 2.0 * drift * b - 1.0) / (2.0 * drift * drift)

    return 1.0 / (1.0 / one_sided(shift - allowance) + 1.0 / one_sided(-shift - allowance))


class Thresholds(NamedTuple):
    """One threshold for each chart's statistic."""

    cusum: Size
    glr: Size
    chi_square: Size


CHARTS = Thresholds._fields


@dataclass(frozen=True)
class ChartLimits:
    """Alarm thresholds of the charts, and the levels below which they count as quiet.

    ``arl0_cycles`` is the required mean number of healthy cycles between alarms of any chart; ``extrapolated`` is true
    if the baseline is shorter than three times that.
    """

    alarm: Thresholds
    quiet: Thresholds
    arl0_cycles: Annotated[float, Field(gt=0.0)]
    extrapolated: bool


class RateCurve(NamedTuple):
    """Thresholds, ascending, and ln of the alarm rate (per cycle) at each; the tail is a straight line."""

    levels: Array
    log_rates: Array

    def level(self, rate: float) -> float:
        """Return the threshold with this alarm rate."""
        return float(np.interp(-np.log(rate), -self.log_rates, self.levels))

    def log_rate(self, values: Array) -> Array:
        """Return ln of the alarm rate at these thresholds."""
        return np.asarray(np.interp(values, self.levels, self.log_rates))


def rate_curve(maxima: Array) -> RateCurve:
    """Return the alarm rate as a function of the threshold, from the maxima of blocks of `BLOCK_CYCLES`.

    It is measured where at least `LEAST_OVER` blocks exceed the level; a line through its upper half extends ln r.
    """
    ordered, over = np.sort(maxima), np.arange(len(maxima) - 1, LEAST_OVER - 1, -1)
    levels, rates = ordered[: len(over)], np.log(-np.log1p(-over / len(maxima)) / BLOCK_CYCLES)
    upper = slice(len(levels) // 2, None)
    slope, offset = np.polyfit(levels[upper], rates[upper], 1)
    beyond = np.array([min(rates[-1] - 1e-9, offset + slope * levels[-1]), RAREST])
    line = np.maximum((beyond - offset) / slope, levels[-1])
    return RateCurve(np.append(levels, line), np.append(rates, beyond))


def chart_limits(baseline: Baseline, innovations: Sequence[Array], arl0_cycles: float, seed: int = 0) -> ChartLimits:
    """Return the thresholds for a baseline.

    Parameters
    ----------
    innovations : sequence of ndarray
        Its innovations, (n, d) for each run.
    arl0_cycles : float
        Required mean number of healthy cycles between alarms, of all charts together.
    """
    if not arl0_cycles >= LEAST_ALARM_CYCLES:
        raise ValueError(f"arl0_cycles = {arl0_cycles!r}; expected at least {LEAST_ALARM_CYCLES:g}")
    random, pool = np.random.default_rng(seed), np.concatenate(list(innovations))
    curves, rarest = _curves(baseline, pool, SEQUENCES, random), list[Array]()
    for _ in range(REDRAWN):
        again, own = _redrawn(baseline, pool, random)
        known = _curves(again, own, REDRAWN_SEQUENCES, random)
        for _ in range(JUDGED_SEQUENCES):
            seen = zip(known, _maxima(again, _drawn(baseline, pool, SEQUENCE_CYCLES, random)).T, strict=True)
            rarest.append(np.max([-curve.log_rate(column) for curve, column in seen], axis=0))
    nominal = np.exp(-rate_curve(np.concatenate(rarest)).level(1.0 / arl0_cycles))
    nominal = float(np.clip(nominal, 1.0 / (MOST_CALIBRATED * arl0_cycles), 1.0 / arl0_cycles))
    alarm = Thresholds._make(curve.level(nominal) for curve in curves)
    quiet = Thresholds._make(map(min, alarm, (curve.level(1.0 / CLEAR_CYCLES) for curve in curves)))
    return ChartLimits(alarm, quiet, float(arl0_cycles), baseline.cycles < 3.0 * arl0_cycles)


def _curves(baseline: Baseline, pool: Array, sequences: int, random: np.random.Generator) -> list[RateCurve]:
    """Return the nominal rate curve of each chart, each sequence evaluated with a refitted baseline."""
    found = [
        _maxima(_redrawn(baseline, pool, random)[0], _drawn(baseline, pool, SEQUENCE_CYCLES, random))
        for _ in range(sequences)
    ]
    return [rate_curve(column) for column in np.concatenate(found).T]


def _redrawn(baseline: Baseline, pool: Array, random: np.random.Generator) -> tuple[Baseline, Array]:
    """Return a baseline fitted to a draw as long as the pool, and its innovations."""
    rows = _drawn(baseline, pool, min(len(pool), LONGEST_REDRAWN), random)
    again, (own,) = baseline_of_runs(baseline.names, [rows], baseline.period_s)
    return again, own


def _drawn(baseline: Baseline, pool: Array, cycles: int, random: np.random.Generator) -> Array:
    """Return the features (n, d) of n = ``cycles`` + `LARGEST_ORDER` drawn healthy cycles, after settling.

    The innovations are blocks of consecutive rows of the pool, which wraps around; normal values if the pool is short.
    """
    count = cycles + LARGEST_ORDER + SETTLING
    if len(pool) < GAUSSIAN_BELOW:
        shocks = random.standard_normal((count, len(baseline.mean))) @ cholesky(baseline.covariance)
    else:
        length = min(max(SHORTEST_BLOCK, min(MOVING_BLOCK, len(pool) // LEAST_BLOCKS)), len(pool))
        starts = random.integers(0, len(pool), -(-count // length))
        shocks = pool[(starts[:, None] + np.arange(length)).ravel()[:count] % len(pool)]
    return np.asarray(baseline.features(shocks)[SETTLING:])


def _maxima(judge: Baseline, rows: Array) -> Array:
    """Return the largest value of each chart in each block, shape (blocks, 3), evaluated with this baseline."""
    left = judge.innovations(rows)[-SEQUENCE_CYCLES:]
    charts = chart_rows(left / judge.sigma, judge.whitened(left), ALLOWANCE, WINDOW)
    return np.asarray(charts.reshape(-1, BLOCK_CYCLES, len(CHARTS)).max(axis=1))
