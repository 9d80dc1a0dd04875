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
Variables with the same effect on the features form one group; variables without a measurable effect are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import qr
from scipy.stats import qmc

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.naming import Candidate, Signature

DEGREE = 3
LIMIT = 1.3  # of the ranges: simulated points, and bound of the estimate of u
OUTSIDE = 1.1  # of a range: beyond it, a variable counts as outside
POINTS_A_TERM = 3
SEEN = 0.25  # standard deviations of the features at the end of a range: a smaller effect is not measurable
STEPS = 8  # of the Gauss-Newton iteration
SMOOTHED = 0.05  # weight of the newest cycle in the smoothed operating point
SIGNIFICANT = 5.0  # standard deviations of the smoothed point in the baseline
LEAST_MOVED = 0.05  # of a range: lower bound of a step, for a cycle near whose end a variable steps
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
    drift : ndarray
        Shape (d - q,): error of y while the variables drift at their highest rate.
    wander : ndarray
        Shape (q,): standard deviation of the smoothed u in the baseline.
    moved : ndarray
        Shape (q,): the largest movement of u within `hold` cycles of the baseline.
    transient : ndarray
        Shape (q, d - q): transient of y for a movement of u by 1.
    hold : int
        Duration of a transient, in cycles.
    """

    names: tuple[str, ...]
    variables: tuple[str, ...]
    beyond: tuple[str, ...]
    pivots: tuple[int, ...]
    ranges: Array
    mean: Array
    root: Array
    coefficients: Array
    doubt: Array
    drift: Array
    wander: Array
    moved: Array
    transient: Array
    hold: int

    @cached_property
    def others(self) -> tuple[int, ...]:
        """Indices of the d - q features that are not pivots."""
        return tuple(i for i in range(len(self.names)) if i not in self.pivots)

    @cached_property
    def left_names(self) -> tuple[str, ...]:
        """Names of the features that are not pivots."""
        return tuple(self.names[i] for i in self.others)

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

    def centred(self, rows: Array) -> OperatingSurface:
        """Return the surface with the mean of healthy cycles (n, d) reduced to u = 0."""
        found = replace(self, mean=rows.mean(axis=0))
        for _ in range(2):
            own = np.array([found.response(found.located(row))[0] for row in rows])
            found = replace(found, mean=(rows - own).mean(axis=0))
        return found

    def annihilator(self, u: Array) -> Array:
        """Return A (d - q, d) with y = A (x - m - r) and A dr/du = 0."""
        slope = self.response(u)[1]
        found = np.zeros((len(self.others), len(self.names)))
        found[np.arange(len(self.others)), self.others] = 1.0
        found[:, self.pivots] = -np.linalg.solve(slope[list(self.pivots)].T, slope[list(self.others)].T).T
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
        if signature.name in self.beyond:
            found[np.abs(signature.sizes) <= self.ranges[self.beyond.index(signature.name)]] = 0.0
        maps = [self.annihilator(self.located(self.mean + response)) for response in signature.responses]
        uncertainty: dict[str, Any] = {}
        if len(signature.scatter):
            uncertainty["scatter"] = np.array([f @ a.T for f, a in zip(signature.scatter, maps, strict=True)])
        if len(signature.doubt):
            uncertainty["doubt"] = np.array([a @ doubt for doubt, a in zip(signature.doubt, maps, strict=True)])
        return Signature(
            signature.name, signature.meaning, signature.unit, signature.sizes, found, key=signature.key, **uncertainty
        )


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
    powers = u[None, :] ** terms
    slopes = np.empty((len(u), len(terms)))
    for k in range(len(u)):
        factors = powers.copy()
        factors[:, k] = terms[:, k] * u[k] ** np.maximum(terms[:, k] - 1, 0)
        slopes[k] = factors.prod(axis=1)
    return powers.prod(axis=1), slopes


class SurfaceVariable(NamedTuple):
    """A variable of a surface: joined names of its group, the fault beyond its range, and the range as a share."""

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
        groups[most] = groups[most]._replace(name=f"{groups[most].name} or {variable.name}")
    return kept, groups, open_rest


def fitted_surface(
    groups: Sequence[SurfaceVariable],
    rolled_out: Callable[[Array], Array | None],
    names: tuple[str, ...],
    rows: Array,
    root: Array,
    unexplained: Array,
) -> OperatingSurface:
    """Return the surface fitted to simulations at points of the ranges, centred on the baseline's cycles.

    Parameters
    ----------
    rolled_out : callable
        Change of the features (d,) at shares (q,) of the healthy values; None where the simulation fails.
    rows : ndarray
        Shape (n, d): features of healthy cycles.
    root : ndarray
        See `OperatingSurface`.
    unexplained : ndarray
        Shape (d,): error due to the variables that were left out.
    """
    q, ranges = len(groups), np.array([group.range for group in groups])
    terms = polynomial_terms(q)
    count = POINTS_A_TERM * len(terms)
    places = LIMIT * (2.0 * qmc.Sobol(q, seed=1).random(1 << (count - 1).bit_length())[:count] - 1.0)
    places = np.concatenate([places, LIMIT * np.eye(q), -LIMIT * np.eye(q)])
    found = [(u, response) for u in places if (response := rolled_out(u * ranges)) is not None]
    points, responses = (np.array(each) for each in zip(*found, strict=True))
    design = np.array([term_values(terms, u)[0] for u in points])
    coefficients = np.linalg.lstsq(design, responses, rcond=None)[0]
    leverage = np.clip(np.einsum("ij,ji->i", design, np.linalg.pinv(design)), 0.0, 0.9)
    held_out = (responses - design @ coefficients) / (1.0 - leverage)[:, None]
    slope = coefficients[:q].T
    pivots = tuple(int(i) for i in qr((root.diagonal()[:, None] * slope).T, pivoting=True, mode="r")[1][:q])
    nothing, nothing_left = np.zeros(q), np.zeros(len(names) - q)
    blank = OperatingSurface(
        names, tuple(g.name for g in groups), tuple(g.beyond for g in groups), pivots, ranges, rows.mean(axis=0), root,
        coefficients, nothing_left, nothing_left, nothing, nothing, np.zeros((q, len(names) - q)), 1,
    )  # fmt: skip
    blank = blank.centred(rows)
    off = np.array([blank.annihilator(u) @ left for u, left in zip(np.clip(points, -1, 1), held_out, strict=True)])
    doubt = np.sqrt((off**2).mean(axis=0)) + np.abs(blank.annihilator(nothing) @ unexplained)
    return replace(blank, doubt=doubt)


def with_transients(
    surface: OperatingSurface, runs: Sequence[Sequence[tuple[Array, Array]]], noise: Array
) -> OperatingSurface:
    """Return the surface with the transients of y during a movement, from runs with a step of one variable.

    Parameters
    ----------
    runs : sequence of sequences of (ndarray, ndarray)
        For each variable, stepped at several phases of a cycle: y (n, d - q) minus its settled mean from the step on,
        and the change of u (n, q) since.
    noise : ndarray
        Shape (d - q,): standard deviation of y in these runs.
    """
    transient, hold = np.zeros((len(surface.variables), len(surface.others))), 2
    for k, each in enumerate(runs):
        lasting: list[int] = []
        for y, u in each:
            over = np.maximum(np.abs(y) - 4.0 * noise, 0.0)
            lasting += np.flatnonzero(over.any(axis=1)).tolist()
            spans = np.maximum.accumulate(np.maximum(u[:, k], 0.0)) - np.minimum.accumulate(np.minimum(u[:, k], 0.0))
            ratios = over / np.maximum(spans, LEAST_MOVED)[:, None]
            transient[k] = np.maximum(transient[k], MOVES * ratios.max(axis=0))
        hold = max([hold, *(cycle + 2 for cycle in lasting if lasting.count(cycle) > 1)])  # seen once it is noise
    return replace(surface, transient=transient, hold=hold)


def with_baseline(surface: OperatingSurface, runs: Sequence[Array]) -> OperatingSurface:
    """Return the surface with the wander and movement of the baseline's points, (n, q) for each run."""
    moved, smooth = np.zeros(len(surface.variables)), []
    for u in runs:
        for first in range(len(u)):
            moved = np.maximum(moved, np.ptp(u[first : first + surface.hold], axis=0))
        kept = u[0]
        for i, each in enumerate(u):
            kept = kept + max(1.0 / (i + 1.0), SMOOTHED) * (each - kept)
            smooth.append(kept)
    scatter = np.concatenate(runs).std(axis=0) * (SMOOTHED / (2.0 - SMOOTHED)) ** 0.5
    return replace(surface, moved=moved, wander=np.maximum(np.std(smooth, axis=0), scatter))
