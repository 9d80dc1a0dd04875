# SPDX-License-Identifier: Apache-2.0
"""Thresholds from one stated mean time between false alarms (ARL0) over all charts together.

The charts run over long sequences drawn from the healthy innovations (moving blocks, several times as long as the
charts look back, so that what the prewhitening left of the dependence stays in), each judged by a baseline fitted anew
to a draw of the baseline's own length - mean, autoregression and covariance.  With M the largest value in a block of B
cycles, the rate of alarms of a chart at a threshold h is nominally r(h) = -ln P(M <= h)/B. Beyond what the draws show,
ln r goes on in a straight line.  Charts share the rate evenly.

Nominally, since the baseline has seen the cycles that the draws are made of: its mean, autoregression and covariance
fit them better than any others, and their largest values are single events.  On independent normal values, 19 features
and 10 000 cycles, alarms came 1.1 times as often as stated.  So the nominal rate is calibrated: baselines of the same
length are drawn from the innovations, each makes curves of its own and judges further draws of what it was drawn from.
How often these fall below which nominal rate, on any chart, is the rate that is stated.

Sources: KunschBootstrap1989 (moving blocks), BeranPrepivoting1987 (calibration by a second bootstrap),
JensenEstimated2006 (estimated parameters).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cholesky

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import LARGEST_ORDER, Baseline, baseline_of_runs
from mech_twin.studies.monitoring.charts import ALLOWANCE, CHARTS, WINDOW, chart_rows

SEQUENCES, SEQUENCE_CYCLES = 40, 10_000
REDRAWN, REDRAWN_SEQUENCES, JUDGED_SEQUENCES = 16, 16, 4  # baselines drawn anew, sequences for and before each of them
MOST_CALIBRATED = 1000.0  # of few cycles, or of features without noise, baselines drawn anew are no likeness
BLOCK_CYCLES = 250  # over which the largest value is taken
MOVING_BLOCK = 4 * WINDOW  # cycles that are drawn together: a joint within the window hides what is slower than a block
SHORTEST_BLOCK, LEAST_BLOCKS = 20, 20  # of a short baseline, which needs blocks enough to draw from
SETTLING = 500  # cycles of a draw that are left out: it begins at the mean
LONGEST_REDRAWN = 20_000  # cycles of a baseline beyond which its estimation errors are left out
GAUSSIAN_BELOW = 200  # cycles: a shorter baseline cannot show its own tails
CLEAR_CYCLES = 50.0  # mean run length of the level below which a chart counts as quiet
LEAST_OVER = 10  # blocks over a level, for its rate to count as measured
LEAST_ALARM_CYCLES = 3.0


@dataclass(frozen=True)
class ChartLimits:
    """Where the charts give alarm, and below what they count as quiet, in the order of `CHARTS`.

    ``arl0_cycles`` is the stated mean number of healthy cycles between alarms of any chart; ``extrapolated`` says that
    the baseline is shorter than three of them.
    """

    alarm: tuple[float, ...]
    quiet: tuple[float, ...]
    arl0_cycles: float
    extrapolated: bool

    def record(self) -> dict[str, Any]:
        """Return the limits as JSON values."""
        return {
            "alarm": dict(zip(CHARTS, self.alarm, strict=True)),
            "quiet": dict(zip(CHARTS, self.quiet, strict=True)),
            "arl0_cycles": self.arl0_cycles,
            "extrapolated": self.extrapolated,
        }


def limits_of_record(record: Mapping[str, Any]) -> ChartLimits:
    """Return the limits of their record."""
    alarm, quiet = ([float(record[key][chart]) for chart in CHARTS] for key in ("alarm", "quiet"))
    return ChartLimits(tuple(alarm), tuple(quiet), float(record["arl0_cycles"]), bool(record["extrapolated"]))


def chart_limits(baseline: Baseline, innovations: Sequence[Array], arl0_cycles: float, seed: int = 0) -> ChartLimits:
    """Return the thresholds of a baseline.

    Parameters
    ----------
    baseline : Baseline
        The reference.
    innovations : sequence of ndarray
        Its innovations, (n, d) a run.
    arl0_cycles : float
        Stated mean number of healthy cycles between alarms, of all charts together.
    seed : int
        Of the draws.
    """
    if not arl0_cycles >= LEAST_ALARM_CYCLES:
        raise ValueError(f"arl0_cycles = {arl0_cycles!r}; expected at least {LEAST_ALARM_CYCLES:g}")
    random, pool = np.random.default_rng(seed), np.concatenate(list(innovations))
    curves = _curves(baseline, pool, SEQUENCES, random)
    rarity = _calibration(baseline, pool, curves, random).level(1.0 / arl0_cycles)
    nominal = np.clip(np.exp(-rarity), 1.0 / (MOST_CALIBRATED * arl0_cycles), 1.0 / arl0_cycles)
    alarm = tuple(curve.level(float(nominal)) for curve in curves)
    quiet = tuple(min(curve.level(1.0 / CLEAR_CYCLES), level) for curve, level in zip(curves, alarm, strict=True))
    return ChartLimits(alarm, quiet, float(arl0_cycles), baseline.cycles < 3.0 * arl0_cycles)


def _calibration(
    baseline: Baseline, pool: Array, curves: Sequence[RateCurve], random: np.random.Generator
) -> RateCurve:
    """Return the rate of blocks over how rare they are nominally, -ln r, by baselines that were drawn anew."""
    if len(pool) > LONGEST_REDRAWN:
        judged = [_maxima(baseline, _drawn_features(baseline, pool, SEQUENCE_CYCLES, random)) for _ in range(SEQUENCES)]
        return RateCurve(np.sort(_rarity(curves, np.concatenate(judged))))
    found = []
    for _ in range(REDRAWN):
        again, own = _redrawn(baseline, pool, random)
        known = _curves(again, own, REDRAWN_SEQUENCES, random)
        judged = [_drawn_features(baseline, pool, SEQUENCE_CYCLES, random) for _ in range(JUDGED_SEQUENCES)]
        found += [_rarity(known, _maxima(again, rows)) for rows in judged]
    return RateCurve(np.sort(np.concatenate(found)))


def _curves(baseline: Baseline, pool: Array, sequences: int, random: np.random.Generator) -> list[RateCurve]:
    """Return the nominal rate of each chart over its threshold, each sequence judged by a baseline fitted anew."""
    found = []
    for _ in range(sequences):
        judge = baseline if len(pool) > LONGEST_REDRAWN else _redrawn(baseline, pool, random)[0]
        found.append(_maxima(judge, _drawn_features(baseline, pool, SEQUENCE_CYCLES, random)))
    return [RateCurve(np.sort(column)) for column in np.concatenate(found).T]


def _redrawn(baseline: Baseline, pool: Array, random: np.random.Generator) -> tuple[Baseline, Array]:
    """Return a baseline of a draw as long as the pool, and its innovations."""
    rows = _drawn_features(baseline, pool, len(pool), random)
    again, (own,) = baseline_of_runs(baseline.names, [rows], baseline.period_s)
    return again, own


def _drawn_features(baseline: Baseline, pool: Array, cycles: int, random: np.random.Generator) -> Array:
    """Return features of drawn healthy cycles, settled: so many, and as many before as an autoregression looks back."""
    drawn = cycles + LARGEST_ORDER + SETTLING
    if len(pool) < GAUSSIAN_BELOW:
        factor = cholesky(baseline.covariance, lower=True)
        shocks = random.standard_normal((drawn, len(factor))) @ factor.T
    else:
        shocks = _moving_blocks(pool, drawn, random)
    return np.asarray(baseline.features(shocks)[SETTLING:])


def _maxima(judge: Baseline, rows: Array) -> Array:
    """Return the largest value of each chart in blocks of cycles, shape (blocks, 3), as this baseline judges them."""
    left = judge.innovations(rows)[-SEQUENCE_CYCLES:]
    charts = chart_rows(left / judge.sigma, judge.whitened(left), ALLOWANCE, WINDOW)
    return np.asarray(charts.reshape(-1, BLOCK_CYCLES, len(CHARTS)).max(axis=1))


def _rarity(curves: Sequence[RateCurve], maxima: Array) -> Array:
    """Return how rare the rarest chart of each block is, -ln r."""
    rates = [curve.log_rate(column) for curve, column in zip(curves, maxima.T, strict=True)]
    return np.asarray(-np.min(rates, axis=0))


@dataclass(frozen=True)
class RateCurve:
    """Rate of alarms over the threshold, from the ordered largest values of blocks."""

    ordered: Array

    def _measured(self) -> tuple[Array, Array]:
        """Return levels and ln r at them, where at least `LEAST_OVER` blocks lie over."""
        count = len(self.ordered)
        over = np.arange(count - 1, LEAST_OVER - 1, -1)
        levels = self.ordered[: len(over)]
        return levels, np.log(-np.log1p(-over / count) / BLOCK_CYCLES)

    def _line(self) -> tuple[float, float]:
        """Return slope and offset of ln r over the level, from the upper half of the blocks."""
        levels, rates = self._measured()
        upper = slice(len(levels) // 2, None)
        slope, offset = np.polyfit(levels[upper], rates[upper], 1)
        return float(slope), float(offset)

    def level(self, rate: float) -> float:
        """Return the threshold at which alarms come at this rate (per cycle)."""
        levels, rates = self._measured()
        wanted = float(np.log(rate))
        if wanted >= rates[-1]:
            return float(np.interp(-wanted, -rates, levels))
        slope, offset = self._line()
        return max((wanted - offset) / slope, float(levels[-1]))

    def log_rate(self, values: Array) -> Array:
        """Return ln r at these levels."""
        levels, rates = self._measured()
        slope, offset = self._line()
        inside = np.interp(values, levels, rates)
        return np.asarray(np.where(values > levels[-1], np.minimum(offset + slope * values, rates[-1]), inside))


def _moving_blocks(pool: Array, cycles: int, random: np.random.Generator) -> Array:
    """Return cycles drawn from the pool in blocks of consecutive ones, the pool closed to a ring."""
    length = min(max(SHORTEST_BLOCK, min(MOVING_BLOCK, len(pool) // LEAST_BLOCKS)), len(pool))
    starts = random.integers(0, len(pool), -(-cycles // length))
    places = (starts[:, None] + np.arange(length)).ravel()[:cycles] % len(pool)
    return np.asarray(pool[places])
