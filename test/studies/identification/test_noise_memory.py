# SPDX-License-Identifier: Apache-2.0
"""The memory that an autoregression finds in residuals, and what follows from it for a fit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz

from mech_twin.studies.burg import BurgOrder
from mech_twin.studies.identification.intervals import FEWEST, autoregression, correlations, remembered_noise


def series(coefficients: tuple[float, ...], count: int, seed: int) -> np.ndarray:
    """Return an autoregressive series in its steady state."""
    random, order, before = np.random.default_rng(seed), len(coefficients), 500
    found = random.standard_normal(before + count)
    for i in range(order, before + count):
        found[i] += sum(c * found[i - 1 - k] for k, c in enumerate(coefficients))
    return found[before:]


@pytest.mark.parametrize("coefficients", [(0.8,), (0.9, -0.5), (0.4, 0.1, 0.2)])
def test_correlations_go_on_by_their_recursion(coefficients: tuple[float, ...]) -> None:
    order = len(coefficients)
    lags = np.arange(1, order + 1)
    # Yule and Walker: rho_h = sum_i a_i rho_|h - i| for h = 1 to p
    system = np.zeros((order, order))
    right = np.zeros(order)
    for row, h in enumerate(lags):
        for i, a in zip(lags, coefficients, strict=True):
            if h == i:
                right[row] += a
            else:
                system[row, abs(h - i) - 1] += a
    first = np.concatenate([[1.0], np.linalg.solve(np.eye(order) - system, right)])
    found = correlations(BurgOrder(np.array(coefficients)[:, None], first[:, None], np.ones(1)), 40)
    expected = first.tolist()
    for h in range(order + 1, 40):
        expected.append(sum(a * expected[h - i] for i, a in zip(lags, coefficients, strict=True)))
    np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize("coefficients", [(0.8,), (0.9, -0.5)])
def test_the_correlations_of_a_long_series_are_found(coefficients: tuple[float, ...]) -> None:
    shown = series(coefficients, 40_000, 3)
    counted = [float(shown[h:] @ shown[: len(shown) - h]) / float(shown @ shown) for h in range(12)]
    np.testing.assert_allclose(correlations(autoregression(shown), 12), counted, atol=0.02)


def test_the_memory_of_short_series_is_right_in_the_mean() -> None:
    """Uncorrected it is 0.02 too small at 150 samples, which is a tenth of the variance of their mean."""
    found = [autoregression(series((0.8,), 150, seed)) for seed in range(300)]
    first = [float(each.correlations[1, 0]) for each in found if len(each.coefficients) == 1]
    assert len(first) > 250
    assert np.mean(first) == pytest.approx(0.8, abs=0.012)


def test_white_noise_mostly_has_no_memory() -> None:
    orders = [len(autoregression(series((), 300, seed)).coefficients) for seed in range(100)]
    assert orders.count(0) >= 90


@pytest.mark.parametrize("residuals", [np.zeros(100), np.ones(FEWEST - 1), np.ones(FEWEST)])
def test_what_tells_no_memory_has_none(residuals: np.ndarray) -> None:
    assert len(autoregression(residuals).coefficients) == 0
    np.testing.assert_array_equal(correlations(autoregression(residuals), 3), [1.0, 0.0, 0.0])


@pytest.mark.parametrize("coefficients", [(), (0.8,)])
def test_no_more_correlations_are_told_than_asked_for(coefficients: tuple[float, ...]) -> None:
    """A channel of events may have a single one."""
    found = autoregression(series(coefficients, 400, 3))
    for count in (1, 2):
        np.testing.assert_array_equal(correlations(found, count), correlations(found, 9)[:count])


def test_the_middle_is_that_of_the_whole_matrix_of_correlations_and_a_prior_counts_with_its_own_variance() -> None:
    random, sizes = np.random.default_rng(5), (80, 130)
    channels = np.repeat([0, 1, -1], [*sizes, 2])
    jacobian = random.standard_normal((len(channels), 3))
    residuals = np.concatenate([*(series((0.7,), rows, rows) for rows in sizes), [5.0, 0.0]])
    expected = jacobian[-2:].T @ jacobian[-2:]
    for channel in (0, 1):
        own, shown = jacobian[channels == channel], residuals[channels == channel]
        expected += np.mean(shown**2) * own.T @ toeplitz(correlations(autoregression(shown), len(shown))) @ own
    np.testing.assert_allclose(remembered_noise(jacobian, residuals, channels)[0], expected, rtol=1e-10)


def test_a_memory_leaves_as_many_samples_as_a_mean_of_them_is_worth() -> None:
    """The mean of n samples of a memory a has the variance of n (1 - a)/(1 + a) independent ones."""
    _, samples = remembered_noise(np.ones((5000, 1)), series((0.8,), 5000, 9), np.zeros(5000, dtype=np.int64))
    assert samples == pytest.approx(5000 * 0.2 / 1.8, rel=0.15)
