# SPDX-License-Identifier: Apache-2.0
"""Search for a press: the best design for one objective, the Pareto front of several, or why there is none.

A compiled scan of a Sobol sequence at 72 crank positions finds the feasible part of the space.  Differential evolution
(scipy) starts from the scan's best.  The winner is refined on the continuous curve by evolution, then by constrained
descent, and must keep every limit there.
The same seed gives the same result.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution, minimize
from scipy.stats import qmc

from mech_twin.capabilities.design import Design, DesignSpace, Evaluation
from mech_twin.capabilities.progress import tell
from mech_twin.errors import StudyError
from mech_twin.machines.compaction_press.design_evaluation import described, design_problem, evaluation
from mech_twin.machines.compaction_press.design_problem import (
    CONSTRAINTS,
    OBJECTIVES,
    SENSES,
    Lengths,
    Limits,
    Margins,
    Problem,
)
from mech_twin.machines.compaction_press.parameters import CompactionPress

Array = NDArray[np.float64]
Evaluate = Callable[[Array], Evaluation]
LOWER, UPPER = Lengths(0.02, 0.3, 0.1, 0.1), Lengths(0.12, 0.8, 0.5, 0.6)
BOUNDS: dict[str, tuple[float, float]] = dict(zip(Lengths._fields, zip(LOWER, UPPER, strict=True), strict=True))
LIMITS: dict[str, float] = Limits()._asdict()
SCALES = np.array(Margins(20.0, 0.05, 50.0, 1.0, 85.0, 0.1, 0.1, 0.1))  # to add up violations of different units
INFEASIBLE = 1e6
VARIABLES = len(Lengths._fields)
SIMPLEX_SIZES = (1e-3, 1e-4, 1e-5, 1e-6)
DIFFERENCE = 1e-6  # of the unit cube, on either side of a point: gradients on the continuous curve
RESERVE = 1e-9  # of each constraint's scale, so that rounding of the written lengths breaks no limit
POLISH_ROUNDS = 5  # of sequential quadratic programming, each from the best so far


class Effort(NamedTuple):
    """Computing effort: scan (power of 2), population, generations at samples and on the curve, simplex steps."""

    scan_power: int = 16
    population: int = 60
    generations: int = 500
    polish_population: int = 24
    polish_generations: int = 60
    simplex_evaluations: int = 400


USUAL_EFFORT = Effort()


class Goal(NamedTuple):
    """Minimised value: the largest weighted distance of an objective from its ideal over its spread (objectives,)."""

    weights: Array
    ideal: Array
    spread: Array


NO_GOAL = Goal(np.zeros(len(OBJECTIVES)), np.zeros(len(OBJECTIVES)), np.ones(len(OBJECTIVES)))


class InfeasibleSpaceError(StudyError):
    """No design of the space meets every constraint; the message names the decisive one."""


class PressSearch(NamedTuple):
    """A configuration with its design problem, the space searched, seed and effort."""

    parameters: CompactionPress
    problem: Problem
    space: DesignSpace
    seed: int
    effort: Effort

    def sampled(self, designs: Array) -> Evaluation:
        """Evaluate designs at 72 crank positions."""
        return evaluation(designs, self.problem)

    def continuous(self, designs: Array) -> Evaluation:
        """Evaluate designs on the continuous curve."""
        return evaluation(designs, self.problem, continuous=True)


def press_search(
    parameters: CompactionPress, space: DesignSpace, seed: int = 1, effort: Effort = USUAL_EFFORT
) -> PressSearch:
    """Return the search for a press with the duty of the configuration's."""
    return PressSearch(parameters, design_problem(parameters, space.limits), space, seed, effort)


def evaluated(parameters: CompactionPress, space: DesignSpace, designs: Array) -> Evaluation:
    """Return objectives and margins of many designs at 72 crank positions."""
    return evaluation(designs, design_problem(parameters, space.limits))


def scan(asked: PressSearch) -> tuple[Array, Evaluation]:
    """Return designs spread over the space (scrambled Sobol sequence), shape (n, 4), and their evaluation."""
    sequence = qmc.Sobol(VARIABLES, scramble=True, seed=np.random.default_rng(asked.seed))
    designs = asked.space.designs(sequence.random_base2(asked.effort.scan_power))
    return designs, asked.sampled(designs)


