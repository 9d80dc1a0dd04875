# SPDX-License-Identifier: Apache-2.0
"""Which fault explains the features: signatures by size, a generalised likelihood ratio over all of them.

From the innovations after an onset the change delta of the features is estimated with its information matrix M; what
happens while the machine settles is left free.  A fault j of size s changes them by
r_j(s), computed by roll-outs and interpolated over s.  What it leaves open is::

    open_j = min over s of (delta - r_j(s))' M (delta - r_j(s)),       all there is:  delta' M delta

A model is never exact: ``MODEL_SHARE`` of what each feature does may be off, which is added to the scatter of delta
before anything is compared, and so much of the whole may stay open too.
Candidates are all faults that leave little more open than the best; one candidate is a name, several are a group,
none that leaves little enough open is ``unknown``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import Baseline

MODEL_SHARE = 0.15  # of an effect, by which the computed one may be off
UNKNOWN_CHANCE = 1e-4  # that the right fault leaves so much open by noise alone
RIVAL_CHANCE = 1e-3  # that the right fault leaves so much more open than another
INTERVAL = 3.84  # 95 % point of chi-square of one degree
GRID = 40  # sizes between two that were computed


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
    """

    name: str
    meaning: str
    unit: str
    sizes: Array
    responses: Array
    key: str = ""

    @cached_property
    def fine(self) -> tuple[Array, Array]:
        """Return finely spaced sizes, 0 left out, and the responses at them."""
        steps = np.linspace(0.0, 1.0, GRID, endpoint=False)
        sizes = np.append((self.sizes[:-1, None] + np.diff(self.sizes)[:, None] * steps).ravel(), self.sizes[-1])
        sizes = sizes[np.abs(sizes) > 1e-12 * np.abs(self.sizes).max()]
        responses = np.array([np.interp(sizes, self.sizes, column) for column in self.responses.T]).T
        return sizes, responses

    def record(self) -> dict[str, Any]:
        """Return the signature as JSON values."""
        told = {"name": self.name, "meaning": self.meaning, "unit": self.unit, "key": self.key}
        return {**told, "sizes": self.sizes.tolist(), "responses": self.responses.tolist()}


def signature_of_record(record: Mapping[str, Any]) -> Signature:
    """Return the signature of its record."""
    sizes, responses = (np.array(record[key], dtype=np.float64) for key in ("sizes", "responses"))
    return Signature(record["name"], record["meaning"], record["unit"], sizes, responses, record["key"])


class Candidate(NamedTuple):
    """A fault that explains what is seen: its size with the 95 % interval, and the share of the effect left open."""

    name: str
    size: float
    low_95: float
    high_95: float
    unit: str
    open_share: float


class Change(NamedTuple):
    """An estimated change of the features, shape (d,), and its information matrix (d, d)."""

    delta: Array
    information: Array

    @property
    def weight(self) -> float:
        """Chi-square of the change, of d degrees where nothing has changed."""
        return float(self.delta @ self.information @ self.delta)

    @property
    def lasts(self) -> bool:
        """Whether there is a change at all, beyond what noise makes."""
        return self.weight > float(chi2.isf(UNKNOWN_CHANCE, len(self.delta)))


def estimated_change(baseline: Baseline, innovations: Array, settling: int) -> Change | None:
    """Return the change since the onset, the first row of the innovations (n, d); None while it is settling.

    Two independent looks at a change delta that is complete after s cycles, with a_i and psi_i the coefficients and the
    impulse response of the autoregression of a feature::

        sum over i = 0 .. s of psi_i e_(s-i) = delta + error of the forecast from before the onset
        e_t = (1 - sum of a_i) delta + noise,      t >= s + max(p, 1)
    """
    begin = settling + max(baseline.order, 1)
    later = innovations[begin:]
    if not len(later):
        return None
    impulse = impulse_response(baseline, settling)
    inverse = np.linalg.inv(baseline.covariance)
    forecast = np.linalg.inv(baseline.covariance * (impulse.T @ impulse))
    offset = (impulse * innovations[settling::-1]).sum(axis=0)
    steady = 1.0 - baseline.coefficients.sum(axis=0)
    information = forecast + len(later) * (steady[:, None] * inverse * steady)
    right = forecast @ offset + steady * (inverse @ later.sum(axis=0))
    return Change(np.linalg.solve(information, right), information)


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
    return Change(change.delta, np.linalg.inv(scatter))


def candidates(measured: Change, signatures: Sequence[Signature]) -> tuple[Candidate, ...]:
    """Return the faults that explain a change, the best first; none where it is unknown."""
    change = with_model_error(measured)
    tolerated = MODEL_SHARE**2 * change.weight
    fits = [(_fit(change, signature, tolerated), signature) for signature in signatures]
    fits.sort(key=lambda fit: fit[0][0])
    if not fits:
        return ()
    width = len(change.delta)
    least = fits[0][0][0]
    bound = float(chi2.isf(UNKNOWN_CHANCE, max(width - 1, 1))) + tolerated
    rivals = least + float(chi2.isf(RIVAL_CHANCE, 1)) + tolerated
    return tuple(
        Candidate(signature.name, size, low, high, signature.unit, left / max(change.weight, 1e-300))
        for (left, size, low, high), signature in fits
        if left <= min(bound, rivals) and left < change.weight
    )


def _fit(change: Change, signature: Signature, tolerated: float) -> tuple[float, float, float, float]:
    """Return what a fault leaves open at its best size, that size and its interval.

    The interval is that of noise, widened by what the model may be off.
    """
    sizes, responses = signature.fine
    left = change.delta - responses
    open_left = ((left @ change.information) * left).sum(axis=1)
    best = int(np.argmin(open_left))
    wide = INTERVAL + min(tolerated, open_left[best])
    inside = sizes[open_left <= open_left[best] + wide]
    return float(open_left[best]), float(sizes[best]), float(inside.min()), float(inside.max())
