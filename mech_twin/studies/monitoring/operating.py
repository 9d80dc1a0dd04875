# SPDX-License-Identifier: Apache-2.0
"""Operating point: removes the effect of supply, load or temperature from the features of a healthy machine.

The model is simulated at points of the declared ranges, and a polynomial is fitted to the changes of the features::

    r(u) = sum over terms k of c_k u^k,      u as shares of the ranges, r(0) = 0, terms up to the third degree

In each cycle u is estimated from the features x, with the noise N of neighbouring cycles and the ranges as prior::

    u = argmin (x - m - r(u))' N^-1 (x - m - r(u)) + |u|^2

A pivoted QR of J = dr/du selects q pivot features, which determine u.  Of the d - q other features, only the part that
the pivots do not predict is kept::

    y = (x - m - r)_others - J_others J_pivots^-1 (x - m - r)_pivots

y has no component along J, so that charts, diagnosis and signatures of y do not depend on the operating point.
J_pivots^-1 is taken by the singular values s of J_pivots in standard deviations of the pivots: s/max(s, `FAINT`)^2 for
1/s.  A variable that the pivots hardly show would otherwise multiply their noise without bound, where s passes zero.
Variables with the same effect on the features form one group; variables without a measurable effect are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field

from mech_twin.capabilities.cycle import Array
from mech_twin.kernels.kernel import kernel
from mech_twin.studies.monitoring.baseline import Numbers
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.diagnosis import Candidate, Signature

DEGREE = 3
MOST_VARIABLES = 20
LIMIT = 1.3  # of the ranges: simulated points, and bound of the estimate of u
MOST_FAR = 0.1  # of healthy cycles that may be farther off than was simulated
OUTSIDE = 1.1  # of a range: beyond it, a variable counts as outside
SEEN = 0.25  # standard deviations of the features at the end of a range: a smaller effect is not measurable
FAINT = 0.1  # standard deviations of the pivots at the end of a range: a smaller effect on them is not divided by
STEPS = 8  # of the Gauss-Newton iteration
SMOOTHED = 0.05  # weight of the newest cycle in the smoothed operating point
SETTLED_CYCLES = 2.0 / SMOOTHED - 1.0  # whose mean is as exact as the smoothed operating point
SIGNIFICANT = 5.0  # standard deviations of the smoothed point in the baseline
MOVES = 1.5  # times the largest movement in the baseline: a larger one is a change of operating point


class OperatingValue(NamedTuple):
    """Estimate of a variable: name, relative change with 95 % interval, declared range, the fault beyond it.

    Where the change is larger than was simulated, the interval is open: to -1 or 1.
    """

    name: str
    share: float
    low_95: float
    high_95: float
    range: float
    beyond: str

    @property
    def is_outside(self) -> bool:
        """Whether the whole interval is outside the range, with a margin."""
        edge = OUTSIDE * self.range
        return self.low_95 > edge or self.high_95 < -edge

    @property
    def candidate(self) -> Candidate:
        """The deviation as a fault."""
        return Candidate(self.beyond, self.share, self.low_95, self.high_95, "1", 0.0)


@dataclass(frozen=True)
class OperatingSurface:
    """Response of d features to the operating point, q variables.

    Attributes
    ----------
    names : tuple of str
        Names of the d features.
    variables, beyond : tuple of str
        Names of the q variables, and of the faults that they are outside their ranges.
    pivots : tuple of int
        Indices of the q features that determine them.
    ranges : ndarray
        Shape (q,): half-widths of the ranges, as shares of the healthy values.
    mean : ndarray
        Shape (d,): the healthy features at u = 0.
    root : ndarray
        Shape (d, d): L^-1 with N = L L', the noise from cycle to cycle.
    coefficients : ndarray
        Shape (terms, d): coefficients c of the polynomial.
    doubt : ndarray
        Shape (d - q,): error of y at the end of a range.
    wander : ndarray
        Shape (q,): standard deviation of the smoothed u in the baseline.
    moved : ndarray
        Shape (q,): the largest movement of u within `hold` cycles of the baseline.
    transient : ndarray
        Shape (q, d - q): transient of y for a movement of u by 1.
    hold : int
        Duration of a transient, in cycles.
    drift : ndarray
        Shape (d - q,): error of y while the variables drift at their highest rate.
    """

    names: tuple[str, ...]
    variables: Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_VARIABLES)]
    beyond: tuple[str, ...]
    pivots: tuple[Annotated[int, Field(ge=0)], ...]
    ranges: Numbers
    mean: Numbers
    root: Numbers
    coefficients: Numbers
    doubt: Numbers
    wander: Numbers
    moved: Numbers
    transient: Numbers
    hold: Annotated[int, Field(ge=1, le=10_000)]
    drift: Numbers = field(default_factory=lambda: np.zeros(1))  # an older setup has none

    @cached_property
    def others(self) -> tuple[int, ...]:
        """Indices of the d - q features that are not pivots."""
        return tuple(i for i in range(len(self.names)) if i not in self.pivots)

    @cached_property
    def left_names(self) -> tuple[str, ...]:
        """Names of the features that are not pivots."""
        return tuple(self.names[i] for i in self.others)

    @cached_property
    def _white_pivots(self) -> Array:
        """W (q, q), the inverse of a root of the pivots' noise: W x_pivots has unit covariance."""
        spread = np.linalg.inv(self.root)[list(self.pivots)]
        return np.asarray(np.linalg.inv(np.linalg.cholesky(spread @ spread.T)))

    @property
    def left_noise(self) -> Array:
        """Standard deviation (d - q,) of y from cycle to cycle, at u = 0."""
        spread = np.linalg.solve(self.root.T, self.annihilator(np.zeros(len(self.variables))).T)
        return np.asarray(np.linalg.norm(spread, axis=0))

    @cached_property
    def _terms(self) -> Array:
        return polynomial_terms(len(self.variables))

    def response(self, u: Array) -> tuple[Array, Array]:
        """Return r (d,) and dr/du (d, q) at a point."""
        values, slopes = term_values(self._terms, u)
        return values @ self.coefficients, (slopes @ self.coefficients).T

    def located(self, row: Array) -> Array:
        """Return the operating point (q,) of one cycle, as shares of the ranges, by Gauss-Newton iteration."""
        u, whole = np.zeros(len(self.variables)), row - self.mean
        for _ in range(STEPS):
            r, slope = self.response(u)
            weighted = self.root @ slope
            step = np.linalg.solve(weighted.T @ weighted + np.eye(len(u)), weighted.T @ (self.root @ (whole - r)) - u)
            later = np.clip(u + step, -LIMIT, LIMIT)
            if np.abs(later - u).max() < 1e-9:
                break
            u = later
        return u

    def freed(self, u: Array, cycles: float) -> tuple[Array, Array]:
        """Return the point (q,) whose mean over so many cycles is u, and the factor (q,) on the deviation of that mean.

        In every cycle the prior draws u towards 0, where features hardly tell variables apart.  Here it counts once::

            H = J' N^-1 J,      (n H + 1) freed = n (H + 1) u
        """
        weighted, one = self.root @ self.response(u)[1], np.eye(len(u))
        known = weighted.T @ weighted
        drawn, after = np.linalg.inv(known + one), np.linalg.inv(cycles * known + one)
        spread = np.diag(drawn @ known @ drawn) / cycles
        return after @ (cycles * (known + one) @ u), np.sqrt(np.diag(after) / spread)

    def out_of_reach(self, vectors: Sequence[FeatureVector]) -> tuple[SurfaceVariable, ...]:
        """Return the variables that are farther off than was simulated in a tenth of the cycles or more."""
        rows = (vector.row(self.names) for vector in vectors)
        points = np.array([self.located(row) for row in rows if np.isfinite(row).all()])
        far = (np.abs(points) >= LIMIT - 0.01).mean(axis=0) >= MOST_FAR if len(points) else [False] * len(self.ranges)
        known = map(SurfaceVariable, self.variables, self.beyond, self.ranges.tolist())
        return tuple(variable for variable, is_far in zip(known, far, strict=True) if is_far)

    def centred(self, rows: Array) -> OperatingSurface:
        """Return the surface with the mean of healthy cycles (n, d) reduced to u = 0."""
        found = replace(self, mean=rows.mean(axis=0))
        for _ in range(2):
            own = np.array([found.response(found.located(row))[0] for row in rows])
            found = replace(found, mean=(rows - own).mean(axis=0))
        return found

    def annihilator(self, u: Array) -> Array:
        """Return A (d - q, d) with y = A (x - m - r); A dr/du = 0 but for an effect that is `FAINT`."""
        slope = self.response(u)[1]
        left, sizes, right = np.linalg.svd(self._white_pivots @ slope[list(self.pivots)])
        known = (right.T * (sizes / np.maximum(sizes, FAINT) ** 2)) @ left.T @ self._white_pivots
        found = np.zeros((len(self.others), len(self.names)))
        found[np.arange(len(self.others)), self.others] = 1.0
        found[:, self.pivots] = -slope[list(self.others)] @ known
        return found

    def rest(self, row: Array) -> tuple[Array, Array]:
        """Return the residual y (d - q,) of one cycle and its operating point (q,); both are nan if the row has nan."""
        if not np.isfinite(row).all():
            return np.full(len(self.others), np.nan), np.full(len(self.variables), np.nan)
        u = self.located(row)
        return self.annihilator(u) @ (row - self.mean - self.response(u)[0]), u

    def reduced(self, vector: FeatureVector) -> tuple[FeatureVector, Array]:
        """Return the vector of the residuals y of a cycle, and its operating point (q,)."""
        y, u = self.rest(vector.row(self.names))
        return vector._replace(names=self.left_names, values=y), u

    def open_share(self, row: Array) -> float:
        """Return the share |N^-1/2 y|^2 / |N^-1/2 (x - m)|^2 of a change that the variables, however far, leave."""
        left = np.zeros(len(row))
        left[list(self.others)] = self.rest(row)[0]
        white, whole = self.root @ left, self.root @ (row - self.mean)
        return float(white @ white / (whole @ whole))

    def reduced_signature(self, signature: Signature) -> Signature:
        """Return the effect of a fault on y; if the fault is a variable beyond its range, zero within the range."""
        at_rest = self.rest(self.mean)[0]
        found = np.array([self.rest(self.mean + response)[0] - at_rest for response in signature.responses])
        for beyond, range_ in zip(self.beyond, self.ranges, strict=True):
            if signature.name in beyond.split(" or "):
                found[np.abs(signature.sizes) <= range_] = 0.0
        points = np.array([self.located(self.mean + response) for response in signature.responses])
        maps = [self.annihilator(point) for point in points]
        uncertainty: dict[str, Any] = {}
        if len(signature.scatter):
            uncertainty["scatter"] = np.array([f @ a.T for f, a in zip(signature.scatter, maps, strict=True)])
        if len(signature.doubt):
            uncertainty["doubt"] = np.array([a @ doubt for doubt, a in zip(signature.doubt, maps, strict=True)])
        return replace(signature, responses=found, points=points - points[signature.sizes == 0.0], **uncertainty)


