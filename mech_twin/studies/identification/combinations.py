# SPDX-License-Identifier: Apache-2.0
"""What the channels see of the keys together: directions without effect, and the combinations that remain.

Derivatives by the logarithm of each key, cleared of what zeros, gains, lags and beginnings explain as well, are split
by singular values.  A direction whose effect is a small share of what its keys do singly may be an error of the
model alone, so it counts as not seen.  What remains of keys that such directions tie together is given
for those that were fitted and those fixed, from fits in which the fixed ones were moved (`key_dependence`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from mech_twin.measurements.blocks import Array

UNSEEN = 1.5e-3  # of the effect of its keys singly: an effect of a direction that is not to be trusted
PART = 0.1  # of a unit vector: a key with less has no part in a direction
LEAST_EFFECT = 2.0  # standard deviations that all channels together change by if a key changes by all of itself
LEAST_OF_ZERO = 1e-3
ALONE = 1e-3  # of the effect of a key that zeros, gains, lags and beginnings leave
LARGEST_DENOMINATOR = 4
NEAR_FRACTION = 0.03
PRODUCT, SUM = "product", "sum"
PRODUCT_FAVOURED = 1.5  # times as narrow a sum has to be
WIDER = 1.1  # times: a simple fraction may make an interval that much wider
UNSURE = (
    0.3  # of the effect of a direction: more difference between two step lengths, and it is of the differences alone
)


@dataclass(frozen=True)
class Sensitivity:
    """How the channels see the keys.

    Attributes
    ----------
    effects : ndarray
        Shape (keys,): norm of the derivatives by the logarithm of each key, in standard deviations.
    left : ndarray
        Shape (keys,): share of it that zeros, gains, lags and beginnings do not explain.
    unseen : ndarray
        Shape (keys, directions): unit vectors, in keys over their effects, that the channels do not see.
    jacobian : ndarray
        Shape (rows, keys): the cleared derivatives by logarithms.
    least_effects : ndarray
        Shape (keys,): less counts as none.  Of a key that is 0 nobody knows what much is.
    contradicted : bool
        Whether derivatives over two step lengths contradict each other in a direction that is seen: a motion that
        forgets nothing, or a change of the order of events.
    distinguished : bool
        Whether the runs speak against leaving out a key that derivatives hardly tell from others.
    """

    effects: Array
    left: Array
    unseen: Array
    jacobian: Array
    least_effects: Array
    contradicted: bool = False
    distinguished: bool = False

    def with_all_of(self, chosen: Sequence[int]) -> Sensitivity:
        """Return the same with the directions seen that lie among these keys, if derivatives can be trusted."""
        if self.contradicted:
            return self
        among = np.array([part <= set(chosen) for part in self.parts()], bool)
        return replace(self, unseen=self.unseen[:, ~among], distinguished=True)

    def parts(self) -> list[set[int]]:
        """Return the keys of each unseen direction."""
        return [set(np.flatnonzero(np.abs(direction) > PART).tolist()) for direction in self.unseen.T]

    def groups(self) -> list[list[int]]:
        """Return the keys that unseen directions tie together, group by group."""
        groups: list[set[int]] = []
        for part in self.parts():
            touching = [group for group in groups if group & part]
            groups = [group for group in groups if not group & part] + [part.union(*touching)]
        return [sorted(group) for group in groups]


def sensitivity(jacobian: Array, other: Array, keys: npt.NDArray[np.intp], values: Array) -> Sensitivity:
    """Return how the channels see the keys.

    Parameters
    ----------
    jacobian : ndarray
        Shape (rows, unknowns): derivatives by unknowns over their scales.
    other : ndarray
        The same from another step length of the differences.
    keys : ndarray of int
        Which of them are keys.
    values : ndarray
        Shape (keys,): the keys over their scales; that of a key that is 0 stands for its logarithm.
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


def base_keys(found: Sensitivity, among: Sequence[int]) -> list[int]:
    """Return which of the keys to estimate so that no direction is unseen; the rest stay fixed.

    Of keys that repeat each other's effect the one with the largest effect stays: one that hardly acts would have to go
    to a bound to make up for an error of the others.
    """
    kept: list[int] = []
    basis = np.zeros((found.jacobian.shape[0], 0))
    rest = {i: found.jacobian[:, i] for i in among}
    sizes = {i: float(np.linalg.norm(column)) or 1.0 for i, column in rest.items()}
    while rest:
        best = max(rest, key=lambda i: float(np.linalg.norm(rest[i])))
        column = rest.pop(best)
        size = float(np.linalg.norm(column))
        if size < UNSEEN * sizes[best]:
            continue
        kept.append(best)
        column = column / size
        basis = np.column_stack([basis, column])
        rest = {i: other - column * float(column @ other) for i, other in rest.items()}
    for part in found.parts():
        if part and part <= set(kept):  # else one of them stays as configured already, and the direction with it
            kept.remove(min(part, key=lambda i: float(np.linalg.norm(found.jacobian[:, i]))))
    return sorted(kept)


