# SPDX-License-Identifier: Apache-2.0
"""Run lengths of control charts against published tables.

Two-sided CUSUM, k = 0.5: LucasCusum1982, reprinted in MontgomeryQuality2013, with the approximation of
SiegmundSequential1985.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from mech_twin.studies.monitoring.charts import (
    ALLOWANCE,
    BLOCK_CYCLES,
    advance_cusum,
    chart_rows,
    rate_curve,
    siegmund_run_length,
)

PUBLISHED = {  # threshold: {shift of the mean in standard deviations: mean run length}
    4.0: {0.0: 168.0, 0.25: 74.2, 0.5: 26.6, 0.75: 13.3, 1.0: 8.38, 1.5: 4.75, 2.0: 3.34, 3.0: 2.19},
    5.0: {0.0: 465.0, 0.25: 139.0, 0.5: 38.0, 0.75: 17.0, 1.0: 10.4, 1.5: 5.75, 2.0: 4.01, 3.0: 2.57},
}
CASES = [(threshold, shift, length) for threshold, row in PUBLISHED.items() for shift, length in row.items()]
CHARTS = 4000


def run_lengths(threshold: float, shift: float, seed: int) -> np.ndarray:
    """Return when each of many independent charts first goes over the threshold."""
    random = np.random.default_rng(seed)
    up, down, found = np.zeros(CHARTS), np.zeros(CHARTS), np.zeros(CHARTS)
    cycle = 0
    while (found == 0.0).any():
        cycle += 1
        advance_cusum(random.standard_normal(CHARTS) + shift, ALLOWANCE, 1e300, up, down)
        found[(found == 0.0) & (np.maximum(up, down) > threshold)] = cycle
    return found


@pytest.mark.parametrize(("threshold", "shift", "length"), CASES)
def test_cusum_has_the_published_mean_run_length(threshold: float, shift: float, length: float) -> None:
    found = run_lengths(threshold, shift, 7)
    error = found.std() / math.sqrt(CHARTS)
    assert found.mean() == pytest.approx(length, abs=4.0 * error + 0.005 * length)


@pytest.mark.parametrize(("threshold", "shift", "length"), [case for case in CASES if case[1] <= 1.5])
def test_siegmund_is_near_the_published_run_length(threshold: float, shift: float, length: float) -> None:
    # the excess over the boundary, 1.166, is that of small drifts: at three deviations it is 10 % off
    assert siegmund_run_length(threshold, ALLOWANCE, shift) == pytest.approx(length, rel=0.04)


def test_threshold_of_the_chi_square_chart_is_that_of_the_distribution() -> None:
    width, run_length = 6, 2000.0
    values = np.random.default_rng(3).standard_normal((400_000, width))
    rows = chart_rows(values, values, ALLOWANCE, 5)
    curve = rate_curve(rows[:, 2].reshape(-1, BLOCK_CYCLES).max(axis=1))
    assert curve.level(1.0 / run_length) == pytest.approx(chi2.isf(1.0 / run_length, width), rel=0.02)
    assert curve.level(1.0 / 1e6) == pytest.approx(chi2.isf(1e-6, width), rel=0.06)  # beyond what was drawn
