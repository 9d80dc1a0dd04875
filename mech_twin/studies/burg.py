# SPDX-License-Identifier: Apache-2.0
"""Autoregressions of short runs, by Burg's recursion (BurgSpectrum1967) with forward and backward prediction.

Each reflection coefficient uses only pairs of neighbours within a run::

    k = 2 sum f_t b_(t-1) / sum (f_t^2 + b_(t-1)^2),    f, b: prediction errors of the order before, both directions

Runs are not extended by zeros, and |k| < 1, so that every order is stable.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.kernel import kernel

Array = NDArray[Any]
LARGEST_REFLECTION = 1.0 - 1e-9  # bound; an exactly predictable series has 1
EXACT = 1e-14  # of the power of a series: less prediction error is rounding error


@dataclass(frozen=True)
class BurgOrder:
    """Autoregressions of order p of d series.

    Attributes
    ----------
    coefficients : ndarray
        Shape (p, d): x_t = sum_i coefficients[i - 1] x_(t-i) + innovation.
    correlations : ndarray
        Shape (p + 1, d): correlations at lags 0 to p.
    left : ndarray
        Shape (d,): variance of the innovations as a share of the variance, 1 at order 0.
    """

    coefficients: Array
    correlations: Array
    left: Array


def burg_orders(runs: Sequence[Array], largest: int) -> Iterator[BurgOrder]:
    """Yield the autoregressions of orders 0 to ``largest`` of zero-mean runs, shape (n, d) each, of d series.

    Order p uses the runs that are longer than p.  A series of zeros has coefficients of zero.
    """
    d = runs[0].shape[1]
    coefficients, correlations, left = np.zeros((0, d)), np.ones((1, d)), np.ones(d)
    pairs = [(np.array(run[1:], np.float64, order="C"), np.array(run[:-1], np.float64, order="C")) for run in runs]
    rounding = EXACT * sum(((run * run).sum(axis=0) for run in runs), start=np.zeros(d))
    yield BurgOrder(coefficients, correlations, left)
    for _ in range(largest):
        both, alike = np.zeros(d), np.zeros(d)
        for forward, backward in pairs:
            add_products(forward, backward, both, alike)
        some = both > rounding
        reflection = np.where(some, 2.0 * alike / np.where(some, both, 1.0), 0.0)
        reflection = reflection.clip(-LARGEST_REFLECTION, LARGEST_REFLECTION)
        next_one = (coefficients * correlations[:0:-1]).sum(axis=0) + reflection * left
        correlations = np.concatenate([correlations, [next_one]])
        coefficients = np.concatenate([coefficients - reflection * coefficients[::-1], [reflection]])
        left = left * (1.0 - reflection**2)
        yield BurgOrder(coefficients, correlations, left)
        for forward, backward in pairs:
            reflect(forward, backward, reflection)
        pairs = [(forward[1:], backward[:-1]) for forward, backward in pairs]


def best_order(runs: Sequence[Array], largest: int, least_left: float = 0.0) -> BurgOrder:
    """Return the order with the least Bayesian information criterion, summed over the series (SchwarzDimension1978).

    Orders that leave less than ``least_left`` of the variance of a series are not considered.
    """
    count, least = sum(map(len, runs)), np.inf
    for found in burg_orders(runs, largest):
        if found.left.min() < least_left:
            break
        criterion = count * float(np.log(found.left).sum()) + found.coefficients.size * log(count)
        if criterion < least:
            best, least = found, criterion
    return best


@kernel
def add_products(forward: Array, backward: Array, both: Array, alike: Array) -> None:
    """Add the sums over a run of f^2 + b^2 and of f b to ``both`` and ``alike``, shape (d,) each."""
    for t in range(len(forward)):
        for i in range(forward.shape[1]):
            f, b = forward[t, i], backward[t, i]
            both[i] += f * f + b * b
            alike[i] += f * b


@kernel
def reflect(forward: Array, backward: Array, reflection: Array) -> None:
    """Replace the prediction errors of a run, (n, d) forwards and backwards, by those of the next order."""
    for t in range(len(forward)):
        for i in range(forward.shape[1]):
            f, b = forward[t, i], backward[t, i]
            forward[t, i], backward[t, i] = f - reflection[i] * b, b - reflection[i] * f
