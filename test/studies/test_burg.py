# SPDX-License-Identifier: Apache-2.0
"""Autoregressions of runs, by Burg's recursion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from mech_twin.studies.burg import burg_orders

TRUE = np.array([0.5, 0.2])


def remembering(cycles: int, width: int, random: np.random.Generator) -> np.ndarray:
    settled = lfilter([1.0], np.concatenate([[1.0], -TRUE]), random.standard_normal((cycles + 60, width)), axis=0)
    return np.asarray(settled[60:])


@pytest.mark.parametrize("length", [9, 12, 40, 165, 5000])
def test_short_runs_tell_the_same_memory_as_a_long_one(length: int) -> None:
    """Sums of products over all cycles, not the pairs that a run has, would give 0.70 - 1.6/length."""
    random, width = np.random.default_rng(length), 20
    runs = [remembering(length, width, random) for _ in range(40_000 // length)]
    orders = list(burg_orders(runs, 3))
    np.testing.assert_allclose(orders[2].coefficients.mean(axis=1), TRUE, atol=0.008)
    np.testing.assert_allclose(orders[3].coefficients.mean(axis=1), [*TRUE, 0.0], atol=0.008)
    true_left = 1.0 - (TRUE * orders[2].correlations.mean(axis=1)[1:]).sum()
    assert orders[2].left.mean() == pytest.approx(true_left, rel=0.01)


def test_the_first_order_leaves_the_least_forwards_and_backwards() -> None:
    runs = [np.random.default_rng(length).standard_normal((length, 1)).cumsum(axis=0) for length in (7, 12, 30)]

    def left(k: float) -> float:
        return sum(float(((run[1:] - k * run[:-1]) ** 2 + (run[:-1] - k * run[1:]) ** 2).sum()) for run in runs)

    found = list(burg_orders(runs, 1))[1].coefficients[0, 0]
    assert found == pytest.approx(minimize_scalar(left, bounds=(-1.0, 1.0), method="bounded").x, abs=1e-5)


def runs_of(kind: str, seed: int, lengths: list[int]) -> list[np.ndarray]:
    """Return runs that no model of a few cycles fits: noise, drifts, values that come again, constants, zeros."""
    random = np.random.default_rng(seed)
    made = {
        "noise": lambda n: random.standard_normal((n, 2)),
        "drift": lambda n: random.standard_normal((n, 2)).cumsum(axis=0) * 1e8,
        "again": lambda n: np.outer(np.cos(np.pi * np.arange(n)), [1.0, 1e-8]),
        "swing": lambda n: np.outer(np.cos(0.3 * np.arange(n)), [1.0, 1e-8]),
        "constant": lambda n: np.outer(np.ones(n), [1.0, 3e-9]),
        "zero": lambda n: np.zeros((n, 2)),
    }
    return [made[kind](length) for length in lengths]


@given(
    st.sampled_from(["noise", "drift", "again", "swing", "constant", "zero"]),
    st.integers(0, 10**6),
    st.lists(st.integers(1, 20), min_size=1, max_size=5),
)
def test_every_order_is_stable(kind: str, seed: int, lengths: list[int]) -> None:
    for order in burg_orders(runs_of(kind, seed, lengths), 4):
        assert order.coefficients.shape == (len(order.correlations) - 1, 2)
        assert (order.left > 0.0).all() and (order.left <= 1.0).all()
        assert (np.abs(order.correlations) <= 1.0 + 1e-12).all()
        for own in order.coefficients.T:
            assert (np.abs(np.roots(np.concatenate([[1.0], -own]))) < 1.0).all()
