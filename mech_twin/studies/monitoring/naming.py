# SPDX-License-Identifier: Apache-2.0
"""Which fault explains the features: signatures by size, a generalised likelihood ratio over all of them.

From the innovations after an onset the change delta of the features is estimated with its information matrix M; what
happens while the machine settles is left free.  A fault j of size s changes them by
r_j(s), computed by roll-outs and interpolated over s.  What it leaves open is::

    open_j = min over s of (delta - r_j(s))' M (delta - r_j(s)),       all there is:  delta' M delta

A model is never exact: ``MODEL_SHARE`` of what each feature does may be off, which is added to the scatter of delta
before anything is compared, and so much of the whole may stay open too.  A machine with a large fault may no longer
repeat itself from cycle to cycle: its signature then has a scatter of its own, which n cycles average, and a doubt
where the response bends between two sizes. Both are added, and the determinant is that of a likelihood.
Candidates are all faults that leave little more open than the best; one candidate is a name, several are a group,
none that leaves little enough open is ``unknown``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import Baseline

MODEL_SHARE = 0.15  # of an effect, by which the computed one may be off
UNKNOWN_CHANCE = 1e-4  # that the right fault leaves so much open by noise alone
GLITCH_CHANCE = 1e-6  # that a cycle is as far from the others by noise alone
GLITCHES = 0.2  # of the cycles since the onset, at most
PASSING_CHANCE = 1e-3  # that what stays is taken for what passes
RIVAL_CHANCE = 1e-3  # that the right fault leaves so much more open than another
INTERVAL = 3.84  # 95 % point of chi-square of one degree
GRID = 40  # sizes between two that were computed
STEPS = np.linspace(0.0, 1.0, GRID, endpoint=False)
ARRAYS = ("sizes", "responses", "scatter", "cycles", "doubt")


@dataclass(frozen=True)
class Signature:
    """What a fault does to the features.

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
    cycles : ndarray
        Shape (m,): cycles that the responses are means of; empty without a scatter.
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
    cycles: Array = field(default_factory=lambda: np.empty(0))
    doubt: Array = field(default_factory=lambda: np.empty((0, 0)))

    def uncertainty(self, cycles: float) -> Array | None:
        """Return the covariance (m, d, d) by which the mean of so many cycles may be off; None without any."""
        found = np.zeros((len(self.sizes), self.responses.shape[1], self.responses.shape[1]))
        if len(self.scatter):
            share = 1.0 / cycles + 1.0 / self.cycles
            found += share[:, None, None] * np.einsum("mqi,mqj->mij", self.scatter, self.scatter)
        if len(self.doubt):
            found += self.doubt[:, :, None] * self.doubt[:, None, :]
        return found if len(self.scatter) or len(self.doubt) else None

    def response(self, size: float) -> Array:
        """Return the change of the features (d,) at a size."""
        return np.array([np.interp(size, self.sizes, column) for column in self.responses.T])

    @cached_property
    def _even(self) -> Array:
        """Finely spaced sizes, `GRID` from each to the next."""
        return np.append((self.sizes[:-1, None] + np.diff(self.sizes)[:, None] * STEPS).ravel(), self.sizes[-1])

    @cached_property
    def kept(self) -> npt.NDArray[np.bool_]:
        """Which of the finely spaced sizes are not 0."""
        return np.asarray(np.abs(self._even) > 1e-12 * np.abs(self.sizes).max())

    @cached_property
    def fine(self) -> tuple[Array, Array]:
        """Return finely spaced sizes, 0 left out, and the responses at them."""
        sizes = self._even[self.kept]
        responses = np.array([np.interp(sizes, self.sizes, column) for column in self.responses.T]).T
        return sizes, responses

    def record(self) -> dict[str, Any]:
        """Return the signature as JSON values."""
        told = {"name": self.name, "meaning": self.meaning, "unit": self.unit, "key": self.key}
        arrays = {"sizes": self.sizes, "responses": self.responses}
        if len(self.scatter):
            arrays |= {"scatter": self.scatter, "cycles": self.cycles}
        if len(self.doubt):
            arrays["doubt"] = self.doubt
        return {**told, **{key: array.tolist() for key, array in arrays.items()}}


