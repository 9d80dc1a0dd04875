# SPDX-License-Identifier: Apache-2.0
"""What the channels see of the keys together: directions without effect, and the combinations that remain.

Derivatives by the logarithm of each key, cleared of what zeros, gains, lags and beginnings explain as well, are split
by singular values.  A direction whose effect is a small share of what its keys do singly cannot be told from an error
of the model of that share, so it counts as not seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
UNSURE = (
    0.3  # of the effect of a direction: more difference between two step lengths, and it is of the differences alone
)


@dataclass(frozen=True)
class Sight:
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
    """

    effects: Array
    left: Array
    unseen: Array
    jacobian: Array
    least_effects: Array

    def groups(self) -> list[list[int]]:
        """Return the keys that unseen directions tie together, group by group."""
        groups: list[set[int]] = []
        for direction in self.unseen.T:
            part = set(np.flatnonzero(np.abs(direction) > PART).tolist())
            touching = [group for group in groups if group & part]
            groups = [group for group in groups if not group & part] + [part.union(*touching)]
        return [sorted(group) for group in groups]


def sight(jacobian: Array, other: Array, keys: npt.NDArray[np.intp], values: Array) -> Sight:
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
    unseen = np.zeros((len(keys), 0))
    if len(seen):
        scaled, differing = own[:, seen] / remaining[seen], (own - again)[:, seen] / remaining[seen]
        _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
        unsure = np.linalg.norm(differing @ directions.T, axis=0) > UNSURE * singular
        lost = directions[(singular < UNSEEN * np.sqrt(len(seen))) | unsure]
        unseen = np.zeros((len(keys), len(lost)))
        unseen[seen] = lost.T
    return Sight(effects, left, unseen, own, least)


def base_keys(found: Sight, among: Sequence[int]) -> list[int]:
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
    for direction in found.unseen.T:
        part = set(np.flatnonzero(np.abs(direction) > PART).tolist())
        if part and part <= set(kept):  # else one of them stays as configured already, and the direction with it
            kept.remove(min(part, key=lambda i: float(np.linalg.norm(found.jacobian[:, i]))))
    return sorted(kept)


@dataclass(frozen=True)
class Combination:
    """A product of powers of keys that the channels see, though none of its keys alone."""

    formula: str
    keys: tuple[str, ...]
    exponents: tuple[float, ...]
    estimate: float
    low_95: float
    high_95: float

    def of(self, values: Mapping[str, float]) -> float:
        """Return the combination at values of its keys."""
        return float(np.prod([values[key] ** power for key, power in zip(self.keys, self.exponents, strict=True)]))


def combinations(
    found: Sight, names: Sequence[str], values: Array, largest_error: float, share: float
) -> list[Combination]:
    """Return what is seen of each group of keys that are tied together, the surest first.

    Parameters
    ----------
    found : Sight
        How the channels see the keys.
    names, values
        Of the keys.
    largest_error : float
        Standard error of its logarithm above which a combination is not told.
    share : float
        Half width of the 95 % interval over the standard error that the derivatives alone give.
    """
    told = []
    for group in found.groups():
        if any(values[i] <= 0.0 for i in group):
            continue
        _, singular, directions = np.linalg.svd(_cleared(found, group), full_matrices=False)
        for size, direction in zip(singular, directions, strict=True):
            if size * largest_error < 1.0 or _is_unseen(found, group, direction):
                continue
            told.append(_combination([names[i] for i in group], values[group], direction, share / size))
    return told


def _cleared(found: Sight, group: Sequence[int]) -> Array:
    """Return the derivatives by the keys of a group, less what other keys that are seen explain as well."""
    rest = [i for i in range(len(found.effects)) if i not in group and found.effects[i] >= found.least_effects[i]]
    own, others = found.jacobian[:, group], found.jacobian[:, rest]
    sizes = np.linalg.norm(others, axis=0)
    others = others[:, sizes > 0.0] / sizes[sizes > 0.0]
    if not others.shape[1]:
        return own
    basis, singular, _ = np.linalg.svd(others, full_matrices=False)
    basis = basis[:, singular > UNSEEN]
    return np.asarray(own - basis @ (basis.T @ own))


def _is_unseen(found: Sight, group: Sequence[int], direction: Array) -> bool:
    effect = float(np.linalg.norm(found.jacobian[:, group] @ direction))
    singly = float(np.linalg.norm(np.linalg.norm(found.jacobian[:, group], axis=0) * direction))
    return effect < 10.0 * UNSEEN * singly


def _combination(names: Sequence[str], values: Array, direction: Array, width: float) -> Combination:
    largest = int(np.argmax(np.abs(direction)))
    exponents = direction / direction[largest]
    width = width / abs(float(direction[largest]))
    kept = [i for i in range(len(names)) if abs(exponents[i]) > PART / 2.0]
    rounded = [_near_fraction(float(exponents[i])) for i in kept]
    value = float(np.exp(np.sum(np.array(rounded) * np.log(values[kept]))))
    formula = " ".join(_power(names[i], e) for i, e in zip(kept, rounded, strict=True))
    chosen = tuple(names[i] for i in kept)
    low, high = value * float(np.exp(-width)), value * float(np.exp(width))
    return Combination(formula, chosen, tuple(rounded), value, low, high)


def _power(name: str, exponent: float) -> str:
    return name if exponent == 1.0 else f"{name}^{exponent:.3g}"


def _near_fraction(exponent: float) -> float:
    simple = float(Fraction(exponent).limit_denominator(LARGEST_DENOMINATOR))
    return simple if abs(simple - exponent) < NEAR_FRACTION else round(exponent, 3)