@dataclass(frozen=True)
class Combination:
    """A product of powers of keys, or a sum of their multiples, that the channels see, though none of them alone.

    Attributes
    ----------
    formula : str
        As it is read.
    form : str
        ``product`` or ``sum``.
    keys : tuple of str
        A key that was fitted, then those fixed that it is seen with.
    weights : tuple of float
        Exponents of a product, of which keys count by their magnitude but for the first; factors of a sum.
    within : dict of str to (float, float)
        Ranges of fixed keys over which the interval holds.
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
        """Return the combination at values of its keys."""
        return float(_of(self.form, np.array([values[key] for key in self.keys]), np.array(self.weights)))

    def applies(self, values: Mapping[str, float]) -> bool:
        """Return whether the fixed keys lie in the ranges over which the interval holds."""
        return all(low <= values[key] <= high for key, (low, high) in self.within.items())

    @property
    def condition(self) -> str:
        """The ranges in words."""
        return ", ".join(f"{key} from {low:.4g} to {high:.4g}" for key, (low, high) in self.within.items())


@dataclass(frozen=True)
class Family:
    """What fits as well where keys that are fixed are moved.

    Attributes
    ----------
    fitted, fixed : tuple of int
        Keys of the family: those that follow, and those that were moved.
    points : ndarray
        Shape (points, keys): values of all keys; the first is the fit.
    """

    fitted: tuple[int, ...]
    fixed: tuple[int, ...]
    points: Array


def combinations(
    families: Sequence[Family], names: Sequence[str], units: Sequence[str], half_widths: Array, largest_error: float
) -> list[Combination]:
    """Return what is seen of each fitted key together with those fixed, the surest first.

    The exponents are those under which the combination changes least within its family; what it still changes by is
    added to its interval.

    Parameters
    ----------
    families : sequence of Family
        Of groups of keys that are tied together.
    names, units
        Of all keys.
    half_widths : ndarray
        Shape (2, keys): down and up to the ends of the 95 % interval of each fitted key where the fixed ones stay.
    largest_error : float
        Half width over the size of the key above which a combination is left out.
    """
    found_forms: list[tuple[float, Combination]] = []
    for each in families:
        for lead in each.fitted:
            places = [lead, *each.fixed]
            forms = [PRODUCT, SUM] if len({units[i] for i in places}) == 1 else [PRODUCT]
            own = (each.points[:, places], [names[i] for i in places], half_widths[:, lead])
            found = [one for form in forms if (one := _combination(form, *own)) is not None]
            if found:
                best = min(found, key=lambda one: one[0] * (1.0 if one[1].form == PRODUCT else PRODUCT_FAVOURED))
                found_forms += [best] if best[0] <= largest_error and len(best[1].keys) > 1 else []
    return [one for _, one in sorted(found_forms, key=lambda one: one[0])]


def _combination(
    form: str, values: Array, names: Sequence[str], half_widths: Array
) -> tuple[float, Combination] | None:
    """Return a fitted key with fixed ones, after half its interval over the size of the key; None of no such form.

    ``values`` are those of the keys over their family, shape (points, keys), the fitted key and the fit first.
    """
    here = values[0]
    size = abs(float(here[0]))
    down, up = (half_widths if here[0] > 0.0 else half_widths[::-1]) / (size or 1.0)  # of its magnitude
    if not np.all(values * np.sign(here) > 0.0) or not np.isfinite(down + up) or down >= 1.0:
        return None
    if form == PRODUCT:
        moved, down, up = np.log(values / here), -np.log1p(-down), np.log1p(up)
    else:
        moved = (values - here) / size * np.sign(here[0])
    exact, *_ = np.linalg.lstsq(moved[:, 1:], -moved[:, 0], rcond=None)
    exact = np.where(np.abs(exact * (here[1:] / size if form == SUM else 1.0)) > PART, exact, 0.0)
    kept = np.flatnonzero([1.0, *exact])
    choices = [np.array([1.0, *map(rule, exact)])[kept] for rule in (near_fraction, _three_digits)]
    changes = [moved[:, kept] @ weights for weights in choices]
    near = np.ptp(changes[0]) + down + up <= WIDER * (np.ptp(changes[1]) + down + up)
    weights, change = (choices[0], changes[0]) if near else (choices[1], changes[1])
    least, most = float(change.min() - down), float(change.max() + up)
    estimate = _of(form, here[kept], weights)
    ends = [
        estimate * np.exp(each) if form == PRODUCT else estimate + size * np.sign(here[0]) * each
        for each in (least, most)
    ]
    chosen = tuple(names[i] for i in kept.tolist())
    within = {names[i]: (float(values[:, i].min()), float(values[:, i].max())) for i in range(1, len(names))}
    combination = Combination(
        *(_formula(form, chosen, weights, here[kept]), form, chosen, tuple(map(float, weights)), estimate),
        *(float(min(ends)), float(max(ends)), within),
    )
    return 0.5 * (most - least), combination


def _of(form: str, values: Array, weights: Array) -> float:
    if form == SUM:
        return float(values @ weights)
    return float(values[0] * np.prod(np.abs(values[1:]) ** weights[1:]))


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


def near_fraction(exponent: float) -> float:
    """Return a simple fraction near an exponent, or the exponent to three digits."""
    simple = float(Fraction(exponent).limit_denominator(LARGEST_DENOMINATOR))
    return simple if abs(simple - exponent) < NEAR_FRACTION else _three_digits(exponent)


def _three_digits(exponent: float) -> float:
    return round(float(exponent), 3)
