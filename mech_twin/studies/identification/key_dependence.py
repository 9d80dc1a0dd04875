# SPDX-License-Identifier: Apache-2.0
"""How the keys of a fit follow keys that are fixed: what fits as well, found by fits and not by derivatives.

Of keys that repeat each other's effect some stay as configured.  Here each of them is moved by up to half of itself,
alone and all together, and the others are fitted anew.  Where the misfit rises by more than derivatives predict the
runs speak against the move; it is then made shorter, and nothing is said of what lies beyond.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.combinations import near_fraction
from mech_twin.studies.identification.intervals import FIXED_OFF, inverse_information
from mech_twin.studies.identification.profile_likelihood import Mask, Walk

MOST_FIXED = 3  # keys of a family: all corners of their ranges are fitted
SHARES = (0.5, 1.0)  # of the way to the end of a range
SHORTER = (1.0, 0.5, 0.25)  # of a range whose end is not reached
MORE_RISE = 2.0  # times the root of the rise that derivatives predict
SLOPES = 4  # times that derivatives are taken at a point
FARTHEST = (-2.0, 2.0)  # logarithms by which a key may follow


def family(walk: Walk, fixed: Sequence[int], fitted: Mask, bounds: Array) -> Array | None:
    """Return what fits as well where fixed keys are moved; None where they cannot be, or are too many.

    Parameters
    ----------
    walk : Walk
        About the fit, its first unknowns the free keys.
    fixed : sequence of int
        Places of the keys to move.
    fitted : ndarray of bool
        Shape (unknowns,): those that follow.
    bounds : ndarray
        Shape (2, keys), over the scales.

    Returns
    -------
    ndarray or None
        Shape (points, unknowns), over the scales; the first is the fit.
    """
    if not 0 < len(fixed) <= MOST_FIXED or np.any(walk.x[list(fixed)] == 0.0):
        return None
    steps, values = _Steps(walk, list(fixed), fitted), walk.x[list(fixed)]
    for share in SHORTER:
        away = share * FIXED_OFF * np.abs(values)
        points = steps.over(np.clip([values - away, values + away], bounds[0, list(fixed)], bounds[1, list(fixed)]))
        if points is not None:
            return np.array([walk.x, *points])
    return None


class _Steps:
    """Fits with fixed keys put elsewhere."""

    def __init__(self, walk: Walk, fixed: list[int], fitted: Mask) -> None:
        self.walk, self.fixed, self.fitted = walk, fixed, fitted
        own, moved = walk.jacobian[:, fitted], walk.jacobian[:, fixed]
        self.slopes = -inverse_information(own) @ (own.T @ moved)  # of the fitted unknowns by the fixed keys
        self.left = moved + own @ self.slopes  # of the rows by the fixed keys, the others following

    def over(self, ends: Array) -> list[Array] | None:
        """Return the fits on the way to either end of each range, and in all corners; None where one is missed.

        ``ends`` has the shape (2, keys).
        """
        found: list[Array] = []
        aside: list[list[Array]] = [[] for _ in self.fixed]
        for place, side in product(range(len(self.fixed)), range(2)):
            way = self._side(place, ends[side, place])
            if way is None:
                return None
            found += way
            aside[place] += way[-1:]
        for corner in product(*aside) if len(aside) > 1 else ():
            values = np.array([x[i] for x, i in zip(corner, self.fixed, strict=True)])
            met = self._fit([self.walk.x, self._together(corner)], values)
            if met is None:
                return None
            found.append(met)
        return found

    def _side(self, place: int, end: float) -> list[Array] | None:
        """Return the fits on the way of one fixed key to an end, none if it stands there; None where one is missed."""
        start = self.walk.x[self.fixed]
        way = [self.walk.x]
        for share in SHARES if end != start[place] else ():
            values = start.copy()
            values[place] += share * (end - start[place])
            met = self._fit(way, values)
            if met is None:
                return None
            way.append(met)
        return way[1:]

    def _together(self, fits: Sequence[Array]) -> Array:
        """Return where fits lead together that are each aside in one fixed key: their powers, or their distances."""
        here = self.walk.x
        straight = here + sum(x - here for x in fits)
        shares = np.array([np.where(here * x > 0.0, x, np.nan) / np.where(here == 0.0, 1.0, here) for x in fits])
        powers = here * np.prod(shares, axis=0)
        return np.where(np.isfinite(powers), powers, straight)

    def _fit(self, way: Sequence[Array], values: Array) -> Array | None:
        """Return what fits best with the fixed keys at values, from fits on the way there; None if it does not fit."""
        x, most = min(self._predicted(way, values), key=self.walk.cost), self._most(values)
        left = self._rise(x)  # nothing where the keys repeat each other exactly
        for _ in range(SLOPES):
            if self.walk.settled(left) and self._rise(x) <= most:
                break
            x, left, _ = self.walk.descended(x, self.fitted, self.walk.slopes(x))
        return x if self._rise(x) <= most else None

    def _predicted(self, way: Sequence[Array], values: Array) -> Iterator[Array]:
        """Yield where the other unknowns may be: by derivatives, or as on the way; straight on, or by powers."""
        here, now = way[0], way[-1]
        moved, size = values - here[self.fixed], np.where(here == 0.0, 1.0, here)
        powers = self.slopes * here[self.fixed] / size[self.fitted, None]
        rise = np.log(values / here[self.fixed])
        near = np.vectorize(near_fraction, otypes=[float])(powers)
        found = [here[self.fitted] + self.slopes @ moved]
        found += [here[self.fitted] * np.exp(np.clip(each @ rise, *FARTHEST)) for each in (powers, near)]
        if len(way) > 1:
            share = float(moved @ moved) / float(moved @ (now - here)[self.fixed])
            found.append((here + share * (now - here))[self.fitted])
            logs = np.log(np.where(here * now > 0.0, now / size, 1.0))
            share = float(rise @ rise) / float(rise @ logs[self.fixed])
            found.append(np.where(here == 0.0, now, here * np.exp(np.clip(share * logs, *FARTHEST)))[self.fitted])
        for each in found:
            x = now.copy()
            x[self.fitted], x[self.fixed] = each, values
            yield np.asarray(np.clip(x, self.walk.low, self.walk.high))

    def _rise(self, x: Array) -> float:
        return self.walk.cost(x) - self.walk.least

    def _most(self, values: Array) -> float:
        """Return the rise above which the runs speak against the fixed keys' values."""
        rows = self.left @ (values - self.walk.x[self.fixed])
        return (float(np.sqrt(self.walk.threshold)) + MORE_RISE * float(np.linalg.norm(rows))) ** 2
