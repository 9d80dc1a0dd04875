# SPDX-License-Identifier: Apache-2.0
"""Coloured noise: standard errors of a fit from an autoregression of each channel's residuals.

A sensor's own filter, or an unmodelled motion, correlates neighbouring residuals.  In a short run blocks are too short
to show that; an autoregression needs few numbers.  It is Burg's (BurgSpectrum1967), its order that of the least
Bayesian information criterion (SchwarzDimension1978).  First order is corrected for the bias of a short series,
(1 + 3 a)/n (KendallBias1954).  It gives the middle of the sandwich::

    C = H^-1 (sum over channels of s^2 J' R J) H^-1,    H = J' J

with R the correlations of the autoregression at every distance, and s^2 the variance of the channel's residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import matmul_toeplitz
from scipy.signal import lfilter, lfiltic

from mech_twin.measurements.blocks import Array
from mech_twin.studies.burg import burg_orders

MOST_ORDER = 4
LONGEST = 0.995  # of the correlation of neighbours, corrected
LEAST_LEFT = 1e-8  # of the variance: residuals that repeat themselves exactly are no noise
FEWEST = 20  # residuals of a channel; fewer tell no memory


@dataclass(frozen=True)
class Autoregression:
    """An autoregression of order p.

    Attributes
    ----------
    coefficients : ndarray
        Shape (p,): x_t = sum_i coefficients[i - 1] x_(t-i) + innovation.
    first : ndarray
        Shape (p + 1,): correlations at distances 0 to p.
    """

    coefficients: Array
    first: Array

    def correlations(self, count: int) -> Array:
        """Return the correlations at distances 0 to ``count`` - 1."""
        order = len(self.coefficients)
        if order == 0 or count <= order + 1:
            found = np.zeros(count)
            found[: order + 1] = self.first[:count]
            return found
        poles = np.concatenate([[1.0], -self.coefficients])
        state = lfiltic([1.0], poles, self.first[:0:-1])
        rest, _ = lfilter([1.0], poles, np.zeros(count - order - 1), zi=state)
        return np.concatenate([self.first, rest])


def autoregression(residuals: Array) -> Autoregression:
    """Return the autoregression of residuals in the order of their times, by Burg's recursion; of few, order 0."""
    best = Autoregression(np.zeros(0), np.ones(1))
    count, power = len(residuals), float(residuals @ residuals)
    if count < FEWEST or power == 0.0:
        return best
    least = 0.0
    for found in burg_orders([residuals[:, None]], MOST_ORDER):
        share, order = float(found.left[0]), len(found.coefficients)
        if share < LEAST_LEFT:
            break
        criterion = count * np.log(share) + order * np.log(count)
        if criterion < least:
            best, least = Autoregression(found.coefficients[:, 0], found.correlations[:, 0]), criterion
    return _corrected(best, count) if len(best.coefficients) == 1 else best


def _corrected(found: Autoregression, count: int) -> Autoregression:
    """Return a first-order autoregression corrected for its mean bias with this many samples."""
    near = float(found.coefficients[0])
    if near <= 0.0:
        return found
    near = max(near, min(near + (1.0 + 3.0 * near) / count, LONGEST))
    return Autoregression(np.array([near]), np.array([1.0, near]))


@dataclass(frozen=True)
class RememberedNoise:
    """The middle of the sandwich, shape (unknowns, unknowns), and how many independent samples the rows are."""

    middle: Array
    samples: float


def remembered_noise(jacobian: Array, residuals: Array, channels: npt.NDArray[np.int64]) -> RememberedNoise:
    """Return the middle of the sandwich for channels with correlated residuals.

    Parameters
    ----------
    jacobian : ndarray
        Shape (rows, unknowns).
    residuals : ndarray
        Shape (rows,): in standard deviations.
    channels : ndarray
        Shape (rows,): channel of each row, in the order of their times; -1 of a prior, which has its own standard
        deviation and no memory.
    """
    priors = jacobian[channels < 0]
    middle, samples = priors.T @ priors, float(len(priors))
    for channel in np.unique(channels[channels >= 0]):
        rows = channels == channel
        own, shown = jacobian[rows], residuals[rows]
        count = len(shown)
        correlations = autoregression(shown).correlations(count)
        middle = middle + float(shown @ shown) / count * (own.T @ matmul_toeplitz(correlations, own))
        alike = 1.0 + 2.0 * float((1.0 - np.arange(1, count) / count) @ correlations[1:])
        samples += count / max(alike, 1.0)
    return RememberedNoise(middle, samples)
