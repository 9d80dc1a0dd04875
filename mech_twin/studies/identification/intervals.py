# SPDX-License-Identifier: Apache-2.0
"""Standard errors of a fit: the largest of least squares, coloured noise, block sandwich and jackknife estimates.

Residuals within one stretch of a run are correlated by unmodelled motion or a sensor's filter.  Blocks of a run,
instead of its samples, are taken as independent; they give the covariance of the sandwich estimate::

    C = H^-1 (sum over blocks of g g') H^-1,    g = J' r of the block,  H = J' J

Leaving out one block, or one run, at a time gives the jackknife, here by one Newton step from the whole fit.

Blocks of a short run do not show correlation, but an autoregression of each channel's residuals has few parameters.
It is fitted by Burg's recursion (BurgSpectrum1967), with the order of least Bayesian information criterion
(SchwarzDimension1978).  At first order, the bias (1 + 3 a)/n of a short series is corrected (KendallBias1954).  With R
its correlation matrix and s^2 the variance of the channel's residuals it gives::

    C = H^-1 (sum over channels of s^2 J' R J) H^-1

Two errors that residuals do not show are added.  One is the length of the next Gauss-Newton step, where the fit ended
before its minimum (the offset of Bates and Watts 1981).  The other is the shift of a key if the keys held fixed,
because the runs do not identify them, were off by half their value (consider parameters: Schmidt 1966).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
from scipy import stats
from scipy.linalg import matmul_toeplitz
from scipy.signal import lfilter, lfiltic

from mech_twin.measurements.blocks import Array
from mech_twin.studies.burg import BurgOrder, best_order
from mech_twin.studies.identification.fit_quality import Fitted
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.staged_fit import robust_weights

BLOCKS = 30  # of all runs together
FEWEST_BLOCKS = 8  # of a run
RANK = 1e-10  # of the largest singular value of the scaled derivatives
MOST_LEVERAGE = 0.9  # of a block on a direction: the other blocks hold hardly any information of it
NORMAL = float(stats.norm.ppf(0.975))
FIXED_OFF = 0.5  # of its size: by how much a free key that stays as configured may be off
MOST_ORDER = 4
LONGEST = 0.995  # upper bound of the corrected first-order coefficient
LEAST_LEFT = 1e-8  # of the variance: residuals that are predicted better are not noise
FEWEST = 20  # residuals of a channel; fewer do not determine an autoregression


def autoregression(residuals: Array) -> BurgOrder:
    """Return the autoregression of residuals in order of time, by Burg's recursion; order 0 for too few.

    A first order is corrected for the bias of a short series.
    """
    count = len(residuals)
    found = best_order([residuals[:, None]], MOST_ORDER if count >= FEWEST and residuals.any() else 0, LEAST_LEFT)
    if len(found.coefficients) != 1 or found.coefficients[0, 0] <= 0.0:
        return found
    near = float(found.coefficients[0, 0])
    near = max(near, min(near + (1.0 + 3.0 * near) / count, LONGEST))
    return replace(found, coefficients=np.array([[near]]), correlations=np.array([[1.0], [near]]))


def correlations(found: BurgOrder, count: int) -> Array:
    """Return the correlations of an autoregression of one series at lags 0 to ``count`` - 1."""
    coefficients, first = found.coefficients[:, 0], found.correlations[:, 0]
    if count <= len(first):
        return first[:count]
    poles = np.concatenate([[1.0], -coefficients])
    rest, _ = lfilter([1.0], poles, np.zeros(count - len(first)), zi=lfiltic([1.0], poles, first[:0:-1]))
    return np.concatenate([first, rest])


def remembered_noise(jacobian: Array, residuals: Array, channels: npt.NDArray[np.int64]) -> tuple[Array, float]:
    """Return the sandwich's middle for autocorrelated residuals of each channel, and the effective number of samples.

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
        alike = correlations(autoregression(shown), count)
        middle = middle + float(shown @ shown) / count * (own.T @ matmul_toeplitz(alike, own))
        repeated = 1.0 + 2.0 * float((1.0 - np.arange(1, count) / count) @ alike[1:])
        samples += count / max(repeated, 1.0)
    return middle, samples


