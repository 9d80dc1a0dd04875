# SPDX-License-Identifier: Apache-2.0
"""Intervals hold what they promise where the answer is known in closed form, and say where a fit had not ended."""

from __future__ import annotations

import numpy as np
import pytest

from mech_twin.studies.identification.intervals import HELD_OFF, Linearised, last_step, moved_by_held, uncertainty

ROWS, BLOCKS, REPEATS = 600, 30, 200
TIMES = np.linspace(0.0, 1.0, ROWS)
COLUMNS = np.column_stack([np.sin(75.0 * TIMES), np.cos(75.0 * TIMES), np.ones(ROWS), TIMES, np.sin(200.0 * TIMES)])


def line_of(residuals: np.ndarray, columns: np.ndarray = COLUMNS) -> Linearised:
    labels = np.minimum((BLOCKS * TIMES).astype(np.int64), BLOCKS - 1)
    return Linearised(columns, columns, residuals, labels, np.zeros(ROWS, dtype=np.int64))


@pytest.mark.parametrize("memory", [0.0, 0.8], ids=["white", "correlated"])
def test_nineteen_of_twenty_intervals_hold_the_truth(memory: float) -> None:
    """The truth of every unknown is 0; noise of a memory of 0.8 makes least squares hold it half of the times."""
    random = np.random.default_rng(7)
    held = plainly = 0
    for _ in range(REPEATS):
        noise = random.standard_normal(ROWS)
        for i in range(1, ROWS):
            noise[i] += memory * noise[i - 1]
        estimate, *_ = np.linalg.lstsq(COLUMNS, noise, rcond=None)
        found = uncertainty(line_of(noise - COLUMNS @ estimate))
        held += int(np.sum(np.abs(estimate) <= found.half_widths[1]))
        plain = np.sqrt(np.diag(np.linalg.inv(COLUMNS.T @ COLUMNS))) * np.std(noise - COLUMNS @ estimate)
        plainly += int(np.sum(np.abs(estimate) <= 1.96 * plain))
    asked = REPEATS * COLUMNS.shape[1]
    assert 0.92 <= held / asked <= 0.98
    assert (plainly / asked < 0.7) == (memory > 0.0)


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
    moved, *_ = np.linalg.lstsq(COLUMNS, HELD_OFF * held, rcond=None)
    found = moved_by_held(line_of(np.zeros(ROWS)), held[:, None])
    np.testing.assert_allclose(found, np.abs(moved), rtol=1e-9)
    assert found[0] > 0.2
    assert found[1] < 0.01
