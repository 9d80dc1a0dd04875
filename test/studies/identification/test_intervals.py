# SPDX-License-Identifier: Apache-2.0
"""Intervals hold what they promise where the answer is known in closed form, and say where a fit had not ended."""

from __future__ import annotations

import numpy as np
import pytest

from mech_twin.studies.identification.intervals import FIXED_OFF, Linearised, last_step, moved_by_fixed, uncertainty

ROWS, BLOCKS, REPEATS = 600, 30, 200
TIMES = np.linspace(0.0, 1.0, ROWS)
COLUMNS = np.column_stack([np.sin(75.0 * TIMES), np.cos(75.0 * TIMES), np.ones(ROWS), TIMES, np.sin(200.0 * TIMES)])
SLOW = [2, 3]  # of the columns: a zero and a trend


def line_of(residuals: np.ndarray, columns: np.ndarray = COLUMNS) -> Linearised:
    rows = len(residuals)
    labels = BLOCKS * np.arange(rows) // rows
    one = np.zeros(rows, dtype=np.int64)
    return Linearised(columns, columns, residuals, labels, one, one)


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 4], ids=["long", "short"])
@pytest.mark.parametrize("memory", [0.0, 0.8], ids=["white", "correlated"])
def test_nineteen_of_twenty_intervals_hold_the_truth(memory: float, every: int) -> None:
    """The truth of every unknown is 0; noise of a memory of 0.8 makes least squares hold it half of the times.

    A block of the short run has five samples: too few to show such a memory, which is most of the noise in what is
    slow (zero and trend) and little of it in what is fast, where least squares alone says more than there is.
    """
    random, columns = np.random.default_rng(7), COLUMNS[::every]
    held, plainly = np.zeros(columns.shape[1]), np.zeros(columns.shape[1])
    for _ in range(REPEATS):
        noise = random.standard_normal(len(columns))
        for i in range(1, len(columns)):
            noise[i] += memory * noise[i - 1]
        estimate, *_ = np.linalg.lstsq(columns, noise, rcond=None)
        found = uncertainty(line_of(noise - columns @ estimate, columns))
        held += np.abs(estimate) <= found.half_widths[1]
        plain = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns))) * np.std(noise - columns @ estimate)
        plainly += np.abs(estimate) <= 1.96 * plain
    assert np.all(held >= 0.9 * REPEATS)  # four standard deviations of 200 repeats below 95 %
    judged = held[SLOW] if memory > 0.0 and every > 1 else held
    assert 0.92 <= judged.mean() / REPEATS <= 0.98
    assert (plainly[SLOW].mean() < 0.7 * REPEATS) == (memory > 0.0)
    assert every > 1 or (plainly.mean() < 0.7 * REPEATS) == (memory > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.8], ids=["white", "correlated"])
def test_an_unknown_that_one_block_tells_has_an_interval_of_the_size_of_its_error(memory: float) -> None:
    """As a restitution is told by the few bounces of a run, and by a weak trace of them elsewhere."""
    random = np.random.default_rng(11)
    columns = COLUMNS.copy()
    columns[:, 4] = 1e-3 * np.sin(200.0 * TIMES)
    columns[200:220, 4] = np.sin(np.arange(20.0))
    estimates, halves = [], []
    for _ in range(REPEATS):
        noise = random.standard_normal(ROWS)
        for i in range(1, ROWS):
            noise[i] += memory * noise[i - 1]
        estimate, *_ = np.linalg.lstsq(columns, noise, rcond=None)
        estimates.append(estimate[4])
        halves.append(uncertainty(line_of(noise - columns @ estimate, columns)).half_widths[1, 4])
    assert np.mean(np.abs(estimates) <= halves) >= 0.9
    assert np.max(halves) < 6.0 * np.std(estimates)


def test_a_fit_that_stopped_early_has_the_rest_of_its_way_as_last_step() -> None:
    random = np.random.default_rng(3)
    away = np.array([0.3, -0.2, 0.0, 1.5, -0.4])
    noise = random.standard_normal(ROWS)
    least, *_ = np.linalg.lstsq(COLUMNS, noise, rcond=None)
    noise -= COLUMNS @ least
    np.testing.assert_allclose(last_step(line_of(noise + COLUMNS @ away)), -away, atol=1e-12)


def test_a_held_key_moves_the_others_as_a_fit_with_it_off_would() -> None:
    random = np.random.default_rng(5)
    held = COLUMNS @ np.array([0.5, 0.0, 0.0, -1.0, 0.0]) + 0.01 * random.standard_normal(ROWS)
    moved, *_ = np.linalg.lstsq(COLUMNS, FIXED_OFF * held, rcond=None)
    found = moved_by_fixed(line_of(np.zeros(ROWS)), held[:, None])
    np.testing.assert_allclose(found, np.abs(moved), rtol=1e-9)
    assert found[0] > 0.2
    assert found[1] < 0.01
