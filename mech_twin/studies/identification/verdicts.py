# SPDX-License-Identifier: Apache-2.0
"""Sensitivity of the channels to the keys, and the verdict on each key after a fit, with its reason.

The derivatives by the logarithm of each key are projected orthogonally to the effects of zeros, gains, lags and start
times, then decomposed by singular values.  A direction with a small share of its keys' single effects may be due to
model errors alone, so it counts as unobservable.

Keys that are not identifiable alone may be so in combination: as a product of powers, or as a weighted sum.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import inf
from typing import Annotated

import numpy as np
import numpy.typing as npt

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.staged_fit import Search

LARGEST_ERROR = 0.5  # half width of the interval over the key's value, at most, for a combination to be reported
LEAST_WEIGHT = 0.1  # a key with a smaller weight is left out
LARGEST_DENOMINATOR = 4
PRODUCT, SUM = "product", "sum"
PRODUCT_FAVOURED = 1.5  # factor by which a sum's interval must be narrower than a product's
WIDER = 1.1  # factor by which simple fractions as weights may widen an interval
UNSEEN = 1.5e-3  # of the single effects of its keys: a smaller effect of a direction is not reliable
PART = 0.1  # of a unit vector: a key with a smaller component is not part of a direction
LEAST_EFFECT = 2.0  # standard deviations of all channels together for a change of a key by its own value
LEAST_OF_ZERO = 1e-3
ALONE = 1e-3  # share of a key's effect that zeros, gains, lags and start times cannot explain
UNSURE = 0.3  # of an effect: if two step lengths differ by more, it is an artefact of the differences
IDENTIFIED, ONE_SIDED, COMBINATION = "identified", "one-sided", "only_in_combination"
NOT_EXCITED, AT_BOUND = "not_excited", "at_bound"
MODEL_ERROR, NOT_CONVERGED = "model_error", "not_converged"
WIDEST = 0.5  # half width over value: a wider interval gives only the order of magnitude
NEAR_BOUND = 1e-6
Low = Annotated[float, -inf]  # an open end, which JSON has as null
High = Annotated[float, inf]


@dataclass(frozen=True)
class Combination:
    """A product of powers of keys, or a weighted sum, that is identifiable although none of the keys is alone.

    Attributes
    ----------
    form : str
        ``product`` or ``sum``.
    keys : tuple of str
        A fitted key, then the fixed keys that it is tied to.
    weights : tuple of float
        Exponents of a product, of the magnitudes of all keys but the first; factors of a sum.
    within : dict of str to (float, float)
        Ranges of the fixed keys for which the interval is valid.
    """

    formula: str
    form: str
    keys: tuple[str, ...]
    weights: tuple[float, ...]
    estimate: float
    low_95: Low
    high_95: High
    within: dict[str, tuple[Low, High]]

    def of(self, values: Mapping[str, float]) -> float:
        """Return the value of the combination at values of its keys."""
        return _of(self.form, np.array([values[key] for key in self.keys]), np.array(self.weights))

    def applies(self, values: Mapping[str, float]) -> bool:
        """Return whether the fixed keys lie in the ranges for which the interval is valid."""
        return all(low <= values[key] <= high for key, (low, high) in self.within.items())

    @property
    def condition(self) -> str:
        """The ranges as text."""
        return ", ".join(f"{key} from {low:.4g} to {high:.4g}" for key, (low, high) in self.within.items())


@dataclass(frozen=True)
class Family:
    """Fits of equal quality: indices of the refitted and of the moved keys, and the values of all keys in each.

    ``points`` has the shape (points, keys); the first is the fit.
    """

    fitted: tuple[int, ...]
    fixed: tuple[int, ...]
    points: Array


def combinations(
    families: Sequence[Family], names: Sequence[str], units: Sequence[str], half_widths: Array
) -> list[Combination]:
    """Return the identifiable combination of each fitted key with fixed ones, the most precise first.

    The weights minimise the change of the combination within its family; the remaining change is added to its interval.

    Parameters
    ----------
    families : sequence of Family
        One family for each group of keys that are tied together.
    half_widths : ndarray
        Shape (2, keys): distances down and up to the ends of the 95 % interval of each fitted key, others fixed.
    """
    stated: list[tuple[float, Combination]] = []
    for each in families:
        for lead in each.fitted:
            places = [lead, *each.fixed]
            forms = {PRODUCT: 1.0, SUM: PRODUCT_FAVOURED} if len({units[i] for i in places}) == 1 else {PRODUCT: 1.0}
            own = each.points[:, places], [names[i] for i in places], half_widths[:, lead]
            found = {form: one for form in forms if (one := _stated(form, *own)) is not None}
            if found:
                width, best = found[min(found, key=lambda form: forms[form] * found[form][0])]
                stated += [(width, best)] if width <= LARGEST_ERROR and len(best.keys) > 1 else []
    return [one for _, one in sorted(stated, key=lambda one: one[0])]


def _stated(form: str, values: Array, names: Sequence[str], half_widths: Array) -> tuple[float, Combination] | None:
    """Return the relative half width and the combination of a fitted key with fixed ones; None if impossible.

    ``values`` of the keys have the shape (points, keys): first row the fit, first column the fitted key.
    """
    here, sign = values[0], float(np.sign(values[0, 0]))
    size = abs(float(here[0])) or 1.0
    down, up = half_widths[:: int(sign) or 1] / size  # of its magnitude
    if not np.all(values * np.sign(here) > 0.0) or not np.isfinite(down + up) or down >= 1.0:
        return None
    if form == PRODUCT:
        moved, reach = np.log(values / here), np.log1p([-down, up])
    else:
        moved, reach = (values - here) / size * sign, np.array([-down, up])
    exact, *_ = np.linalg.lstsq(moved[:, 1:], -moved[:, 0], rcond=None)
    exact = np.where(np.abs(exact * (here[1:] / size if form == SUM else 1.0)) > LEAST_WEIGHT, exact, 0.0)
    kept = np.flatnonzero([1.0, *exact])
    spans = []
    digits = [round(weight, 3) for weight in exact.tolist()]
    simple = [float(Fraction(weight).limit_denominator(LARGEST_DENOMINATOR)) for weight in exact.tolist()]
    for rule in ([one or other for one, other in zip(simple, digits, strict=True)], digits):
        weights = np.array([1.0, *rule])[kept]
        change = moved[:, kept] @ weights
        spans.append((weights, np.array([change.min(), change.max()]) + reach))
    weights, span = spans[0] if np.ptp(spans[0][1]) <= WIDER * np.ptp(spans[1][1]) else spans[1]
    estimate = _of(form, here[kept], weights)
    low, high = sorted((estimate * np.exp(span) if form == PRODUCT else estimate + size * sign * span).tolist())
    chosen = tuple(names[i] for i in kept.tolist())
    within = {name: (float(of.min()), float(of.max())) for name, of in zip(names[1:], values.T[1:], strict=True)}
    formula = _formula(form, chosen, weights, here[kept])
    combination = Combination(formula, form, chosen, tuple(weights.tolist()), estimate, low, high, within)
    return 0.5 * float(np.ptp(span)), combination


def _of(form: str, values: Array, weights: Array) -> float:
    return float(values @ weights if form == SUM else values[0] * np.prod(np.abs(values[1:]) ** weights[1:]))


def _formula(form: str, names: Sequence[str], weights: Array, values: Array) -> str:
    words = [names[0]]
    for name, weight, value in zip(names[1:], weights[1:], values[1:], strict=True):
        if form == SUM:
            factor = "" if abs(weight) == 1.0 else f"{abs(weight):.3g} "
            words.append(f"{'-' if weight < 0.0 else '+'} {factor}{name}")
        else:
            power = "" if weight == 1.0 else f"^{weight:.3g}"
            words.append((name if value > 0.0 else f"|{name}|") + power)
    return " ".join(words)


@dataclass(frozen=True)
class Sensitivity:
    """Sensitivity of the channels to the keys.

    Attributes
    ----------
    effects : ndarray
        Shape (keys,): norm of the derivatives by the logarithm of each key, in standard deviations.
    left : ndarray
        Shape (keys,): share of it that zeros, gains, lags and start times do not explain.
    unseen : ndarray
        Shape (keys, directions): unobservable unit vectors, in keys scaled by their effects.
    jacobian : ndarray
        Shape (rows, keys): the projected derivatives by logarithms.
    least_effects : ndarray
        Shape (keys,): a smaller effect counts as none.  It differs for a key of 0, which has no scale of its own.
    contradicted : bool
        Whether derivatives over two step lengths disagree in an observable direction: a motion without decay, or a
        change of the order of events.
    distinguished : bool
        Whether the runs reject leaving out a key that derivatives hardly distinguish from others.
    """

    effects: Array
    left: Array
    unseen: Array
    jacobian: Array
    least_effects: Array
    contradicted: bool = False
    distinguished: bool = False

    @property
    def acting(self) -> npt.NDArray[np.bool_]:
        """Whether each key has an effect, shape (keys,)."""
        return self.effects >= self.least_effects

    def with_all_of(self, chosen: Sequence[int]) -> Sensitivity:
        """Return the same with the directions among these keys observable, unless derivatives are unreliable."""
        if self.contradicted:
            return self
        among = np.array([part <= set(chosen) for part in self.parts()], bool)
        return replace(self, unseen=self.unseen[:, ~among], distinguished=True)

    def parts(self) -> list[set[int]]:
        """Return the keys of each unobservable direction."""
        return [set(np.flatnonzero(np.abs(direction) > PART).tolist()) for direction in self.unseen.T]

    def groups(self) -> list[list[int]]:
        """Return the groups of keys that unobservable directions tie together."""
        groups: list[set[int]] = []
        for part in self.parts():
            touching = [group for group in groups if group & part]
            groups = [group for group in groups if not group & part] + [part.union(*touching)]
        return [sorted(group) for group in groups]

    def estimated(self, among: Sequence[int]) -> list[int]:
        """Return which of these keys to estimate so that no direction is unobservable; the rest stay fixed.

        Of keys with the same effect, the one with the largest effect is kept: one with a small effect would move to a
        bound to compensate for an error of the others.
        """
        kept: list[int] = []
        rest = {i: self.jacobian[:, i] for i in among if self.acting[i]}
        while rest:
            best = max(rest, key=lambda i: float(np.linalg.norm(rest[i])))
            column = rest.pop(best)
            size = float(np.linalg.norm(column))
            if size > UNSEEN * float(np.linalg.norm(self.jacobian[:, best])):
                kept.append(best)
                rest = {i: other - column * float(column @ other) / size**2 for i, other in rest.items()}
        for part in self.parts():
            if part and part <= set(kept):  # else one of them is already fixed, and the direction with it
                kept.remove(min(part, key=lambda i: float(np.linalg.norm(self.jacobian[:, i]))))
        return sorted(kept)


def sensitivity(jacobian: Array, other: Array, keys: npt.NDArray[np.intp], values: Array) -> Sensitivity:
    """Return the sensitivity of the channels to the keys.

    Parameters
    ----------
    jacobian : ndarray
        Shape (rows, unknowns): derivatives by scaled unknowns.
    other : ndarray
        The same from another step length of the differences.
    keys : ndarray of int
        Indices of the keys among the unknowns.
    values : ndarray
        Shape (keys,): the keys in scales; for a key of 0, its scale replaces the logarithm.
    """
    zero = values == 0.0
    logs = np.where(zero, 1.0, np.abs(values))
    own, again = jacobian[:, keys] * logs, other[:, keys] * logs
    others = np.delete(jacobian, keys, axis=1)
    others = others[:, np.linalg.norm(others, axis=0) > 0.0]
    effects = np.linalg.norm(own, axis=0)
    if others.shape[1]:
        basis, _ = np.linalg.qr(others / np.linalg.norm(others, axis=0))
        own, again = own - basis @ (basis.T @ own), again - basis @ (basis.T @ again)
    remaining = np.linalg.norm(own, axis=0)
    left = remaining / np.where(effects > 0.0, effects, 1.0)
    least = np.where(zero, LEAST_OF_ZERO, LEAST_EFFECT)
    seen = np.flatnonzero((effects >= least) & (left > ALONE))
    unseen, contradicted = np.zeros((len(keys), 0)), False
    if len(seen):
        scaled, differing = own[:, seen] / remaining[seen], (own - again)[:, seen] / remaining[seen]
        _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
        unsure = np.linalg.norm(differing @ directions.T, axis=0) > UNSURE * singular
        small = singular < UNSEEN * np.sqrt(len(seen))
        contradicted = bool((unsure & ~small).any())
        lost = directions[small | unsure]
        unseen = np.zeros((len(keys), len(lost)))
        unseen[seen] = lost.T
    return Sensitivity(effects, left, unseen, own, least, contradicted)


@dataclass(frozen=True)
class KeyVerdict:
    """A key with its estimate, interval, verdict and reason."""

    key: str
    before: float
    estimate: float
    standard_error: float
    low_95: Low
    high_95: High
    verdict: str
    reason: str


@dataclass(frozen=True)
class KeyEvidence:
    """Evidence for the verdicts; arrays have one entry per key, in SI units; half widths have two rows: down, up."""

    names: Sequence[str]
    before: Array
    estimates: Array
    errors: Array
    half_widths: Array
    bounds: Array
    scales: Array
    sensitivity: Sensitivity
    fixed: frozenset[int]
    refuted: tuple[str, str] | None
    combinations: Sequence[Combination] = ()

    def verdicts(self) -> list[KeyVerdict]:
        """Return the verdict on each key."""
        return [self._verdict(i) for i in range(len(self.names))]

    @cached_property
    def _formulas(self) -> dict[str, str]:
        """What is identifiable of each key in combination: of a fitted key its own, of others the most precise."""
        whole = [(each.keys, f"{each.formula}, for {each.condition}") for each in self.combinations]
        found = {key: formula for keys, formula in reversed(whole) for key in keys}
        return found | {keys[0]: formula for keys, formula in whole}

    def _verdict(self, i: int) -> KeyVerdict:
        name, estimate = self.names[i], float(self.estimates[i])
        down, up = self.half_widths[:, i].tolist()
        verdict, reason = self._word(i)
        if verdict in (NOT_EXCITED, COMBINATION) and i in self.fixed:
            down = up = np.inf
        low, high = max(estimate - down, float(self.bounds[0, i])), min(estimate + up, float(self.bounds[1, i]))
        return KeyVerdict(name, float(self.before[i]), estimate, float(self.errors[i]), low, high, verdict, reason)

    def _word(self, i: int) -> tuple[str, str]:
        """Return the verdict on a key and its reason."""
        unseen = self._not_seen_alone(i)
        # beside a refuted fit, whose residuals count as noise, any effect may look small
        if unseen is not None and (self.refuted is None or self.sensitivity.effects[i] < LEAST_OF_ZERO):
            return unseen
        if self.refuted is not None:
            return self.refuted
        estimate = float(self.estimates[i])
        low, high = self.bounds[:, i].tolist()
        near = NEAR_BOUND * max(abs(estimate), float(self.scales[i]))
        if estimate - low < near or high - estimate < near:
            return AT_BOUND, f"the fit stopped at the bound {low if estimate - low < near else high:.6g}"
        down, up = self.half_widths[:, i].tolist()
        if np.isfinite(down) != np.isfinite(up):
            end = f"at least {estimate - down:.6g}" if np.isfinite(down) else f"at most {estimate + up:.6g}"
            return ONE_SIDED, f"{end}; to the other side the likelihood profile is flat"
        return self._by_width(i, estimate, max(down, up))

    def _by_width(self, i: int, estimate: float, half: float) -> tuple[str, str]:
        """Return the verdict by the width of the interval."""
        if not np.isfinite(half):
            return NOT_EXCITED, "the likelihood profile is flat on both sides"
        if half > WIDEST * abs(estimate):
            if self.before[i] == 0.0:
                return NOT_EXCITED, f"not significantly different from 0: 95 % within {half:.3g}"
            return NOT_EXCITED, f"95 % within {half:.3g} on either side, more than half its value"
        return IDENTIFIED, "observable, with an interval within half its value"

    def _not_seen_alone(self, i: int) -> tuple[str, str] | None:
        """Return the verdict on a key without effect, or without an effect of its own; else None."""
        sensitivity = self.sensitivity
        if not sensitivity.acting[i]:
            return NOT_EXCITED, "no channel changes by more than its noise if the key changes by all of itself"
        if sensitivity.left[i] < ALONE:
            return COMBINATION, "its effect equals that of zeros, gains, lags or the start state of the run"
        tied = next((group for group in sensitivity.groups() if i in group), None)
        if tied is None:
            return None
        partners = ", ".join(self.names[j] for j in tied if j != i)
        if not self.fixed & set(tied):
            return COMBINATION, f"its effect differs from that of {partners} by less than the error of the derivatives"
        formula = self._formulas.get(self.names[i])
        seen = f": observable is {formula}" if formula else ""
        return COMBINATION, f"its effect on the channels equals that of {partners}{seen}"


def refuted(off: str | None, search: Search, cause: str = "") -> tuple[str, str] | None:
    """Return the common verdict and reason if noise does not explain the residuals; None if it does.

    If a cause explains them, or most starts ended in the best minimum, the model is incomplete; else the search may
    have missed the minimum.
    """
    if off is None:
        return None
    if cause:
        return MODEL_ERROR, off + cause
    seen = f"{search.agreeing} of {search.starts} starts ended in the best of {search.valleys} local minima"
    if search.agreed:
        return MODEL_ERROR, f"{off}, and {seen}: the model lacks something"
    return NOT_CONVERGED, f"{off}, and {seen}: the fit has not found the keys"