@dataclass(frozen=True)
class Linearised:
    """A fit and its derivatives where it ended: robust weights are on rows of both.

    Attributes
    ----------
    jacobian, other : ndarray
        Shape (rows, unknowns), by unknowns over their scales; the other from another step length.
    residuals : ndarray
        Shape (rows,).
    blocks : ndarray
        Shape (rows,): block of each row, -1 of a row that is no sample (a prior).
    runs : ndarray
        Shape (rows,): run of each row, -1 likewise.
    channels : ndarray
        Shape (rows,): channel of a run of each row, in the order of their times, -1 likewise.
    """

    jacobian: Array
    other: Array
    residuals: Array
    blocks: npt.NDArray[np.int64]
    runs: npt.NDArray[np.int64]
    channels: npt.NDArray[np.int64]

    def of(self, chosen: npt.NDArray[np.intp]) -> Linearised:
        """Return the same for some of the unknowns, the others fixed where they are."""
        return replace(self, jacobian=self.jacobian[:, chosen], other=self.other[:, chosen])

    def of_channels(self, channels: Sequence[int]) -> Linearised:
        """Return the same for the rows of some channels, and those that are no samples."""
        rows = np.isin(self.channels, [-1, *channels])
        return Linearised(*(getattr(self, each.name)[rows] for each in fields(self)))

    def over(self, factors: Array) -> Linearised:
        """Return the same by unknowns over scales that are so many times as large, shape (unknowns,)."""
        return replace(self, jacobian=self.jacobian * factors, other=self.other * factors)


def linearised(fitted: Fitted) -> Linearised:
    """Return the derivatives of a fit where it ended."""
    problem, comparison = fitted.problem, fitted.comparison
    rows = problem.residuals(fitted.x, comparison)
    jacobian, other = problem.two_jacobians(fitted.x, comparison)
    weights = robust_weights(rows)
    spans = [(run.first_s, max(run.end_s, run.first_s + 1e-9)) for run in problem.runs]
    total = sum(last - first for first, last in spans)
    counts = [max(FEWEST_BLOCKS, round(BLOCKS * (last - first) / total)) for first, last in spans]
    before = np.concatenate([[0], np.cumsum(counts)])
    blocks, runs, channels = [], [], []
    for number, (run, place) in enumerate(problem.places()):
        times = problem.runs[run].channels[place].times_s[comparison.masks[run][place]]
        first, last = spans[run]
        own = np.clip(((times - first) / (last - first) * counts[run]).astype(np.int64), 0, counts[run] - 1)
        blocks.append(own + before[run])
        runs.append(np.full(len(times), run))
        channels.append(np.full(len(times), number))
    rest = np.full(len(rows) - sum(map(len, blocks)), -1)
    return Linearised(
        jacobian * weights[:, None],
        other * weights[:, None],
        rows * weights,
        np.concatenate([*blocks, rest]).astype(np.int64),
        np.concatenate([*runs, rest]).astype(np.int64),
        np.concatenate([*channels, rest]).astype(np.int64),
    )


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of the unknowns of a fit.

    Attributes
    ----------
    errors : ndarray
        Shape (unknowns,): standard errors over the scales.
    half_widths : ndarray
        Shape (2, unknowns): from the estimate down and up to the ends of the 95 % interval, over the scales.
    covariance : ndarray
        Shape (unknowns, unknowns): that of least squares, widened to these errors.
    given_tied : ndarray
        Shape (2, unknowns): the same of a key whose fixed keys that it is tied to are as configured.
    """

    errors: Array
    half_widths: Array
    covariance: Array
    given_tied: Array

    def correlation(self, count: int) -> Array:
        """Return the correlation of the estimates of the first unknowns, shape (count, count)."""
        covariance = self.covariance[:count, :count]
        deviations = np.sqrt(np.diag(covariance))
        sizes = np.outer(deviations, deviations)
        return np.asarray(covariance / np.where(sizes > 0.0, sizes, np.inf))


def uncertainty(found: Linearised) -> Uncertainty:
    """Return the standard errors of all unknowns: the largest of several, each with Student's t of its own freedom."""
    inverse = inverse_information(found.jacobian)
    freedom = max(len(found.residuals) - found.jacobian.shape[1], 1)
    variance = float(found.residuals @ found.residuals) / freedom
    plain = inverse * variance
    own = np.sqrt(np.diag(plain))
    candidates = [(own, float(stats.t.ppf(0.975, freedom))), _with_memory(found, inverse)]
    groups = [(found.blocks, MOST_LEVERAGE)]
    if found.runs.max(initial=0) > 0:
        groups.append((found.runs, 1.0 - RANK))  # a short run that disagrees with a long one counts in full
    for labels, most_leverage in groups:
        scores = _scores(found, labels)
        count = len(scores)
        share = float(stats.t.ppf(0.975, count - 1))
        middle = scores.T @ scores * count / (count - 1)
        candidates.append((np.sqrt(np.diag(inverse @ middle @ inverse)), share))
        candidates.append((_jackknife(found, labels, most_leverage), share))
    widths = np.array([error * share for error, share in candidates])
    errors = np.array([candidates[widest][0][i] for i, widest in enumerate(widths.argmax(axis=0))])
    half_widths = widths.max(axis=0)
    grown = half_widths / NORMAL / np.where(own > 0.0, own, 1.0)
    both = np.array([half_widths, half_widths])
    return Uncertainty(errors, both, plain * np.outer(grown, grown), both)


