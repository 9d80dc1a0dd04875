# SPDX-License-Identifier: Apache-2.0
"""Thresholds from one stated mean time between false alarms (ARL0) over all charts together.

The charts run over long sequences drawn from the healthy innovations (moving blocks, several times as long as the
charts look back, so that what the prewhitening left of the dependence stays in), each judged by a baseline fitted anew
to a draw of the baseline's own length - mean, autoregression and covariance: a short baseline makes wider thresholds.
With M the largest value in a block of B cycles, the rate of alarms at a threshold h is r(h) = -ln P(M <= h)/B; beyond
what the draws show, ln r goes on in a straight line.  Charts share the rate evenly; what they have in common is taken
out by counting blocks in which any of them is over.

Sources: KunschBootstrap1989 (moving blocks), JensenEstimated2006 (estimated parameters).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cholesky

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import Baseline, baseline_of_runs
from mech_twin.studies.monitoring.charts import ALLOWANCE, CHARTS, WINDOW, chart_rows

SEQUENCES, SEQUENCE_CYCLES = 40, 10_000
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
    maxima = healthy_maxima(baseline, innovations, np.random.default_rng(seed))
    curves = [RateCurve(np.sort(column)) for column in maxima.T]
    common = _charts_counted(maxima, curves, 1.0 / arl0_cycles)
    alarm = tuple(curve.level(1.0 / (arl0_cycles * common)) for curve in curves)
    quiet = tuple(min(curve.level(1.0 / CLEAR_CYCLES), level) for curve, level in zip(curves, alarm, strict=True))
    return ChartLimits(alarm, quiet, float(arl0_cycles), baseline.cycles < 3.0 * arl0_cycles)


def healthy_maxima(baseline: Baseline, innovations: Sequence[Array], random: np.random.Generator) -> Array:
    """Return the largest value of each chart in blocks of drawn healthy cycles, shape (blocks, 3)."""
    pool = np.concatenate(list(innovations))
    factor = cholesky(baseline.covariance, lower=True)

    def drawn(cycles: int) -> Array:
        """Return features of so many healthy cycles, settled."""
        if len(pool) < GAUSSIAN_BELOW:
            shocks = random.standard_normal((cycles + SETTLING, len(factor))) @ factor.T
        else:
            shocks = _moving_blocks(pool, cycles + SETTLING, random)
        return baseline.features(shocks)[SETTLING:]

    found = []
    for _ in range(SEQUENCES):
        again = baseline
        if len(pool) <= LONGEST_REDRAWN:
            again, _ = baseline_of_runs(baseline.names, [drawn(len(pool) + baseline.order)], baseline.period_s)
        left = again.innovations(drawn(SEQUENCE_CYCLES + again.order))
        rows = chart_rows(left / again.sigma, again.whitened(left), ALLOWANCE, WINDOW)
        found.append(rows.reshape(-1, BLOCK_CYCLES, len(CHARTS)).max(axis=1))
    return np.concatenate(found)


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


def _charts_counted(maxima: Array, curves: Sequence[RateCurve], rate: float) -> float:
    """Return how many independent charts these are worth: rate of any of them over the rate of each, 1 to 3."""
    rarest = np.min([curve.log_rate(column) for curve, column in zip(curves, maxima.T, strict=True)], axis=0)
    ordered = np.sort(rarest)
    wanted = max(float(np.log(rate)), float(ordered[2 * LEAST_OVER]))
    share = float(np.mean(rarest <= wanted))
    together = -np.log1p(-min(share, 0.999)) / BLOCK_CYCLES
    return float(np.clip(together / np.exp(wanted), 1.0, len(CHARTS)))


def _moving_blocks(pool: Array, cycles: int, random: np.random.Generator) -> Array:
    """Return cycles drawn from the pool in blocks of consecutive ones, the pool closed to a ring."""
    length = min(max(SHORTEST_BLOCK, min(MOVING_BLOCK, len(pool) // LEAST_BLOCKS)), len(pool))
    starts = random.integers(0, len(pool), -(-cycles // length))
    places = (starts[:, None] + np.arange(length)).ravel()[:cycles] % len(pool)
    return np.asarray(pool[places])
