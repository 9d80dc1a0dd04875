# SPDX-License-Identifier: Apache-2.0
"""Diagnosis: fits each fault to a measured change of the features and selects the most likely ones.

A change delta is estimated from n cycles with covariance C.  A fault of size s changes the features by r(s), linear
between the simulated sizes, and beyond them on to twice the largest.  The residual is::

    open(s) = (delta - r(s))' K^-1 (delta - r(s)),     cost(s) = open(s) + ln det K = -2 ln likelihood
    K = C + diag(0.15 delta)^2 + b b' + (1/n + 1/60) F'F

K adds to C the model error (15 % of each feature's change) and the error b of the linear interpolation between sizes.
F is the scatter from cycle to cycle of a machine that no longer repeats itself.  The estimate of a fault's size has the
least cost.  Each bound is a quantile of chi-square, plus 0.15^2 delta' K^-1 delta for the model error.

A change lasts if delta' C^-1 delta exceeds the quantile of d degrees of freedom at 1e-4.  A fault explains it if
open(s) is below that of d - 1 degrees at 1e-4, and if its cost is less than without a fault by that of one degree at
1e-3.  The latter counts in units of the noise that open(s) shows.  If no fault explains it, the change is unknown.
Rivals exceed the least cost by at most the quantile of one degree at 1e-3.  The interval of a size exceeds the fault's
least cost by at most that at 5 %; where it holds the last size that is tried, it is open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import Baseline, Numbers

MODEL_SHARE = 0.15  # relative error of a computed effect
UNKNOWN_CHANCE = 1e-4  # that noise alone gives the right fault this residual
RIVAL = float(chi2.isf(1e-3, 1))  # excess of the right fault's cost over another's, with a chance of 0.1 %
INTERVAL = float(chi2.isf(0.05, 1))
PASSING_CHANCE = 1e-3  # that a lasting change is taken for a transient
GLITCH_CHANCE = 1e-6  # that noise alone makes a cycle this much of an outlier
GLITCHES = 0.2  # largest share of outlying cycles since the onset
REACH = 2.0  # times the largest simulated size: there its line ends
GRID = 41  # points from one simulated size to the next
STUCK = "sensor_stuck:"
USED_CYCLES = 60  # of a simulation, averaged for the response


@dataclass(frozen=True)
class Signature:
    """Effect of a fault on the features.

    Attributes
    ----------
    name, meaning, unit : str
        Name and description of the fault; unit of its size.
    sizes : ndarray
        Shape (m,): simulated sizes, ascending, including 0.
    responses : ndarray
        Shape (m, d): change of the features, SI; 0 at size 0.
    key : str
        The configuration key that changes, or the column of the sensor.
    scatter : ndarray
        Shape (m, q, d): factors F of the covariance F'F of the features from cycle to cycle at a size, in excess of
        the healthy machine's; empty without excess.
    doubt : ndarray
        Shape (m, d): error of the linear interpolation near each size; empty where the response is smooth.
    points : ndarray
        Shape (m, q): the operating point that each size is taken for, as shares of the ranges; empty without variables.
    """

    name: str
    meaning: str
    unit: str
    sizes: Numbers
    responses: Numbers
    key: str = ""
    scatter: Numbers = field(default_factory=lambda: np.empty((0, 0, 0)))
    doubt: Numbers = field(default_factory=lambda: np.empty((0, 0)))
    points: Numbers = field(default_factory=lambda: np.empty((0, 0)))

    def uncertainty(self, cycles: float) -> Array:
        """Return the covariance (m - 1, d, d) of the response for a mean of so many cycles, for each interval of sizes.

        Without scatter and interpolation error it is zero, of shape (1, d, d).
        """
        found, width = np.zeros((1, 1, 1)), self.responses.shape[1]
        if len(self.scatter):
            found = found + (1.0 / cycles + 1.0 / USED_CYCLES) * np.swapaxes(self.scatter, 1, 2) @ self.scatter
        if len(self.doubt):
            found = found + self.doubt[:, :, None] * self.doubt[:, None, :]
        return 0.5 * (found[:-1] + found[1:]) if len(found) > 1 else np.zeros((1, width, width))

    def response(self, size: float) -> Array:
        """Return the change of the features (d,) at a size, by linear interpolation."""
        return np.array([np.interp(size, self.sizes, column) for column in self.responses.T])

    @property
    def is_whole(self) -> bool:
        """Whether the fault is there or not, and no part of it can be: a sensor is not stuck by a tenth."""
        return self.name.startswith(STUCK)

    @cached_property
    def reaching(self) -> Signature:
        """The signature with each side of two sizes or more continued along its last line, a share to -1 at most.

        What that line leaves of the effect in proportion to the size is the error there.
        """
        found, least = self, -1.0 if self.unit == "1" else -np.inf
        for end, inner in ((0, 1), (-1, -2)):
            last, before = float(self.sizes[end]), float(self.sizes[inner])
            far = max(REACH * last, least)
            if last * before <= 0.0 or far == last:
                continue
            line = self.responses[end] + (self.responses[end] - self.responses[inner]) * (far - last) / (last - before)
            found = found._continued(end, far, line, np.abs(line - self.responses[end] * far / last))
        return found

    def _continued(self, end: int, far: float, line: Array, doubt: Array) -> Signature:
        """Return the signature with one more size at an end (0 or -1); scatter and point are those of the last."""
        place = 0 if end == 0 else len(self.sizes)

        def joined(values: Array, new: Array) -> Array:
            return np.insert(values, place, new, axis=0)

        known = self.doubt if len(self.doubt) else np.zeros_like(self.responses)
        return replace(
            self, sizes=joined(self.sizes, np.array(far)), responses=joined(self.responses, line),
            doubt=joined(known, np.maximum(doubt, known[end])),
            scatter=joined(self.scatter, self.scatter[end]) if len(self.scatter) else self.scatter,
            points=joined(self.points, self.points[end]) if len(self.points) else self.points,
        )  # fmt: skip

    @cached_property
    def fine(self) -> tuple[Array, Array]:
        """Return a fine grid of sizes (m - 1, n) between neighbouring ones, and the responses (m - 1, n, d)."""
        lines = (np.linspace(each[:-1], each[1:], GRID, axis=1) for each in (self.sizes, self.responses))
        return next(lines), next(lines)


class Candidate(NamedTuple):
    """A fault that explains the change: its size with the 95 % interval, and the share left unexplained."""

    name: str
    size: float
    low_95: float
    high_95: float
    unit: str
    open_share: float


class Change(NamedTuple):
    """Estimated change of the features (d,), its covariance (d, d), and the number of cycles averaged."""

    delta: Array
    covariance: Array
    cycles: float = 1.0

    @property
    def weight(self) -> float:
        """Chi-square of the change; d degrees of freedom if nothing has changed."""
        return float(self.delta @ np.linalg.solve(self.covariance, self.delta))

    @property
    def lasts(self) -> bool:
        """Whether the change is significant against noise."""
        return self.weight > float(chi2.isf(UNKNOWN_CHANCE, len(self.delta)))

    def exceeds(self, before: Change) -> bool:
        """Whether it is larger along itself than an earlier one, each with noise of its own, by the bound of rivals."""
        weighted = np.linalg.solve(self.covariance + before.covariance, self.delta)
        return bool(weighted @ (self.delta - before.delta) > np.sqrt(RIVAL * (weighted @ self.delta)))

    def doubted(self, off: Array) -> Change:
        """Return the change with another error of each feature (d,), a standard deviation, added to its covariance."""
        return self._replace(covariance=self.covariance + np.diag(off**2))


def estimated_change(baseline: Baseline, innovations: Array, settling: int) -> Change | None:
    """Return the change since the onset, the first row of the innovations (n, d); None while it is settling.

    There are two independent estimates of a change delta that is complete after s cycles.  With a_i and psi_i the
    coefficients and the impulse response of a feature's autoregression::

        sum over i = 0 .. s of psi_i e_(s-i) = delta + error of the forecast from before the onset
        e_t = (1 - sum of a_i) delta + noise,      t >= s + max(p, 1)

    If they contradict each other, there was a transient at the onset, and only the second estimate is used.
    Single outlying cycles are left out.
    """
    later = innovations[settling + max(baseline.order, 1) :]
    if not len(later):
        return None
    mean = mean_change(baseline, later)
    stayed, known, _ = mean
    impulse = baseline.impulse(settling + 1)
    apart = (impulse * innovations[settling::-1]).sum(axis=0) - stayed
    both = known + baseline.covariance * (impulse.T @ impulse)
    if apart @ np.linalg.solve(both, apart) > chi2.isf(PASSING_CHANCE, len(apart)):
        return mean
    gain = np.linalg.solve(both, known).T
    return Change(stayed + gain @ apart, known - gain @ known, 1.0 + mean.cycles)


def mean_change(baseline: Baseline, innovations: Array) -> Change:
    """Return the change in the mean of cycles (n, d) that have settled, single outlying ones left out."""
    later, steady = _without_single_cycles(innovations, baseline.covariance), baseline.steady
    known = baseline.covariance / (len(later) * np.outer(steady, steady))
    return Change(later.mean(axis=0) / steady, known, float(len(later)))


def change_has_cleared(baseline: Baseline, change: Change, innovations: Array) -> bool:
    """Return whether the newest innovations, of (n, d), are of a healthy machine and not of one with the change.

    Of the newest cycles, however many: they pass as healthy, and are likelier so than changed, by the bound of rivals.
    """
    changed = baseline.steady * change.delta
    weighted = np.linalg.solve(baseline.covariance, np.vstack([changed, innovations[::-1]]).T).T
    likelier = np.cumsum(weighted[0] @ changed - 2.0 * innovations[::-1] @ weighted[0])
    squares = np.cumsum((innovations[::-1] * weighted[1:]).sum(axis=1))
    degrees = innovations.shape[1] * np.arange(1, len(innovations) + 1)
    return bool(np.any((likelier > RIVAL) & (squares <= chi2.isf(UNKNOWN_CHANCE, degrees))))


def _without_single_cycles(innovations: Array, covariance: Array) -> Array:
    """Return the cycles (n, d) without outliers; all of them if there are many outliers.

    Many outliers are a machine that no longer repeats itself, not glitches.
    """
    apart = innovations - np.median(innovations, axis=0)
    squares = (apart * np.linalg.solve(covariance, apart.T).T).sum(axis=1)
    alike = squares <= chi2.isf(GLITCH_CHANCE, innovations.shape[1])
    return innovations[alike] if alike.mean() >= 1.0 - GLITCHES else innovations


class Fit(NamedTuple):
    """A fault at its best-fitting size: cost, residual chi-square, and the candidate with its interval."""

    cost: float
    left: float
    candidate: Candidate


def fitted_faults(measured: Change, signatures: Sequence[Signature]) -> list[Fit]:
    """Return each fault at its best-fitting size, whether or not it explains the change."""
    change = measured.doubted(MODEL_SHARE * measured.delta)
    return [_fit(change, change.weight, signature) for signature in signatures]


def candidates(measured: Change, signatures: Sequence[Signature]) -> tuple[Candidate, ...]:
    """Return the faults that explain a change, best first; empty if the change is unknown."""
    change = measured.doubted(MODEL_SHARE * measured.delta)
    tolerated, degrees = MODEL_SHARE**2 * change.weight, max(len(change.delta) - 1, 1)
    bound = float(chi2.isf(UNKNOWN_CHANCE, degrees)) + tolerated
    without = change.weight + float(np.linalg.slogdet(change.covariance)[1])
    found = fitted_faults(measured, signatures)
    fits = sorted(fit for fit in found if fit.left <= bound and fit.candidate.open_share < 1.0)
    if not fits or without - fits[0].cost <= RIVAL * max(1.0, fits[0].left / degrees):
        return ()
    return tuple(fit.candidate for fit in fits if fit.cost <= fits[0].cost + RIVAL + tolerated)


def _fit(change: Change, weight: float, signature: Signature) -> Fit:
    """Return the fit of a fault; the interval includes noise and model error."""
    signature = signature.reaching
    sizes, responses = signature.fine
    inverse = np.linalg.inv(change.covariance + signature.uncertainty(change.cycles))
    left = residual_chi_square(change.delta - responses, inverse)
    cost = np.where(
        (sizes == 0.0) | signature.is_whole & (sizes < 1.0), np.inf, left - np.linalg.slogdet(inverse)[1][:, None]
    )
    best = np.unravel_index(np.argmin(cost), cost.shape)
    inside = sizes[cost <= cost[best] + INTERVAL + min(MODEL_SHARE**2 * weight, left[best])]
    size, open_share = map(float, (sizes[best], left[best] / weight))
    low, high = _opened(signature, float(inside.min()), float(inside.max()))
    candidate = Candidate(signature.name, size, low, high, signature.unit, open_share)
    return Fit(float(cost[best]), float(left[best]), candidate)


def _opened(signature: Signature, low: float, high: float) -> tuple[float, float]:
    """Return an interval, open where it holds an end of the sizes that others on its side led to, but for all of it."""
    sizes, whole = signature.sizes, signature.unit == "1"
    if low == sizes[0] and sizes[1] < 0.0 and not (whole and low == -1.0):
        low = -np.inf
    if high == sizes[-1] and sizes[-2] > 0.0:
        high = np.inf
    return low, high


def residual_chi_square(left: Array, inverse: Any) -> Array:
    """Return the chi-square (m, n) of residuals (m, n, d) for inverse covariances (m, d, d) or (d, d)."""
    return np.asarray(((left @ inverse) * left).sum(axis=-1))
