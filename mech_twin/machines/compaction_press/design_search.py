"""Search for a press: the best design for one objective, the Pareto front of several, or why there is none.

A compiled scan of a Sobol sequence finds where the space is feasible; differential evolution (scipy) starts from the
scan's best and is sharpened by simplex restarts.  The same seed gives the same answer.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution, minimize
from scipy.stats import qmc

from mech_twin.machines.compaction_press.design_problem import (
    CONSTRAINTS,
    OBJECTIVES,
    SENSES,
    Evaluation,
    Space,
    evaluation,
)

Array = NDArray[np.float64]
SCALES = np.array([20.0, 0.05, 50.0, 1.0, 85.0, 0.1, 0.1, 0.1])  # to add up violations of different units
INFEASIBLE = 1e6
SCAN_POWER = 16
POPULATION = 60
GENERATIONS = 500
RESTARTS = 4


class Design(NamedTuple):
    """A design (m), its objectives and the margins of its constraints, by name."""

    crank_m: float
    length_m: float
    height_m: float
    pendulum_m: float
    objectives: dict[str, float]
    margins: dict[str, float]


class InfeasibleSpaceError(ValueError):
    """No design of the space meets every constraint; the message says which constraint kills them."""


def scan(space: Space, seed: int, power: int = SCAN_POWER) -> tuple[Array, Evaluation]:
    """Return 2^power designs spread over the space (scrambled Sobol sequence), shape (n, 4), and their evaluation."""
    unit = qmc.Sobol(4, scramble=True, rng=np.random.default_rng(seed)).random_base2(power)
    lower, upper = np.array(space.lower_m), np.array(space.upper_m)
    designs = np.asarray(lower + unit * (upper - lower), dtype=np.float64)
    return designs, evaluation(designs, space.limits)


def infeasibility(found: Evaluation) -> str:
    """Return which constraint kills the designs of a scan that holds no feasible one, with numbers.

    Constraints that no design meets by itself come first; else the one without which most designs would be left; else
    the two that the most designs fail together.
    """
    held = found.margins >= 0.0
    share = held.mean(axis=0)
    text = ", ".join(f"{name} {100.0 * s:.2f} %" for name, s in zip(CONSTRAINTS, share, strict=True))
    alone = [name for name, s in zip(CONSTRAINTS, share, strict=True) if s == 0.0]
    if alone:
        best = {name: float(found.margins[:, CONSTRAINTS.index(name)].max()) for name in alone}
        near = ", ".join(f"{name} misses by {-margin:.4g} at best" for name, margin in best.items())
        return f"no design meets {' nor '.join(alone)} ({near}); designs that meet each constraint: {text}"
    without = [int(np.delete(held, i, axis=1).all(axis=1).sum()) for i in range(len(CONSTRAINTS))]
    most = int(np.argmax(without))
    if without[most] > 0:
        return (
            f"{CONSTRAINTS[most]} kills the designs: without it {without[most]} of {len(held)} would be left, with it "
            f"none; designs that meet each constraint: {text}"
        )
    together = ((~held).astype(float).T @ (~held).astype(float)) / len(held)
    np.fill_diagonal(together, 0.0)
    i, j = np.unravel_index(int(np.argmax(together)), together.shape)
    return (
        f"no single constraint: {CONSTRAINTS[i]} and {CONSTRAINTS[j]} fail together on "
        f"{100.0 * together[i, j]:.1f} % of the designs; designs that meet each constraint: {text}"
    )


def _feasible_scan(space: Space, seed: int) -> tuple[Array, Evaluation]:
    designs, found = scan(space, seed)
    if not found.feasible.any():
        # the scan may have missed a sliver: let the evolution look for it, violation alone counting
        none = np.zeros(3)
        least = np.argsort(_ranked(found, none, none, np.ones(3)), kind="stable")[:POPULATION]
        sliver = np.atleast_2d(_refined(space, designs[least], seed, none, none, np.ones(3)))
        reached = evaluation(sliver, space.limits)
        if not reached.feasible.any():
            raise InfeasibleSpaceError(infeasibility(found))
        return sliver, reached
    return designs[found.feasible], Evaluation(found.objectives[found.feasible], found.margins[found.feasible])


def _ranked(found: Evaluation, weights: Array, ideal: Array, spread: Array) -> Array:
    """Return what is made small: the largest weighted objective over the ideal; violations rank behind all of them."""
    known = np.where(np.isfinite(found.objectives), found.objectives, INFEASIBLE)
    scaled = weights * (known * np.array(SENSES) - ideal) / spread
    violation = np.minimum(np.maximum(-found.margins / SCALES, 0.0), 10.0).sum(axis=1)
    # the small sum keeps the front's points from being merely weakly best
    value = scaled.max(axis=1) + 1e-6 * scaled.sum(axis=1)
    return np.asarray(np.where(violation > 0.0, INFEASIBLE * (1.0 + violation), value))


def _refined(space: Space, start: Array, seed: int, weights: Array, ideal: Array, spread: Array) -> Array:
    lower, upper = np.array(space.lower_m), np.array(space.upper_m)
    width = np.where(upper > lower, upper - lower, 1.0)

    def value(columns: Any, /) -> Any:
        designs = lower + np.atleast_2d(columns.T) * (upper - lower)
        return _ranked(evaluation(designs, space.limits), weights, ideal, spread)

    def single(x: Array) -> float:
        outside = float(np.maximum(-x, 0.0).sum() + np.maximum(x - 1.0, 0.0).sum())
        return float(value(np.clip(x, 0.0, 1.0))[0]) + INFEASIBLE * outside

    evolved = differential_evolution(
        value,
        Bounds(np.zeros(4), np.ones(4)),
        init=np.clip((start - lower) / width, 0.0, 1.0),
        maxiter=GENERATIONS,
        tol=0.0,
        atol=1e-13,
        mutation=(0.4, 0.9),
        recombination=0.9,
        rng=np.random.default_rng(seed),
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    best = np.asarray(evolved.x)
    for size in (1e-3, 1e-4, 1e-5, 1e-6)[:RESTARTS]:
        simplex = np.vstack((best, best + size * np.where(best + np.eye(4) * size > 1.0, -1.0, 1.0) * np.eye(4)))
        tried = minimize(
            single,
            best,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 2000, "xatol": 1e-12, "fatol": 1e-13},
        )
        if tried.fun < single(best):
            best = np.clip(tried.x, 0.0, 1.0)
    return np.asarray(lower + best * (upper - lower), dtype=np.float64)


def _described(designs: Array, space: Space) -> list[Design]:
    found = evaluation(designs, space.limits)
    return [
        Design(
            float(design[0]),
            float(design[1]),
            float(design[2]),
            float(design[3]),
            dict(zip(OBJECTIVES, map(float, objectives), strict=True)),
            dict(zip(CONSTRAINTS, map(float, margins), strict=True)),
        )
        for design, objectives, margins in zip(designs, found.objectives, found.margins, strict=True)
    ]


def _column(objective: str) -> int:
    if objective not in OBJECTIVES:
        raise ValueError(f"no objective '{objective}'; expected one of {', '.join(OBJECTIVES)}")
    return OBJECTIVES.index(objective)


def best_design(objective: str, space: Space | None = None, seed: int = 1) -> Design:
    """Return the best design found for one objective.

    Parameters
    ----------
    objective : str
        ``peak_torque_nm`` or ``flywheel_inertia_kg_m2`` (made small), ``mean_press_force_n`` (made large).
    space : Space, optional
        Bounds and limits; those of the reference problem if absent.
    seed : int
        The same seed gives the same answer.

    Raises
    ------
    InfeasibleSpaceError
        If no design of the scan meets every constraint, naming the one that kills them.
    """
    column, space = _column(objective), space or Space()
    designs, found = _feasible_scan(space, seed)
    values = found.objectives[:, column] * SENSES[column]
    order = np.argsort(values, kind="stable")
    start = designs[order[np.arange(POPULATION) % len(order)]]
    weights = np.zeros(3)
    weights[column] = 1.0
    ideal, spread = np.zeros(3), np.ones(3)
    spread[column] = abs(float(values[order[0]]))
    return _described(np.atleast_2d(_refined(space, start, seed, weights, ideal, spread)), space)[0]


def non_dominated(values: Array) -> NDArray[np.bool_]:
    """Return which rows no other row beats in every column (small is good), shape (n,)."""
    keep = np.ones(len(values), dtype=np.bool_)
    for i in np.argsort(values[:, 0], kind="stable"):
        if keep[i]:
            worse = (values >= values[i]).all(axis=1) & (values > values[i]).any(axis=1)
            keep &= ~worse
    return keep


def pareto_front(
    objectives: tuple[str, ...] = OBJECTIVES, space: Space | None = None, seed: int = 1, points: int = 9
) -> list[Design]:
    """Return designs of which none beats another in every objective, sorted by the first objective.

    The scan's non-dominated designs, with one refined design per objective and one per direction between them
    (weighted largest distance from the ideal).
    """
    columns, space = [_column(name) for name in objectives], space or Space()
    designs, found = _feasible_scan(space, seed)
    values = found.objectives * np.array(SENSES)
    ideal, spread = values.min(axis=0), np.ptp(values, axis=0) + 1e-12
    directions = np.random.default_rng(seed).dirichlet(np.ones(len(columns)), points)
    front = [designs[non_dominated(values[:, columns])]]
    for i, direction in enumerate([*np.eye(len(columns)), *directions]):
        weights = np.zeros(3)
        weights[columns] = np.maximum(direction, 1e-3)
        rank = _ranked(found, weights, ideal, spread)
        start = designs[np.argsort(rank, kind="stable")[np.arange(POPULATION) % len(rank)]]
        front.append(np.atleast_2d(_refined(space, start, seed + i, weights, ideal, spread)))
    together = np.vstack(front)
    scored = evaluation(together, space.limits).objectives * np.array(SENSES)
    kept = together[non_dominated(scored[:, columns])]
    return sorted(_described(kept, space), key=lambda design: design.objectives[objectives[0]])