def polynomial_terms(variables: int) -> Array:
    """Return the exponents (terms, q) of all terms of degree 1 to `DEGREE`."""
    rows = [
        np.bincount(chosen, minlength=variables)
        for degree in range(1, DEGREE + 1)
        for chosen in combinations_with_replacement(range(variables), degree)
    ]
    return np.array(rows, dtype=np.int64)


def term_values(terms: Array, u: Array) -> tuple[Array, Array]:
    """Return the terms (terms,) at a point, and their derivatives (q, terms)."""
    return products_of_powers(terms, u ** np.arange(DEGREE + 1.0)[:, None])


@kernel
def products_of_powers(terms: Array, powers: Array) -> tuple[Array, Array]:
    """Return the terms (terms,) and their derivatives (q, terms) from the powers (degree + 1, q) of the variables."""
    count, variables = terms.shape
    values, slopes = np.ones(count), np.ones((variables, count))
    for i in range(count):
        for k in range(variables):
            exponent = terms[i, k]
            values[i] *= powers[exponent, k]
            for of in range(variables):
                slopes[of, i] *= exponent * powers[max(exponent - 1, 0), k] if of == k else powers[exponent, k]
    return values, slopes


class SurfaceVariable(NamedTuple):
    """A variable of a surface: joined names of its group and of the faults beyond its range, the range as a share."""

    name: str
    beyond: str
    range: float