def _with_memory(found: Linearised, inverse: Array) -> tuple[Array, float]:
    """Return the standard errors for correlated residuals, with Student's t of the effective number of samples."""
    middle, samples = remembered_noise(found.jacobian, found.residuals, found.channels)
    freedom = max(samples - found.jacobian.shape[1], 1.0)
    error = np.sqrt(np.maximum(np.diag(inverse @ (middle * samples / freedom) @ inverse), 0.0))
    return error, float(stats.t.ppf(0.975, freedom))


def last_step(found: Linearised) -> Array:
    """Return the next Gauss-Newton step from the end of a fit, over the scales, shape (unknowns,)."""
    return -inverse_information(found.jacobian) @ (found.jacobian.T @ found.residuals)


def moved_by_fixed(found: Linearised, fixed: Array) -> Array:
    """Return the shift of the unknowns if fixed keys are off by half their value, shape (unknowns,).

    Parameters
    ----------
    fixed : ndarray
        Shape (rows, keys fixed): derivatives by the logarithms of those that were fixed.
    """
    moves = inverse_information(found.jacobian) @ (found.jacobian.T @ fixed)
    return np.asarray(FIXED_OFF * np.sqrt(np.sum(moves**2, axis=1)))


def inverse_information(jacobian: Array) -> Array:
    """Return the pseudo-inverse of J'J with scaled columns, without unobservable directions, shape (n, n)."""
    root = _root_of_inverse(jacobian)
    return np.asarray(root @ root.T)


def _root_of_inverse(jacobian: Array) -> Array:
    """Return a square root R R' of that pseudo-inverse, with R'J'J R = 1, shape (n, observable)."""
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    triangle = np.linalg.qr(jacobian / size, mode="r")  # the same singular values, of few rows
    _, singular, directions = np.linalg.svd(triangle, full_matrices=False)
    kept = singular > RANK * singular.max(initial=0.0)
    return np.asarray((directions[kept] / singular[kept, None]).T / size[:, None])


def _scores(found: Linearised, labels: npt.NDArray[np.int64]) -> Array:
    """Return the score J'r of each group, shape (groups, unknowns); their sum is zero at the minimum."""
    rows = found.jacobian * found.residuals[:, None]
    groups = np.unique(labels[labels >= 0])
    return np.array([rows[labels == group].sum(axis=0) for group in groups])


def _jackknife(found: Linearised, labels: npt.NDArray[np.int64], most_leverage: float) -> Array:
    """Return the jackknife standard errors: one group left out at a time, one Newton step each.

    A direction on which a group has more than this leverage h stays where the group is left out: the rest would move it
    by h / (1 - h) times its error.
    """
    root, moved = _root_of_inverse(found.jacobian), []
    groups = np.unique(labels[labels >= 0])
    for group in groups:
        out = found.jacobian[labels == group] @ root
        leverages, directions = np.linalg.eigh(out.T @ out)
        kept = leverages < most_leverage
        score = directions[:, kept].T @ (out.T @ found.residuals[labels == group])
        moved.append(root @ (directions[:, kept] @ (score / (1.0 - leverages[kept]))))
    away = np.array(moved)
    away = away - away.mean(axis=0)
    return np.asarray(np.sqrt((len(groups) - 1) / len(groups) * np.sum(away**2, axis=0)))


def intervals_before(asked: IdentificationQuestion) -> dict[str, tuple[float, float]]:
    """Return the prior knowledge of each free key: the 95 % interval of its prior, else its search bounds."""
    bounds = asked.search_range()
    priors = {key: (mean - NORMAL * sd, mean + NORMAL * sd) for key, (mean, sd) in asked.priors.items()}
    return {**{key: (float(low), float(high)) for key, low, high in zip(asked.keys, *bounds, strict=True)}, **priors}