def signature_of_record(record: Mapping[str, Any]) -> Signature:
    """Return the signature of its record."""
    arrays = {key: np.array(record[key], dtype=np.float64) for key in ARRAYS if key in record}
    return Signature(record["name"], record["meaning"], record["unit"], key=record["key"], **arrays)


class Candidate(NamedTuple):
    """A fault that explains what is seen: its size with the 95 % interval, and the share of the effect left open."""

    name: str
    size: float
    low_95: float
    high_95: float
    unit: str
    open_share: float


class Change(NamedTuple):
    """An estimated change of the features, shape (d,), its information matrix (d, d), and cycles it is a mean of."""

    delta: Array
    information: Array
    cycles: float = 1.0

    @property
    def weight(self) -> float:
        """Chi-square of the change, of d degrees where nothing has changed."""
        return float(self.delta @ self.information @ self.delta)

    @property
    def lasts(self) -> bool:
        """Whether there is a change at all, beyond what noise makes."""
        return self.weight > float(chi2.isf(UNKNOWN_CHANCE, len(self.delta)))

    def doubted(self, off: Array) -> Change:
        """Return the change where each feature (d,) may be off by so much for another reason."""
        return self._replace(information=_doubted(self.information, off)) if off.any() else self


def _doubted(information: Array, off: Array) -> Array:
    return np.asarray(np.linalg.inv(np.linalg.inv(information) + np.diag(off**2)))


def estimated_change(baseline: Baseline, innovations: Array, settling: int) -> Change | None:
    """Return the change since the onset, the first row of the innovations (n, d); None while it is settling.

    Two independent looks at a change delta that is complete after s cycles, with a_i and psi_i the coefficients and the
    impulse response of the autoregression of a feature::

        sum over i = 0 .. s of psi_i e_(s-i) = delta + error of the forecast from before the onset
        e_t = (1 - sum of a_i) delta + noise,      t >= s + max(p, 1)

    Where they contradict each other, something passed at the onset that did not stay: only the second look counts.
    Single cycles that are far from the others since do not.
    """
    begin = settling + max(baseline.order, 1)
    later = without_single_cycles(innovations[begin:], baseline.covariance)
    if not len(later):
        return None
    inverse = np.linalg.inv(baseline.covariance)
    impulse = impulse_response(baseline, settling)
    steady = 1.0 - baseline.coefficients.sum(axis=0)
    scatter = baseline.covariance * (impulse.T @ impulse)
    at_onset, forecast = (impulse * innovations[settling::-1]).sum(axis=0), np.linalg.inv(scatter)
    since, right = len(later) * (steady[:, None] * inverse * steady), steady * (inverse @ later.sum(axis=0))
    stayed = Change(np.linalg.solve(since, right), since, float(len(later)))
    apart = at_onset - stayed.delta
    contradiction = apart @ np.linalg.solve(scatter + np.linalg.inv(since), apart)
    if contradiction > float(chi2.isf(PASSING_CHANCE, len(apart))):
        return stayed
    information = forecast + since
    return Change(np.linalg.solve(information, forecast @ at_onset + right), information, 1.0 + len(later))


def without_single_cycles(innovations: Array, covariance: Array) -> Array:
    """Return innovations (n, d) without the few that are no noise about their median; all of them if these are many.

    A machine that no longer repeats itself scatters in every cycle: that is no glitch.
    """
    if not len(innovations):
        return innovations
    apart = innovations - np.median(innovations, axis=0)
    squares = (apart * np.linalg.solve(covariance, apart.T).T).sum(axis=1)
    alike = squares <= chi2.isf(GLITCH_CHANCE, innovations.shape[1])
    return innovations[alike] if alike.mean() >= 1.0 - GLITCHES else innovations


def impulse_response(baseline: Baseline, cycles: int) -> Array:
    """Return psi_0 = 1 to psi_cycles of each feature's autoregression, (cycles + 1, d)."""
    found = np.zeros((cycles + 1, len(baseline.mean)))
    found[0] = 1.0
    for t in range(1, cycles + 1):
        for lag in range(1, min(t, baseline.order) + 1):
            found[t] += baseline.coefficients[lag - 1] * found[t - lag]
    return found