def infeasibility(found: Evaluation) -> str:
    """Return which constraint excludes the designs of a scan without a feasible one, with numbers.

    Constraints that no design meets come first; else the one without which most designs would remain; else the two
    that most designs fail together.
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


def feasible_scan(asked: PressSearch) -> tuple[Array, Evaluation]:
    """Return the feasible designs of a scan, or the one that evolution finds where the scan has none.

    Raises
    ------
    InfeasibleSpaceError
        If there is none at all.
    """
    designs, found = scan(asked)
    if not found.feasible.any():
        # the scan may have missed a sliver: let the evolution look for it, violation alone counting
        least = np.argsort(_ranked(found, NO_GOAL), kind="stable")[: asked.effort.population]
        sliver = np.atleast_2d(_evolved(asked, asked.sampled, designs[least], NO_GOAL, asked.effort.generations))
        reached = asked.sampled(sliver)
        if not reached.feasible.any():
            raise InfeasibleSpaceError(f"infeasible: {infeasibility(found)}")
        return sliver, reached
    return designs[found.feasible], Evaluation(found.objectives[found.feasible], found.margins[found.feasible])


def _ranked(found: Evaluation, goal: Goal) -> Array:
    """Return the minimised value of each design: the largest weighted objective; violations rank behind all others."""
    known = np.where(np.isfinite(found.objectives), found.objectives, INFEASIBLE)
    scaled = goal.weights * (known * np.array(SENSES) - goal.ideal) / goal.spread
    violation = np.minimum(np.maximum(-found.margins / SCALES, 0.0), 10.0).sum(axis=1)
    # the small sum keeps the front's points from being merely weakly best
    value = scaled.max(axis=1) + 1e-6 * scaled.sum(axis=1)
    return np.asarray(np.where(violation > 0.0, INFEASIBLE * (1.0 + violation), value))


def _units(space: DesignSpace, designs: Array) -> Array:
    lower, upper = np.array(space.lower), np.array(space.upper)
    width = np.where(upper > lower, upper - lower, 1.0)
    return np.asarray(np.clip((designs - lower) / width, 0.0, 1.0))


def _evolved(asked: PressSearch, evaluate: Evaluate, start: Array, goal: Goal, generations: int) -> Array:
    """Return the best of a differential evolution from a first population, refined by simplex restarts."""

    def value(columns: Any, /) -> Any:
        return _ranked(evaluate(asked.space.designs(np.atleast_2d(columns.T))), goal)

    evolution = differential_evolution(
        value,
        Bounds(np.zeros(VARIABLES), np.ones(VARIABLES)),
        init=_units(asked.space, start),
        maxiter=generations,
        tol=0.0,
        atol=1e-13,
        mutation=(0.4, 0.9),
        recombination=0.9,
        seed=np.random.default_rng(asked.seed),
        polish=False,
        vectorized=True,
        updating="deferred",
        callback=lambda intermediate_result: tell(intermediate_result.nit, generations),
    )
    return asked.space.designs(_sharpened(value, np.asarray(evolution.x), asked.effort.simplex_evaluations))


def _sharpened(value: Callable[[Array], Array], best: Array, evaluations: int) -> Array:
    """Return the best of simplex searches of shrinking size around a point of the unit cube."""

    def single(x: Array) -> float:
        outside = float(np.maximum(-x, 0.0).sum() + np.maximum(x - 1.0, 0.0).sum())
        return float(value(np.clip(x, 0.0, 1.0))[0]) + INFEASIBLE * outside

    for size in SIMPLEX_SIZES:
        ahead = np.where(best + size > 1.0, -size, size)
        simplex = np.vstack((best, best + np.diag(ahead)))
        options = {"initial_simplex": simplex, "maxfev": evaluations, "xatol": 1e-12, "fatol": 1e-13}
        tried = minimize(single, best, method="Nelder-Mead", options=options)
        if tried.fun < single(best):
            best = np.clip(tried.x, 0.0, 1.0)
    return best


def _first_population(designs: Array, found: Evaluation, goal: Goal, size: int) -> Array:
    """Return the best designs of a scan, repeated where there are fewer than asked."""
    order = np.argsort(_ranked(found, goal), kind="stable")
    return np.asarray(designs[order[np.arange(size) % len(order)]])


def sampled_best(asked: PressSearch, goal: Goal, designs: Array, found: Evaluation) -> Array:
    """Return the best design at 72 crank positions, from the feasible designs of a scan."""
    start = _first_population(designs, found, goal, asked.effort.population)
    return _evolved(asked, asked.sampled, start, goal, asked.effort.generations)


def polished(asked: PressSearch, goal: Goal, winner: Array, designs: Array, found: Evaluation) -> Array:
    """Return the best design on the continuous curve, from the winner at 72 positions and the best of the scan."""
    size = asked.effort.polish_population
    units = _units(asked.space, np.atleast_2d(winner))
    spread = np.geomspace(1e-5, 1e-2, size // 2)[:, None]
    around = units + spread * np.random.default_rng(asked.seed).uniform(-1.0, 1.0, (size // 2, VARIABLES))
    near = asked.space.designs(np.clip(np.vstack((units, around)), 0.0, 1.0))
    rest = _first_population(designs, found, goal, size - len(near))
    evolved = _evolved(asked, asked.continuous, np.vstack((near, rest)), goal, asked.effort.polish_generations)
    return _descended(asked, goal, np.ravel(evolved))


def _descended(asked: PressSearch, goal: Goal, design: Array) -> Array:
    """Return the end of a constrained descent (SLSQP) from a design on the continuous curve, or the design.

    It minimises the bound t of all weighted objectives over x in the unit cube, with every margin kept.  In a narrow
    valley between two active limits it proceeds where a population or a simplex stops.
    """
    used = goal.weights > 0.0

    def scaled(found: Evaluation) -> Array:
        distance = found.objectives[:, used] * np.array(SENSES)[used] - goal.ideal[used]
        return np.asarray(goal.weights[used] * distance / goal.spread[used])

    def values(points: Array) -> Array:
        """Return objectives, then margins in their scales, shape (n, used objectives + constraints)."""
        found = asked.continuous(asked.space.designs(points))
        return np.hstack((scaled(found), found.margins / SCALES - RESERVE))

    count = int(used.sum())
    free = np.array(asked.space.upper) > np.array(asked.space.lower)

    def kept(z: Array) -> Array:
        at = values(z[None, :VARIABLES])[0]
        return np.concatenate((z[VARIABLES] - at[:count], at[count:]))

    def slopes(z: Array) -> Array:
        steps = DIFFERENCE * np.eye(VARIABLES)
        at = values(np.vstack((z[:VARIABLES] + steps, z[:VARIABLES] - steps)))
        by = ((at[:VARIABLES] - at[VARIABLES:]) / (2.0 * DIFFERENCE)).T
        by[:, ~free] = 0.0
        by[:count] *= -1.0
        return np.hstack((by, np.concatenate((np.ones(count), np.zeros(len(CONSTRAINTS))))[:, None]))

    best = _units(asked.space, design[None, :])[0]
    ranked = float(_ranked(asked.continuous(design[None, :]), goal)[0])
    for _ in range(POLISH_ROUNDS):
        start = np.append(best, values(best[None, :])[0, :count].max())
        tried = minimize(
            lambda z: float(z[VARIABLES]),
            start,
            jac=lambda z: np.eye(VARIABLES + 1)[VARIABLES],
            bounds=[(0.0, 1.0)] * VARIABLES + [(None, None)],
            constraints={"type": "ineq", "fun": kept, "jac": slopes},
            method="SLSQP",
            options={"maxiter": 100, "ftol": 1e-13},
        )
        point = np.clip(tried.x[:VARIABLES], 0.0, 1.0)
        reached = float(_ranked(asked.continuous(asked.space.designs(point[None, :])), goal)[0])
        if not reached < ranked:
            break
        best, ranked = point, reached
    return np.asarray(asked.space.designs(best[None, :])[0])


def _described(asked: PressSearch, designs: Array) -> list[Design]:
    rows = [Lengths(*(float(length) for length in row)) for row in designs]
    return [described(asked.parameters, lengths, asked.problem.limits) for lengths in rows]


def _held(found: list[Design]) -> list[Design]:
    """Return the designs that keep every limit with their lengths as written.

    Raises
    ------
    InfeasibleSpaceError
        If none does.
    """
    held = [design for design in found if min(design.margins.values()) >= 0.0]
    if not held:
        worst = {name: margin for name, margin in found[0].margins.items() if margin < 0.0}
        broken = ", ".join(f"{name} by {-margin:.3g}" for name, margin in worst.items())
        raise InfeasibleSpaceError(
            f"infeasible: feasible at 72 positions, but on the continuous curve it misses {broken}"
        )
    return held


def single_goal(objective: str, found: Evaluation) -> Goal:
    """Return the goal of one objective, in units of the best a scan has found."""
    column = OBJECTIVES.index(objective)
    weights, spread = np.zeros(len(OBJECTIVES)), np.ones(len(OBJECTIVES))
    weights[column] = 1.0
    spread[column] = abs(float((found.objectives[:, column] * SENSES[column]).min()))
    return Goal(weights, np.zeros(len(OBJECTIVES)), spread)


def best_design(asked: PressSearch, objective: str) -> Design:
    """Return the best design found for one objective; it holds every limit on the continuous curve.

    Raises
    ------
    InfeasibleSpaceError
        If no design meets every constraint, naming the one that kills them.
    """
    designs, found = feasible_scan(asked)
    goal = single_goal(objective, found)
    winner = sampled_best(asked, goal, designs, found)
    return _held(_described(asked, np.atleast_2d(polished(asked, goal, winner, designs, found))))[0]


def non_dominated(values: Array) -> NDArray[np.bool_]:
    """Return which rows are Pareto-optimal (minimisation), shape (n,)."""
    keep = np.ones(len(values), dtype=np.bool_)
    for i in np.argsort(values[:, 0], kind="stable"):
        if keep[i]:
            worse = (values >= values[i]).all(axis=1) & (values > values[i]).any(axis=1)
            keep &= ~worse
    return keep


def pareto_front(asked: PressSearch, objectives: tuple[str, ...] = OBJECTIVES, points: int = 9) -> list[Design]:
    """Return non-dominated designs, sorted by the first objective.

    They are the scan's that are feasible on the continuous curve, one refined design per objective, and one per
    direction between them (weighted largest distance from the ideal).
    """
    columns = [OBJECTIVES.index(name) for name in objectives]
    designs, found = feasible_scan(asked)
    values = found.objectives * np.array(SENSES)
    ideal, spread = values.min(axis=0), np.ptp(values, axis=0) + 1e-12
    directions = np.random.default_rng(asked.seed).dirichlet(np.ones(len(columns)), points)
    front = [designs[non_dominated(values[:, columns])]]
    for i, direction in enumerate([*np.eye(len(columns)), *directions]):
        weights = np.zeros(len(OBJECTIVES))
        weights[columns] = np.maximum(direction, 1e-3)
        goal, turned = Goal(weights, ideal, spread), asked._replace(seed=asked.seed + i)
        winner = sampled_best(turned, goal, designs, found)
        front.append(np.atleast_2d(polished(turned, goal, winner, designs, found)))
    together = _held(_described(asked, np.vstack(front)))
    scored = np.array([[design.objectives[name] for name in objectives] for design in together])
    kept = non_dominated(scored * np.array(SENSES)[columns])
    return sorted(
        (design for design, keep in zip(together, kept, strict=True) if keep),
        key=lambda design: design.objectives[objectives[0]],
    )


def searched(
    parameters: CompactionPress,
    space: DesignSpace,
    objectives: tuple[str, ...],
    seed: int,
    points: int,
    effort: Effort = USUAL_EFFORT,
) -> list[Design]:
    """Return the best design for one objective, or the Pareto front of several with so many refined directions."""
    asked = press_search(parameters, space, seed, effort)
    if len(objectives) == 1:
        return [best_design(asked, objectives[0])]
    return pareto_front(asked, objectives, points)
