# SPDX-License-Identifier: Apache-2.0
"""Autocorrelated noise: standard errors of a fit from an autoregression of each channel's residuals.

A sensor's filter, or an unmodelled motion, correlates neighbouring residuals.  Blocks of a short run do not show that,
but an autoregression has few parameters.  It is fitted by Burg's recursion (BurgSpectrum1967), with the order of least
Bayesian information criterion (SchwarzDimension1978).  At first order, the bias (1 + 3 a)/n of a short series is
corrected (KendallBias1954).  It gives the sandwich estimate::

    C = H^-1 (sum over channels of s^2 J' R J) H^-1,    H = J' J

with R the correlation matrix of the autoregression, and s^2 the variance of the channel's residuals.
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
LONGEST = 0.995  # upper bound of the corrected first-order coefficient
LEAST_LEFT = 1e-8  # of the variance: residuals that are predicted better are not noise
FEWEST = 20  # residuals of a channel; fewer do not determine an autoregression


@dataclass(frozen=True)
class Autoregression:
    """An autoregression of order p.

    Attributes
    ----------
    coefficients : ndarray
        Shape (p,): x_t = sum_i coefficients[i - 1] x_(t-i) + innovation.
    first : ndarray
        Shape (p + 1,): correlations at lags 0 to p.
    """

    coefficients: Array
    first: Array

    def correlations(self, count: int) -> Array:
        """Return the correlations at lags 0 to ``count`` - 1."""
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
    """Return the autoregression of residuals in order of time, by Burg's recursion; order 0 for too few."""
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
    """Return a first-order autoregression corrected for the bias of a series of this length."""
    near = float(found.coefficients[0])
    if near <= 0.0:
        return found
    near = max(near, min(near + (1.0 + 3.0 * near) / count, LONGEST))
    return Autoregression(np.array([near]), np.array([1.0, near]))


@dataclass(frozen=True)
class RememberedNoise:
    """Middle of the sandwich, shape (unknowns, unknowns), and the effective number of independent samples."""

    middle: Array
    samples: float


def remembered_noise(jacobian: Array, residuals: Array, channels: npt.NDArray[np.int64]) -> RememberedNoise:
    """Return the sandwich's middle for autocorrelated residuals of each channel.

    Parameters
    ----------
    jacobian : ndarray
        Shape (rows, unknowns).
    residuals : ndarray
        Shape (rows,): in standard deviations.
    channels : ndarray
        Shape (rows,): index of each row's channel, rows in order of time; -1 for a prior, whose rows are independent.
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