def with_model_error(change: Change) -> Change:
    """Return the change with the scatter of what a model may be off: a share of what each feature does."""
    scatter = np.linalg.inv(change.information) + np.diag((MODEL_SHARE * change.delta) ** 2)
    return change._replace(information=np.linalg.inv(scatter))


def candidates(measured: Change, signatures: Sequence[Signature]) -> tuple[Candidate, ...]:
    """Return the faults that explain a change, the best first; none where it is unknown."""
    change = with_model_error(measured)
    tolerated = MODEL_SHARE**2 * change.weight
    fits = [(_fit(change, signature, tolerated), signature) for signature in signatures]
    fits.sort(key=lambda fit: fit[0].cost)
    if not fits:
        return ()
    width = len(change.delta)
    bound = float(chi2.isf(UNKNOWN_CHANCE, max(width - 1, 1))) + tolerated
    explained = [(fit, signature) for fit, signature in fits if fit.left <= bound and fit.left < change.weight]
    if not explained:
        return ()
    rivals = explained[0][0].cost + float(chi2.isf(RIVAL_CHANCE, 1)) + tolerated
    return tuple(_candidate(fit, signature, change) for fit, signature in explained if fit.cost <= rivals)


def fitted_fault(measured: Change, signature: Signature) -> Candidate:
    """Return a fault at the size that explains a change best, whether or not it explains it."""
    change = with_model_error(measured)
    return _candidate(_fit(change, signature, MODEL_SHARE**2 * change.weight), signature, change)


def _candidate(fit: _Fit, signature: Signature, change: Change) -> Candidate:
    left = max(fit.left, 0.0) / max(change.weight, 1e-300)
    return Candidate(signature.name, fit.size, fit.low, fit.high, signature.unit, left)


class _Fit(NamedTuple):
    """What a fault leaves open at its best size, the same with the determinant, that size and its interval."""

    left: float
    cost: float
    size: float
    low: float
    high: float


def _fit(change: Change, signature: Signature, tolerated: float) -> _Fit:
    """Return the best fit of a fault; the interval is that of noise, widened by what the model may be off."""
    left, spread = _left_open(change, signature)
    sizes, cost = signature.fine[0], left + spread
    best = int(np.argmin(cost))
    wide = INTERVAL + min(tolerated, max(left[best], 0.0))
    inside = sizes[cost <= cost[best] + wide]
    return _Fit(float(left[best]), float(cost[best]), float(sizes[best]), float(inside.min()), float(inside.max()))


def _left_open(change: Change, signature: Signature) -> tuple[Array, Array]:
    """Return what stays open at the fine sizes, and the logarithm of the determinant beyond that of the change.

    Between two sizes the response is a line, so that what it leaves open is a parabola through three products.
    """
    left, extra = change.delta - signature.responses, signature.uncertainty(change.cycles)
    before, after = left[:-1], left[1:]
    if extra is None:
        weighted = left @ change.information
        ends = (weighted * left).sum(axis=1)
        first, last, mixed = ends[:-1], ends[1:], (weighted[:-1] * after).sum(axis=1)
        spread = np.zeros(len(before))
    else:
        scatter = np.linalg.inv(change.information)
        inverse = np.linalg.inv(scatter + 0.5 * (extra[:-1] + extra[1:]))
        spread = np.linalg.slogdet(change.information)[1] - np.linalg.slogdet(inverse)[1]
        forward, backward = (np.einsum("mij,mj->mi", inverse, each) for each in (before, after))
        first, last = (forward * before).sum(axis=1), (backward * after).sum(axis=1)
        mixed = (forward * after).sum(axis=1)
    rest = 1.0 - STEPS
    inner = first[:, None] * rest**2 + 2.0 * mixed[:, None] * (STEPS * rest) + last[:, None] * STEPS**2
    kept = signature.kept
    return np.append(inner.ravel(), last[-1])[kept], np.append(np.repeat(spread, GRID), spread[-1])[kept]
