# SPDX-License-Identifier: Apache-2.0
"""Fault isolation: each fault is a normal distribution of a change of the features; the likeliest is named.

A change delta, with the covariance C by which it is known, is the mean of n cycles.  A fault of size s changes the
features by r(s), a line between sizes that were rolled out, and leaves open::

    open(s) = (delta - r(s))' K^-1 (delta - r(s)),     cost(s) = open(s) + ln det K = -2 ln likelihood
    K = C + diag(0.15 delta)^2 + b b' + (1/n + 1/60) F'F

K adds what the model may be off (15 % of what each feature does) to C.  It adds how far the response may bend between
two sizes (b), and the scatter from cycle to cycle of a machine that no longer repeats itself (F).  The size of least
cost is the fault's.  Each bound is a quantile of chi-square, with 0.15^2 delta' K^-1 delta added for the model again.

A change lasts where delta' C^-1 delta is beyond that of d degrees, 1e-4.  A fault explains it that leaves less open
than that of d - 1 degrees, 1e-4; without one it is unknown.  Rivals cost at most that of one degree, 1e-3, more than
the best.  A size's interval costs at most that of one degree, 5 %, more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import Baseline

MODEL_SHARE = 0.15  # of an effect, by which the computed one may be off
UNKNOWN_CHANCE = 1e-4  # that the right fault leaves so much open by noise alone
RIVAL = float(chi2.isf(1e-3, 1))  # by which the right fault costs more than another with a chance of 0.1 %
INTERVAL = float(chi2.isf(0.05, 1))
PASSING_CHANCE = 1e-3  # that what stays is taken for what passes
GLITCH_CHANCE = 1e-6  # that a cycle is as far from the others by noise alone
GLITCHES = 0.2  # of the cycles since the onset, at most
GRID = 41  # sizes from one that was rolled out to the next
USED_CYCLES = 60  # of a roll-out, whose mean is its response


@dataclass(frozen=True)
class Signature:
    """Signature: effect of a fault on the features.

    Attributes
    ----------
    name, meaning, unit : str
        Of the fault; the unit is that of its size.
    sizes : ndarray
        Shape (m,): ascending, with 0.
    responses : ndarray
        Shape (m, d): change of the features, SI; 0 at size 0.
    key : str
        The configuration key that changes, or the column of the sensor.
    scatter : ndarray
        Shape (m, q, d): factors F of the covariance F'F by which the features scatter from cycle to cycle at a size,
        beyond what they do in the healthy machine; empty where they do not.
    doubt : ndarray
        Shape (m, d): by what a response may be off because it bends about its size; empty where it is smooth.
    """

    name: str
    meaning: str
    unit: str
    sizes: Array
    responses: Array
    key: str = ""
    scatter: Array = field(default_factory=lambda: np.empty((0, 0, 0)))
    doubt: Array = field(default_factory=lambda: np.empty((0, 0)))

    def uncertainty(self, cycles: float) -> Array:
        """Return the covariance (m - 1, d, d) by which the mean of so many cycles may be off, from size to size.

        It is (1, d, d), and 0, where there is none.
        """
        found, width = np.zeros((1, 1, 1)), self.responses.shape[1]
        if len(self.scatter):
            found = found + (1.0 / cycles + 1.0 / USED_CYCLES) * np.swapaxes(self.scatter, 1, 2) @ self.scatter
        if len(self.doubt):
            found = found + self.doubt[:, :, None] * self.doubt[:, None, :]
        return 0.5 * (found[:-1] + found[1:]) if len(found) > 1 else np.zeros((1, width, width))

    def response(self, size: float) -> Array:
        """Return the change of the features (d,) at a size."""
        return np.array([np.interp(size, self.sizes, column) for column in self.responses.T])

    @cached_property
    def fine(self) -> tuple[Array, Array]:
        """Return finely spaced sizes (m - 1, n) from each to the next, and the responses (m - 1, n, d) at them."""
        lines = (np.linspace(each[:-1], each[1:], GRID, axis=1) for each in (self.sizes, self.responses))
        return next(lines), next(lines)


class Candidate(NamedTuple):
    """A fault that explains what is seen: its size with the 95 % interval, and the share of the effect left open."""

    name: str
    size: float
    low_95: float
    high_95: float
    unit: str
    open_share: float


class Change(NamedTuple):
    """An estimated change of the features, shape (d,), its covariance (d, d), and cycles it is a mean of."""

    delta: Array
    covariance: Array
    cycles: float = 1.0

    @property
    def weight(self) -> float:
        """Chi-square of the change, of d degrees where nothing has changed."""
        return float(self.delta @ np.linalg.solve(self.covariance, self.delta))

    @property
    def lasts(self) -> bool:
        """Whether there is a change at all, beyond what noise makes."""
        return self.weight > float(chi2.isf(UNKNOWN_CHANCE, len(self.delta)))

    def doubted(self, off: Array) -> Change:
        """Return the change where each feature (d,) may be off by so much for another reason."""
        return self._replace(covariance=self.covariance + np.diag(off**2))


def estimated_change(baseline: Baseline, innovations: Array, settling: int) -> Change | None:
    """Return the change since the onset, the first row of the innovations (n, d); None while it is settling.

    Two independent looks at a change delta that is complete after s cycles, with a_i and psi_i the coefficients and the
    impulse response of the autoregression of a feature::

        sum over i = 0 .. s of psi_i e_(s-i) = delta + error of the forecast from before the onset
        e_t = (1 - sum of a_i) delta + noise,      t >= s + max(p, 1)

    Where they contradict each other, something passed at the onset that did not stay: only the second look counts.
    Single cycles that are far from the others since do not.
    """
    later = innovations[settling + max(baseline.order, 1) :]
    if not len(later):
        return None
    later = _without_single_cycles(later, baseline.covariance)
    steady = 1.0 - baseline.coefficients.sum(axis=0)
    stayed = later.mean(axis=0) / steady
    known = baseline.covariance / (len(later) * np.outer(steady, steady))
    impulse = baseline.features(np.eye(settling + 1, 1) * np.ones_like(steady)) - baseline.mean
    apart = (impulse * innovations[settling::-1]).sum(axis=0) - stayed
    both = known + baseline.covariance * (impulse.T @ impulse)
    if apart @ np.linalg.solve(both, apart) > chi2.isf(PASSING_CHANCE, len(apart)):
        return Change(stayed, known, float(len(later)))
    gain = np.linalg.solve(both, known).T
    return Change(stayed + gain @ apart, known - gain @ known, 1.0 + len(later))


def _without_single_cycles(innovations: Array, covariance: Array) -> Array:
    """Return the cycles (n, d) without those that are far from the others; all of them if these are many.

    A machine that no longer repeats itself scatters in every cycle: that is no glitch.
    """
    apart = innovations - np.median(innovations, axis=0)
    squares = (apart * np.linalg.solve(covariance, apart.T).T).sum(axis=1)
    alike = squares <= chi2.isf(GLITCH_CHANCE, innovations.shape[1])
    return innovations[alike] if alike.mean() >= 1.0 - GLITCHES else innovations


class Fit(NamedTuple):
    """A fault at the size that explains a change best: its cost, what it leaves open, and all of it in words."""

    cost: float
    left: float
    candidate: Candidate


def fitted_faults(measured: Change, signatures: Sequence[Signature]) -> list[Fit]:
    """Return each fault at the size that explains a change best, whether or not it explains it."""
    change = measured.doubted(MODEL_SHARE * measured.delta)
    return [_fit(change, change.weight, signature) for signature in signatures]


def candidates(measured: Change, signatures: Sequence[Signature]) -> tuple[Candidate, ...]:
    """Return the faults that explain a change, the best first; none where it is unknown."""
    change = measured.doubted(MODEL_SHARE * measured.delta)
    tolerated = MODEL_SHARE**2 * change.weight
    bound = float(chi2.isf(UNKNOWN_CHANCE, max(len(change.delta) - 1, 1))) + tolerated
    found = fitted_faults(measured, signatures)
    fits = sorted(fit for fit in found if fit.left <= bound and fit.candidate.open_share < 1.0)
    return tuple(fit.candidate for fit in fits if fit.cost <= fits[0].cost + RIVAL + tolerated)


def _fit(change: Change, weight: float, signature: Signature) -> Fit:
    """Return the fit of a fault; the interval is that of noise, widened by what the model may be off."""
    sizes, responses = signature.fine
    inverse = np.linalg.inv(change.covariance + signature.uncertainty(change.cycles))
    left = left_open(change.delta - responses, inverse)
    cost = np.where(sizes == 0.0, np.inf, left - np.linalg.slogdet(inverse)[1][:, None])
    best = np.unravel_index(np.argmin(cost), cost.shape)
    inside = sizes[cost <= cost[best] + INTERVAL + min(MODEL_SHARE**2 * weight, left[best])]
    size, open_share = map(float, (sizes[best], left[best] / weight))
    told = Candidate(signature.name, size, float(inside.min()), float(inside.max()), signature.unit, open_share)
    return Fit(float(cost[best]), float(left[best]), told)


def left_open(left: Array, inverse: Any) -> Array:
    """Return what changes (m, n, d) are worth by inverse covariances (m, d, d) or (d, d): chi-square (m, n)."""
    return np.asarray(((left @ inverse) * left).sum(axis=-1))
