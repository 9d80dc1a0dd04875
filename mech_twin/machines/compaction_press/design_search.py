# SPDX-License-Identifier: Apache-2.0
"""Search for a press: the best design for one objective, the Pareto front of several, or why there is none.

A compiled scan of a Sobol sequence at 72 crank positions finds the feasible part of the space.  From the scan's best
designs constrained descents (SLSQP) on the continuous curve lead to the winner, which must keep every limit there.
The same seed gives the same result.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import qmc

from mech_twin.capabilities.design import Array, Design, DesignSpace, Evaluation
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

LOWER, UPPER = Lengths(0.02, 0.3, 0.1, 0.1), Lengths(0.12, 0.8, 0.5, 0.6)
BOUNDS: dict[str, tuple[float, float]] = dict(zip(Lengths._fields, zip(LOWER, UPPER, strict=True), strict=True))
LIMITS: dict[str, float] = Limits()._asdict()
SCALES = np.array(Margins(20.0, 0.05, 50.0, 1.0, 85.0, 0.1, 0.1, 0.1))  # to add up violations of different units
INFEASIBLE = 1e6
VARIABLES = len(Lengths._fields)
SCAN_POWER = 16  # of two: designs of the scan
STARTS = 4  # designs of the scan from which the descents begin; many more where none is feasible
SLIVER_STARTS = 40
WORST = 10.0  # scales by which a limit counts as broken at most
DIFFERENCE = 1e-6  # of the unit cube, on either side of a point: gradients on the continuous curve
RESERVE = 1e-9  # of each constraint's scale, so that rounding of the written lengths breaks no limit
ROUNDS = 5  # of sequential quadratic programming, each from the best so far


class Goal(NamedTuple):
    """Minimised value: the largest weighted distance of an objective from its ideal over its spread (objectives,)."""

    weights: Array
    ideal: Array
    spread: Array


NO_GOAL = Goal(np.zeros(len(OBJECTIVES)), np.zeros(len(OBJECTIVES)), np.ones(len(OBJECTIVES)))


class InfeasibleSpaceError(StudyError):
    """No design of the space meets every constraint; the message names the decisive one."""


class PressSearch(NamedTuple):
    """A configuration with its design problem, the space searched, and the seed of the scan."""

    parameters: CompactionPress
    problem: Problem
    space: DesignSpace
    seed: int

    def sampled(self, designs: Array) -> Evaluation:
        """Evaluate designs at 72 crank positions."""
        return evaluation(designs, self.problem)

    def continuous(self, designs: Array) -> Evaluation:
        """Evaluate designs on the continuous curve."""
        return evaluation(designs, self.problem, continuous=True)


def press_search(parameters: CompactionPress, space: DesignSpace, seed: int = 1) -> PressSearch:
    """Return the search for a press with the duty of the configuration's."""
    return PressSearch(parameters, design_problem(parameters, space.limits), space, seed)


def evaluated(parameters: CompactionPress, space: DesignSpace, designs: Array) -> Evaluation:
    """Return objectives and margins of many designs at 72 crank positions."""
    return evaluation(designs, design_problem(parameters, space.limits))


def scan(asked: PressSearch) -> tuple[Array, Evaluation]:
    """Return designs spread over the space (scrambled Sobol sequence), shape (n, 4), and their evaluation."""
    sequence = qmc.Sobol(VARIABLES, scramble=True, seed=np.random.default_rng(asked.seed))
    designs = asked.space.designs(sequence.random_base2(SCAN_POWER))
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
    """Return the feasible designs of a scan, or the one that a descent of the violation finds where it has none.

    Raises
    ------
    InfeasibleSpaceError
        If there is none at all.
    """
    designs, found = scan(asked)
    if not found.feasible.any():  # the scan may have missed a sliver
        least = designs[np.argsort(_ranked(found, NO_GOAL), kind="stable")[:SLIVER_STARTS]]
        ends = (descended(asked, NO_GOAL, design)[None, :] for design in least)
        sliver = next((end for end in ends if asked.continuous(end).feasible.all()), None)
        if sliver is None:
            raise InfeasibleSpaceError(f"infeasible: {infeasibility(found)}")
        return sliver, asked.continuous(sliver)
    return designs[found.feasible], Evaluation(found.objectives[found.feasible], found.margins[found.feasible])


def _finite(objectives: Array) -> Array:
    return np.where(np.isfinite(objectives), objectives, INFEASIBLE)


def _ranked(found: Evaluation, goal: Goal) -> Array:
    """Return the minimised value of each design: the largest weighted objective; violations rank behind all others."""
    scaled = goal.weights * (_finite(found.objectives) * np.array(SENSES) - goal.ideal) / goal.spread
    violation = np.minimum(np.maximum(-found.margins / SCALES, 0.0), WORST).sum(axis=1)
    # the small sum keeps the front's points from being merely weakly best
    value = scaled.max(axis=1) + 1e-6 * scaled.sum(axis=1)
    return np.asarray(np.where(violation > 0.0, INFEASIBLE * (1.0 + violation), value))