def chosen_variables(
    variables: Sequence[SurfaceVariable], effects: Array, root: Array
) -> tuple[list[int], list[SurfaceVariable], Array]:
    """Return the indices of the variables that are kept, their groups, and the unexplained rest of the others (d,).

    Parameters
    ----------
    effects : ndarray
        Shape (n, d): effect of each on the features at the end of its range.
    root : ndarray
        Shape (d, d): L^-1 of the noise, see `OperatingSurface`.
    """
    white, kept = effects @ root.T, list[int]()
    left = white.copy()
    while len(kept) < len(variables):
        sizes = np.linalg.norm(left, axis=1)
        best = int(np.argmax(sizes))
        if sizes[best] <= SEEN or len(kept) + 1 >= effects.shape[1]:
            break
        kept.append(best)
        basis = np.linalg.qr(white[kept].T)[0]
        left = white - (white @ basis) @ basis.T
        left[kept] = 0.0
    groups = [variables[i] for i in kept]
    open_rest = np.zeros(effects.shape[1])
    for i, variable in enumerate(variables):
        if i in kept or not kept or np.linalg.norm(white[i]) <= SEEN:
            continue
        shares = np.linalg.lstsq(white[kept].T, white[i], rcond=None)[0]
        open_rest += np.abs(effects[i] - shares @ effects[kept])
        most = int(np.argmax(np.abs(shares)))
        for k, share in enumerate(np.abs(shares)):
            groups[k] = groups[k]._replace(
                range=groups[k].range * (1.0 + share * variables[kept[k]].range / groups[k].range)
            )
        first = groups[most]
        groups[most] = first._replace(
            name=f"{first.name} or {variable.name}", beyond=f"{first.beyond} or {variable.beyond}"
        )
    return kept, groups, open_rest


