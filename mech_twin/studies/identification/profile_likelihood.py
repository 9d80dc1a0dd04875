# SPDX-License-Identifier: Apache-2.0
"""Profile likelihood: how far a key can go, everything else fitted anew, before the runs speak against it.

Derivatives tell the interval of a key where the fit ended.  Where the misfit is no parabola in the key - its effect
saturates, a valley is curved - they tell it wrong.  Here the key is put aside step by step, the other unknowns follow,
and the interval ends where the cost has risen by ``t^2`` times the variance of the residuals (Raue et al. 2009,
doi:10.1093/bioinformatics/btp358).  Keys are checked first at the two ends of the interval that derivatives give, along
the line on which the others follow; only those whose rise there is another are followed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.intervals import Linearised, inverse_information
from mech_twin.studies.identification.least_squares_fit import LOSS_SCALE, Fitted, Progress, brought_on, quiet
from mech_twin.studies.identification.unknowns import KEY

LEAST_RISE, MOST_RISE = 0.6, 1.6  # of the rise that a parabola has: another one is followed
WEAK = 0.03  # of the effect of a key that no other unknown repeats: less is followed whatever the rise
WIDE = 0.5  # half width over value: may be open to one side
POINTS = 8  # on either side
CLOSE = 0.1  # of the root of the threshold: an end
INNERMOST = 0.2  # of the way between two points: a next one nearer to either is put into the middle
LEAST_GROWTH, MOST_GROWTH = 1.3, 3.0  # of the distance from point to point
FOLLOWING = 4  # steps of the other unknowns at a point, before and after their derivatives are taken anew
SETTLED = 0.02  # of the threshold: a step that wins less is the last
IMPROVED = 0.1  # of the threshold: a point lower than the fit by more shows that the fit had not ended

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Profile:
    """How far the keys of a fit can go.

    Attributes
    ----------
    lower, upper : ndarray
        Shape (unknowns,), over the scales: distance from the estimate to either end; nan where nothing was followed,
        inf where no end was found within the bounds.
    better : ndarray or None
        Unknowns that fit better than where the fit ended, if any were met.
    followed : tuple of int
        Places of the keys that were followed.
    """

    lower: Array
    upper: Array
    better: Array | None
    followed: tuple[int, ...]


def no_profile(count: int) -> Profile:
    """Return the profile of so many unknowns of which none was followed."""
    return Profile(np.full(count, np.nan), np.full(count, np.nan), None, ())


def profiled(fitted: Fitted, found: Linearised, progress: Progress = quiet) -> Profile:
    """Return the profile of the keys of which derivatives do not tell the interval.

    Parameters
    ----------
    fitted : Fitted
        Where the fit ended.
    found : Linearised
        Derivatives there by the unknowns of the fit, in its order.
    progress : callable, optional
        Takes a line on the progress.
    """
    walk, profiles = Walk(fitted, found), []
    for place in profiled_keys(fitted):
        progress(f"profile of {fitted.problem.unknowns.all[place].name}")
        profiles.append(walk.key_profile(place))
    return profile_of_keys(len(fitted.x), profiles)


@dataclass(frozen=True)
class KeyProfile:
    """How far one key can go; nan where it was not followed.  ``better`` is met with the cost of ``cost``."""

    place: int
    lower: float
    upper: float
    better: Array | None
    cost: float


def profiled_keys(fitted: Fitted) -> list[int]:
    """Return the places of the keys that may be followed."""
    return list(map(int, fitted.problem.unknowns.places(KEY)))


def profile_of_keys(count: int, keys: Sequence[KeyProfile]) -> Profile:
    """Return the profile of a fit of so many unknowns from those of its keys."""
    lower, upper = np.full(count, np.nan), np.full(count, np.nan)
    for key in keys:
        lower[key.place], upper[key.place] = key.lower, key.upper
    better = min((key for key in keys if key.better is not None), key=lambda key: key.cost, default=None)
    followed = tuple(key.place for key in keys if not np.isnan(key.lower))
    return Profile(lower, upper, None if better is None else better.better, followed)


class Walk:
    """Points about one fit at which some unknowns are put aside and others follow; remembers the best point met.

    Parameters
    ----------
    fitted : Fitted
        Where the fit ended.
    found : Linearised
        Derivatives there.
    variance : float, optional
        Of the rows; that of the residuals if absent.
    """

    def __init__(self, fitted: Fitted, found: Linearised, variance: float | None = None) -> None:
        self.problem, self.comparison, self.x = fitted.problem, fitted.comparison, fitted.x
        self.jacobian = found.jacobian
        freedom = max(len(found.residuals) - len(self.x), 1)
        if variance is None:
            variance = float(found.residuals @ found.residuals) / freedom
        share = float(stats.t.ppf(0.975, freedom))
        self.threshold, self.deviation = variance * share**2, float(np.sqrt(variance))
        self.covariance = inverse_information(found.jacobian) * variance
        self.reach = share * np.sqrt(np.diag(self.covariance))
        self.low, self.high = fitted.problem.unknowns.bounds()
        self.least = self.cost(self.x)
        self.better: Array | None = None
        self.lowest = self.least - IMPROVED * self.threshold

    def cost(self, x: Array) -> float:
        """Return the robust sum of squares."""
        return _robust(self.problem.residuals(x, self.comparison))

    def key_profile(self, place: int) -> KeyProfile:
        """Return the profile of one key, for `profile_of_keys`."""
        lower = upper = np.nan
        if self.threshold > 0.0 and self.doubtful(place):
            lower, upper = self.end(place, -1.0), self.end(place, 1.0)
        return KeyProfile(place, lower, upper, self.better, self.lowest)

    def doubtful(self, place: int) -> bool:
        """Return whether the derivatives do not tell the interval of a key."""
        reach = float(self.reach[place])
        if not np.isfinite(reach) or reach <= 0.0:
            return False
        own = float(np.linalg.norm(self.jacobian[:, place]))
        alone = self.deviation / float(np.sqrt(self.covariance[place, place]))
        if alone < WEAK * own or reach > WIDE * max(abs(float(self.x[place])), 1.0):
            return True
        return not all(self._as_parabola(place, sign * reach) for sign in (-1.0, 1.0))

    def _as_parabola(self, place: int, away: float) -> bool:
        """Return whether the cost rises as the derivatives predict, the other unknowns put where they say or near."""
        others = np.arange(len(self.x)) != place
        x = self._along(place, away)
        rise = self._noted(x)
        if not LEAST_RISE * self.threshold <= rise <= MOST_RISE * self.threshold:
            rise = self._noted(self.descended(x, others, self.jacobian)[0])
        return LEAST_RISE * self.threshold <= rise <= MOST_RISE * self.threshold

    def end(self, place: int, sign: float) -> float:
        """Return the distance at which the cost has risen by the threshold, inf where it does not."""
        bound = float(self.high[place] - self.x[place] if sign > 0.0 else self.x[place] - self.low[place])
        goal, start, jacobian = float(np.sqrt(self.threshold)), self.x, self.jacobian
        near = far = (0.0, 0.0)  # distance and root of the rise: within the interval, and beyond its end
        away = min(float(self.reach[place]), bound)
        for _ in range(POINTS):
            start, jacobian = self._followed(place, self.x[place] + sign * away, start, jacobian)
            root = float(np.sqrt(max(self._noted(start), 0.0)))
            if abs(root - goal) <= CLOSE * goal:
                return away
            if root > goal:
                far = (away, root)
            elif away >= bound:
                return np.inf
            else:
                near = (away, root)
            away = min(_next(near, far, goal), bound)
        return far[0] if far[0] > 0.0 else np.inf

    def _along(self, place: int, away: float) -> Array:
        """Return the unknowns with a key put aside and the others where their derivatives put them."""
        moved: Array = self.x + self.covariance[:, place] / self.covariance[place, place] * away
        return np.asarray(np.clip(moved, self.low, self.high))

    def _noted(self, x: Array) -> float:
        """Return the rise of the cost at a point, and remember the point if it is the best."""
        cost = self.cost(x)
        if cost < self.lowest:
            self.better, self.lowest = x.copy(), cost
        return cost - self.least

    def _followed(self, place: int, value: float, start: Array, jacobian: Array) -> tuple[Array, Array]:
        """Return the unknowns that fit best with a key fixed at a value, and the derivatives that led there.

        They are those of the point before, brought on by what each step shows; taken anew where they lead no further.
        """
        others = np.arange(len(self.x)) != place
        x = self._along(place, value - float(self.x[place]))
        if self.cost(again := np.where(others, start, value)) < self.cost(x):
            x = again
        x, won, jacobian = self.descended(x, others, jacobian)
        if self.settled(won):
            return x, jacobian
        x, _, jacobian = self.descended(x, others, self.slopes(x))
        return x, jacobian

    def slopes(self, x: Array) -> Array:
        """Return the derivatives at a point, robust weights on their rows."""
        weights = _weights(self.problem.residuals(x, self.comparison))
        return np.asarray(self.problem.jacobian(x, self.comparison) * weights[:, None])

    def settled(self, won: float) -> bool:
        """Return whether a step that won so much was the last."""
        return won <= SETTLED * self.threshold

    def descended(self, x: Array, others: Mask, jacobian: Array) -> tuple[Array, float, Array]:
        """Return where steps of these derivatives lead while the cost falls, what the last one won, and they anew."""
        rows = self.problem.residuals(x, self.comparison)
        cost, won = _robust(rows), np.inf
        for _ in range(FOLLOWING):
            moved = x.copy()
            moved[others] -= _solved(jacobian[:, others], _weights(rows) * rows)
            moved = np.clip(moved, self.low, self.high)
            rows_there = self.problem.residuals(moved, self.comparison)
            now = _robust(rows_there)
            jacobian = brought_on(jacobian, moved - x, _weights(rows) * (rows_there - rows))
            if now >= cost:
                return x, 0.0 if won < np.inf else self.threshold, jacobian
            x, rows, cost, won = moved, rows_there, now, cost - now
            if self.settled(won):
                break
        return x, won, jacobian


def _next(near: tuple[float, float], far: tuple[float, float], goal: float) -> float:
    """Return the next distance to try, from distances and roots of the rise; ``far`` is zero while none is known."""
    if far[0] == 0.0:
        return near[0] * float(np.clip(goal / near[1] if near[1] > 0.0 else MOST_GROWTH, LEAST_GROWTH, MOST_GROWTH))
    share = (goal - near[1]) / (far[1] - near[1])
    return near[0] + (far[0] - near[0]) * (share if INNERMOST <= share <= 1.0 - INNERMOST else 0.5)


def _robust(rows: Array) -> float:
    return float(np.sum(2.0 * LOSS_SCALE**2 * (np.sqrt(1.0 + (rows / LOSS_SCALE) ** 2) - 1.0)))


def _weights(rows: Array) -> Array:
    return np.asarray((1.0 + (rows / LOSS_SCALE) ** 2) ** -0.25)


def _solved(jacobian: Array, rows: Array) -> Array:
    return np.asarray(inverse_information(jacobian) @ (jacobian.T @ rows))