def descended(asked: PressSearch, goal: Goal, design: Array) -> Array:
    """Return the end of constrained descents (SLSQP) from a design on the continuous curve, or the design.

    They minimise the bound t of all weighted objectives over x in the unit cube, with every margin kept; without a
    goal, t is the bound of all violations.
    """
    used, space = goal.weights > 0.0, asked.space
    count = int(used.sum())
    lower, upper = np.array(space.lower), np.array(space.upper)
    free = upper > lower

    def values(points: Array) -> Array:
        """Return objectives, then margins in their scales, shape (n, used objectives + constraints)."""
        found = asked.continuous(space.designs(points))
        distance = _finite(found.objectives)[:, used] * np.array(SENSES)[used] - goal.ideal[used]
        margins = np.maximum(found.margins / SCALES - RESERVE, -WORST)
        return np.hstack((goal.weights[used] * distance / goal.spread[used], margins))

    def kept(z: Array) -> Array:
        at = values(z[None, :VARIABLES])[0]
        bound = z[VARIABLES]
        return np.concatenate((bound - at[:count], at[count:])) if count else at + bound

    def slopes(z: Array) -> Array:
        steps = DIFFERENCE * np.eye(VARIABLES)
        at = values(np.vstack((z[:VARIABLES] + steps, z[:VARIABLES] - steps)))
        by = ((at[:VARIABLES] - at[VARIABLES:]) / (2.0 * DIFFERENCE)).T
        by[:, ~free] = 0.0
        by[:count] *= -1.0
        of_bound = np.arange(len(by)) < (count or len(by))
        return np.hstack((by, of_bound[:, None]))

    best = np.clip((design - lower) / np.where(free, upper - lower, 1.0), 0.0, 1.0)
    ranked = float(_ranked(asked.continuous(design[None, :]), goal)[0])
    for _ in range(ROUNDS):
        at = values(best[None, :])[0]
        start = np.append(best, at[:count].max() if count else -at.min())
        tried = minimize(
            lambda z: float(z[VARIABLES]),
            start,
            jac=lambda z: np.eye(VARIABLES + 1)[VARIABLES],
            bounds=[(0.0, 1.0)] * VARIABLES + [(None, None)],
            constraints={"type": "ineq", "fun": kept, "jac": slopes},
            method="SLSQP",
            options={"maxiter": 100, "ftol": 1e-13},
        )
        point = np.clip(tried.x[:VARIABLES].round(12), 0.0, 1.0)
        reached = float(_ranked(asked.continuous(space.designs(point[None, :])), goal)[0])
        if not reached < ranked:
            break
        best, ranked = point, reached
    return np.asarray(space.designs(best[None, :])[0])


def refined(asked: PressSearch, goal: Goal, designs: Array, found: Evaluation) -> Array:
    """Return the best end of the descents from the best designs of a scan."""
    starts = designs[np.argsort(_ranked(found, goal), kind="stable")[:STARTS]]
    ends = np.array([descended(asked, goal, start) for start in starts])
    return np.asarray(ends[int(np.argmin(_ranked(asked.continuous(ends), goal)))])


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
    return _held(_described(asked, refined(asked, goal, designs, found)[None, :]))[0]


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
    direction between them (weighted largest distance from the best of each, over how far apart these designs are).
    """
    columns = [OBJECTIVES.index(name) for name in objectives]
    designs, found = feasible_scan(asked)
    values = found.objectives * np.array(SENSES)
    front: list[Array] = []

    def add(goal: Goal) -> None:
        front.append(refined(asked, goal, designs, found))
        tell(len(front), len(columns) + points)

    for name in objectives:
        add(single_goal(name, found))
    ends = asked.continuous(np.array(front)).objectives * np.array(SENSES)
    ideal, spread = ends.min(axis=0), np.ptp(ends, axis=0) + 1e-12
    for direction in np.random.default_rng(asked.seed).dirichlet(np.ones(len(columns)), points):
        weights = np.zeros(len(OBJECTIVES))
        weights[columns] = np.maximum(direction, 1e-3)
        add(Goal(weights, ideal, spread))
    together = _held(_described(asked, np.vstack((designs[non_dominated(values[:, columns])], front))))
    scored = np.array([[design.objectives[name] for name in objectives] for design in together])
    kept = non_dominated(scored * np.array(SENSES)[columns])
    return sorted(
        (design for design, keep in zip(together, kept, strict=True) if keep),
        key=lambda design: design.objectives[objectives[0]],
    )


def searched(
    parameters: CompactionPress, space: DesignSpace, objectives: tuple[str, ...], seed: int, points: int
) -> list[Design]:
    """Return the best design for one objective, or the Pareto front of several with so many refined directions."""
    asked = press_search(parameters, space, seed)
    if len(objectives) == 1:
        return [best_design(asked, objectives[0])]
    return pareto_front(asked, objectives, points)