@dataclass
class OperatingTrack:
    """Follows the operating point from cycle to cycle: smooths it and bounds the error of y."""

    surface: OperatingSurface

    def __post_init__(self) -> None:
        self._recent: list[Array] = []
        self._smooth: Array | None = None
        self._weight = 1.0
        self.moves = False
        self.outside: tuple[OperatingValue, ...] = ()  # while the point settles after a movement, those before it

    def advance(self, u: Array) -> Array:
        """Take the operating point (q,) of a cycle; return the error of y in that cycle, shape (d - q,)."""
        surface = self.surface
        self._recent = [*self._recent[1 - surface.hold :], u] if surface.hold > 1 else [u]
        span = np.ptp(self._recent, axis=0)
        is_moving = span > MOVES * surface.moved
        self.moves = bool(is_moving.any())
        if self._smooth is None or self.moves:
            self._smooth, self._weight = u, 1.0
        else:
            self._weight = max(self._weight / (1.0 + self._weight), SMOOTHED)
            self._smooth = self._smooth + self._weight * (u - self._smooth)
        if self._is_known:
            drawn = self._values(self._smooth, np.ones_like(u))  # never farther off: a healthy point at an end stays in
            judged = zip(self.values(), self._far, drawn, strict=True)
            self.outside = tuple(value for value, is_far, kept in judged if is_far and kept.is_outside)
        far = float(np.linalg.norm(self._smooth))
        return surface.drift + far * surface.doubt + np.where(is_moving, span, 0.0) @ surface.transient

    def values(self) -> tuple[OperatingValue, ...]:
        """Return the smoothed variables with their 95 % intervals."""
        if self._smooth is None:
            return ()
        return self._values(*self.surface.freed(self._smooth, 2.0 / self._weight - 1.0))

    def _values(self, point: Array, factor: Array) -> tuple[OperatingValue, ...]:
        surface = self.surface
        half = 1.96 * factor * surface.wander * max(1.0, (self._weight / SMOOTHED) ** 0.5)
        low, high = (point - half) * surface.ranges, (point + half) * surface.ranges
        low[point <= 0.01 - LIMIT] = -1.0  # at the end of what was simulated, one bound is open
        high[point >= LIMIT - 0.01] = 1.0
        numbers = (point * surface.ranges, low, high, surface.ranges)
        return tuple(map(OperatingValue, surface.variables, *(each.tolist() for each in numbers), surface.beyond))

    @property
    def cycles(self) -> int:
        """Cycles since the operating point changed, the present one included; 1 if it drifts."""
        return round(1.0 / self._weight) + self.surface.hold - 2 if self._weight > SMOOTHED else 1

    @property
    def _is_known(self) -> bool:
        return self._smooth is not None and self._weight <= 2.0 * SMOOTHED

    def changed(self) -> tuple[OperatingValue, ...]:
        """Return the variables that differ from the baseline significantly."""
        if self._smooth is None or not self._is_known:
            return ()
        return tuple(value for value, is_far in zip(self.values(), self._far, strict=True) if is_far)

    @property
    def _far(self) -> Any:
        assert self._smooth is not None
        return np.abs(self._smooth) > SIGNIFICANT * self.surface.wander
