# SPDX-License-Identifier: Apache-2.0
"""Identifiable combinations of keys that are not identifiable alone: products of powers, or weighted sums."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from mech_twin.measurements.blocks import Array

LARGEST_ERROR = 0.5  # half width of the interval over the key's value, at most, for a combination to be reported
LEAST_WEIGHT = 0.1  # a key with a smaller weight is left out
LARGEST_DENOMINATOR = 4
PRODUCT, SUM = "product", "sum"
PRODUCT_FAVOURED = 1.5  # factor by which a sum's interval must be narrower than a product's
WIDER = 1.1  # factor by which simple fractions as weights may widen an interval


@dataclass(frozen=True)
class Combination:
    """A product of powers of keys, or a weighted sum, that is identifiable although none of the keys is alone.

    Attributes
    ----------
    formula : str
        Formula as text.
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
    low_95: float
    high_95: float
    within: dict[str, tuple[float, float]]

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
    """Fits of equal quality at other values of the fixed keys.

    Attributes
    ----------
    fitted, fixed : tuple of int
        Indices of keys: those that were refitted, and those that were moved.
    points : ndarray
        Shape (points, keys): values of all keys; the first is the fit.
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
    names, units
        Names and units of all keys.
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
    for rule in (_simple, _three_digits):
        weights = np.array([1.0, *map(rule, exact)])[kept]
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


def _simple(weight: float) -> float:
    return float(Fraction(weight).limit_denominator(LARGEST_DENOMINATOR)) or _three_digits(weight)


def _three_digits(weight: float) -> float:
    return round(float(weight), 3)
