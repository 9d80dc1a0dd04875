# SPDX-License-Identifier: Apache-2.0
"""Refits with some unknowns held at other values: likelihood profiles of keys, and families of equal fits.

A profile moves one key until the cost has risen by ``t^2`` times the variance of the residuals (Raue et al. 2009,
doi:10.1093/bioinformatics/btp358).  It is computed for keys whose cost is not a parabola at the ends of the interval,
so that derivatives do not give it.  A family moves fixed keys, whose effect others repeat, by up to half of their
values; where the cost rises by more than derivatives predict, the runs reject the move.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import optimize, stats

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.fit_problem import KEY
from mech_twin.studies.identification.fit_quality import Fitted
from mech_twin.studies.identification.intervals import FIXED_OFF, Linearised, inverse_information
from mech_twin.studies.identification.staged_fit import LOSS_SCALE, Progress, brought_on, quiet, robust_weights
from mech_twin.studies.spreading import spread

LEAST_RISE, MOST_RISE = 0.6, 1.6  # times the rise of a parabola: outside, a profile is computed
WEAK = 0.03  # share of a key's effect that is its own: with less, a profile is computed in any case
WIDE = 0.5  # half width over value: wider, the interval may be one-sided
POINTS = 8  # of a profile on each side, at most
CLOSE = 0.1  # of the root of the threshold: tolerance of an end
LEAST_GROWTH, MOST_GROWTH = 1.3, 3.0  # factors of the distance from point to point
STEPS = 4  # descent steps between computations of the derivatives
DERIVED = 3  # rounds of descent, each but the first with new derivatives
SETTLED = 0.02  # of the threshold: a step with less gain is the last
IMPROVED = 0.1  # of the threshold: a point lower by more shows that the fit had not converged
MOST_FIXED = 3  # fixed keys of a family, at most
SHARES = (1.0, 0.5, 1.0)  # of the way to the end of a range; the first end of a line is reached by its half
SHORTER = (1.0, 0.5, 0.25)  # of the range, if its end cannot be reached
MORE_RISE = 2.0  # times the root of the predicted rise that is tolerated
FARTHEST = 2.0  # largest change of an unknown's logarithm in a start

Mask = npt.NDArray[np.bool_]


class Refit(NamedTuple):
    """Best-fitting unknowns with some of them held, the rise of the cost there, and derivatives."""

    x: Array
    rise: float
    jacobian: Array


class Refits:
    """Refits about one fit with some unknowns held at other values; keeps the best point found.

    Parameters
    ----------
    found : Linearised
        Derivatives at its end.
    variance : float, optional
        Variance of the rows; that of the residuals if absent.
    """

    def __init__(self, fitted: Fitted, found: Linearised, variance: float | None = None) -> None:
        self.problem, self.comparison, self.x = fitted.problem, fitted.comparison, fitted.x
        self.jacobian = found.jacobian
        freedom = max(len(found.residuals) - len(self.x), 1)
        if variance is None:
            variance = float(found.residuals @ found.residuals) / freedom
        share = float(stats.t.ppf(0.975, freedom))
        self.threshold = variance * share**2
        self.reach = share * np.sqrt(variance * np.diag(inverse_information(found.jacobian)))
        self.bounds = fitted.problem.unknowns.bounds()
        self.is_key = np.isin(np.arange(len(self.x)), fitted.problem.unknowns.places(KEY))
        self.least = _cost(self._rows(self.x))
        self.better: Array | None = None
        self.lowest = -IMPROVED * self.threshold
        self.fit = Refit(self.x, 0.0, self.jacobian)

    def with_held(
        self, held: Sequence[int], values: Array, follows: Mask, way: Sequence[Refit], most: float | None = None
    ) -> Refit:
        """Return the fit with some unknowns held at values and others refitted.

        ``way`` has the fit, then other refits on the same line through it.  A rise of at most ``most`` suffices.
        """
        x = self._start(list(held), values, follows, way[-1].x)
        rise, settled = self.rise(x), SETTLED * self.threshold
        jacobian = min(way, key=lambda each: float(np.linalg.norm(each.x[list(held)] - values))).jacobian
        suffices = rise <= (settled if most is None else most)  # the others compensate for the held ones
        for again in range(0 if suffices else DERIVED):
            if again:
                jacobian = self.problem.jacobian(x, self.comparison, follows) * robust_weights(self._rows(x))[:, None]
            x, won, jacobian = self._descended(x, follows, jacobian)
            rise = self.rise(x)
            suffices = won <= settled if most is None else rise <= most
            if suffices or (again and won <= settled):
                break
        return Refit(x, rise, jacobian)

    def rise(self, x: Array) -> float:
        """Return the rise of the cost above that of the fit; store the point if it is the best."""
        rise = _cost(self._rows(x)) - self.least
        if rise < self.lowest:
            self.better, self.lowest = x.copy(), rise
        return rise

    def slopes(self, held: Sequence[int], follows: Mask) -> tuple[Array, Array]:
        """Return derivatives by held unknowns, the others refitted: of the refitted unknowns, and of the rows."""
        own, moved = self.jacobian[:, follows], self.jacobian[:, list(held)]
        slopes = -inverse_information(own) @ (own.T @ moved)
        return slopes, moved + own @ slopes

    def _start(self, held: list[int], values: Array, follows: Mask, other: Array) -> Array:
        """Return a start: from derivatives at the fit and, to second order, another point of the line.

        Keys are extrapolated by their logarithms, as long as their signs stay.
        """
        x = self.x.copy()
        x[held] = values
        logs = self.is_key & (self.x * x > 0.0) & (self.x * other > 0.0)
        size = np.where(logs, self.x, 1.0)

        def away(point: Array) -> Array:
            return np.where(logs, np.log(np.where(logs, point / size, 1.0)), point - self.x)

        slopes = self.slopes(held, follows)[0] * size[held] / size[follows, None]
        moved, known = away(x), away(other)
        share = float(moved[held] @ known[held]) / float(known[held] @ known[held] or 1.0)
        moved[follows] = slopes @ moved[held] + share**2 * (known[follows] - slopes @ known[held])
        far = np.clip(moved, -FARTHEST, FARTHEST)
        x[follows] = np.where(logs, size * np.exp(far), self.x + moved)[follows]
        return np.asarray(np.clip(x, *self.bounds))

    def _descended(self, x: Array, follows: Mask, jacobian: Array) -> tuple[Array, float, Array]:
        """Return the end of descent steps, the gain of the last step, and the updated derivatives."""
        rows, won = self._rows(x), np.inf
        for _ in range(STEPS):
            weights, moved, own = robust_weights(rows), x.copy(), jacobian[:, follows]
            moved[follows] -= inverse_information(own) @ (own.T @ (weights * rows))
            moved = np.clip(moved, *self.bounds)
            there = self._rows(moved)
            jacobian = brought_on(jacobian, moved - x, weights * (there - rows))
            gain = _cost(rows) - _cost(there)
            if gain <= 0.0:
                return x, 0.0 if won < np.inf else self.threshold, jacobian
            x, rows, won = moved, there, gain
            if won <= SETTLED * self.threshold:
                break
        return x, won, jacobian

    def _rows(self, x: Array) -> Array:
        return self.problem.residuals(x, self.comparison)


@dataclass(frozen=True)
class KeyProfile:
    """Interval of a key, down and up, in scales: nan if derivatives give it, inf if it is open.

    ``better`` is a point whose cost is lower than the fit's by ``won``, if one was found.
    """

    place: int
    lower: float
    upper: float
    better: Array | None
    won: float


def key_profile(fitted: Fitted, found: Linearised, place: int) -> KeyProfile:
    """Return the profile of one key, computed only if derivatives do not give its interval."""
    refits, lower, upper = Refits(fitted, found), np.nan, np.nan
    if refits.threshold > 0.0 and _is_doubtful(refits, place):
        way = [refits.fit]
        lower, upper = _end(refits, place, -1.0, way), _end(refits, place, 1.0, way)
    return KeyProfile(place, lower, upper, refits.better, 0.0 if refits.better is None else -refits.lowest)


def key_profiles(
    fitted: Fitted, found: Linearised, progress: Progress = quiet, scheduler: str | None = None
) -> list[KeyProfile]:
    """Return the profiles of the keys of a fit; ``found`` are the derivatives at its end."""
    places, profiles = list(map(int, fitted.problem.unknowns.places(KEY))), list[KeyProfile]()
    if places and scheduler is not None:
        progress("profiles, on the cluster")
        return sorted(spread(partial(key_profile, fitted, found), places, 1, scheduler), key=attrgetter("place"))
    for place in places:
        progress(f"profile of {fitted.problem.unknowns.all[place].name}")
        profiles.append(key_profile(fitted, found, place))
    return profiles


def _is_doubtful(refits: Refits, place: int) -> bool:
    reach = float(refits.reach[place])
    if not np.isfinite(reach) or reach <= 0.0:
        return False
    own = float(np.linalg.norm(refits.jacobian[:, place]))
    others = np.arange(len(refits.x)) != place
    slopes, left = refits.slopes([place], others)
    if float(np.linalg.norm(left)) < WEAK * own or reach > WIDE * max(abs(float(refits.x[place])), 1.0):
        return True
    sides = [refits.x.copy() for _ in range(2)]
    for x, away in zip(sides, (-reach, reach), strict=True):
        x[place] += away
        x[others] += slopes[:, 0] * away
        np.clip(x, *refits.bounds, out=x)
    refits.problem.prepare(sides)
    return not all(LEAST_RISE <= refits.rise(x) / refits.threshold <= MOST_RISE for x in sides)


def _end(refits: Refits, place: int, sign: float, way: list[Refit]) -> float:
    """Return the distance at which the cost has risen by the threshold; inf if it never does."""
    goal, others, tried = float(np.sqrt(refits.threshold)), np.arange(len(refits.x)) != place, len(way)

    @cache
    def missing(away: float) -> float:
        if away == 0.0:
            return -goal
        way.append(refits.with_held([place], refits.x[[place]] + sign * away, others, way))
        off = float(np.sqrt(max(way[-1].rise, 0.0))) - goal
        return off if abs(off) > CLOSE * goal else 0.0

    bound = float(abs(refits.bounds[int(sign > 0.0)][place] - refits.x[place]))
    near, far = 0.0, min(float(refits.reach[place]), bound)
    while missing(far) < 0.0:
        if far >= bound or len(way) - tried >= POINTS:
            return np.inf
        growth = goal / (goal + missing(far)) if goal + missing(far) > 0.0 else MOST_GROWTH
        near, far = far, min(far * float(np.clip(growth, LEAST_GROWTH, MOST_GROWTH)), bound)
    return float(optimize.brentq(missing, near, far, rtol=CLOSE, maxiter=POINTS, disp=False))


def family(refits: Refits, fixed: Sequence[int], follows: Mask, bounds: Array) -> Array | None:
    """Return fits of equal quality with fixed keys moved, each alone and all together.

    Parameters
    ----------
    refits : Refits
        Refits about the fit; the free keys are its first unknowns.
    fixed : sequence of int
        Indices of the keys to move.
    follows : ndarray of bool
        Shape (unknowns,): the unknowns that are refitted.
    bounds : ndarray
        Shape (2, keys): bounds, in scales.

    Returns
    -------
    ndarray or None
        Shape (points, unknowns), in scales; the first is the fit.  None if the keys cannot be moved, or are too many.
    """
    here = refits.x[list(fixed)]
    if not 0 < len(fixed) <= MOST_FIXED or np.any(here == 0.0):
        return None
    for share in SHORTER:
        away = share * FIXED_OFF * np.abs(here)
        points = _moved(refits, fixed, follows, np.clip([here - away, here + away], *bounds[:, list(fixed)]))
        if points is not None:
            return np.array([refits.x, *points])
    return None


def _moved(refits: Refits, fixed: Sequence[int], follows: Mask, ends: Array) -> list[Array] | None:
    """Return the fits at the ends of each range and at all corners; None if the runs reject one."""
    here, found = refits.x[list(fixed)], list[Array]()
    lines = [np.where(np.arange(len(fixed)) == i, ends, here) for i in range(len(fixed))]
    corners = [(True, *others) for others in product((True, False), repeat=len(fixed) - 1) if others]
    lines += [np.where(corner, ends, ends[::-1]) for corner in corners]
    for line in lines:
        way = [refits.fit]
        for target in [end for end in line if np.any(end != here)]:
            if not _goes_to(target, refits, fixed, follows, way):
                return None
            found.append(way[-1].x)
    return found


def _goes_to(target: Array, refits: Refits, fixed: Sequence[int], follows: Mask, way: list[Refit]) -> bool:
    """Return whether a fit of equal quality exists at other values of fixed keys; it is added to the way there."""
    here, left = refits.x[list(fixed)], refits.slopes(fixed, follows)[1]
    good = False
    for share in SHARES[len(way) == 1 :]:
        moved = share * (target - here)
        most = (np.sqrt(refits.threshold) + MORE_RISE * float(np.linalg.norm(left @ moved))) ** 2
        reached = refits.with_held(fixed, here + moved, follows, way, most)
        good = reached.rise <= most
        if good:
            way.append(reached)
        if good == (share == 1.0):
            break
    return good


def _cost(rows: Array) -> float:
    return float(np.sum(2.0 * LOSS_SCALE**2 * (np.sqrt(1.0 + (rows / LOSS_SCALE) ** 2) - 1.0)))
