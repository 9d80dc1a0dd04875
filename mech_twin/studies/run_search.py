# SPDX-License-Identifier: Apache-2.0
"""Design search of any machine by simulated runs: bounded keys, an objective, and limits of numbers.

A Sobol sequence is evaluated first; its best points are refined by linear approximations (COBYLA), then by simplices
(Nelder-Mead): peaks have edges, along which linear approximations end early.
The same seed gives the same result for any number of cores.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import qmc

from mech_twin.capabilities.arguments import GREATEST_SEED, bounds_by_name, real_number, whole_number
from mech_twin.capabilities.design import Design, InShorterSteps
from mech_twin.capabilities.progress import tell
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.configuration_tree import ConfigurationError, value_in
from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import MotionError, StudyError
from mech_twin.parameters.load import catalogue_entry, machine_parameters
from mech_twin.studies.declared_studies import refusing
from mech_twin.studies.parameter_sweep import WORTH_SPREADING_S
from mech_twin.studies.shorter_steps import checked_numbers
from mech_twin.studies.spreading import spread, used_cores
from mech_twin.studies.sweep_table import Question, question, require_number, summary

Array = NDArray[np.float64]
Range = tuple[float, float]
Place = tuple[float, ...]  # a point of the unit cube
LARGE = "-"  # prefix of an objective to maximise
SCAN_POWER, MOST_SCAN_POWER = 4, 8  # powers of two: points for one key, one power more per further key; at most
REFINED = 4  # best points of the scan that are refined
EVALUATIONS = 40  # in a refinement, for each key
FIRST_STEP, LAST_STEP = 0.1, 1e-4  # in a refinement, as shares of the range of each key
PENALTY = 30.0  # of a violation, in simplices
BROKEN = 1e3  # violation at a point where the configuration is rejected or the number missing


class JudgedPoint(NamedTuple):
    """A point of the unit cube: objective to minimise, and scaled margins, negative where a limit is violated."""

    place: Place
    objective: float
    margins: Place

    @property
    def rank(self) -> tuple[float, float]:
        """Sorting key: total violation of the limits, then the objective."""
        return sum(max(-margin, 0.0) for margin in self.margins), self.objective


@dataclass(frozen=True)
class RunSearch:
    """A design search.

    Attributes
    ----------
    objective : str
        Number to minimise; with ``-`` before it, to maximise.
    limits : dict
        Lower and upper limits of numbers.
    scales : dict
        Magnitude of each number used, in the unchanged machine.
    """

    asked: Question
    bounds: dict[str, Range]
    objective: str
    limits: dict[str, Range]
    scales: dict[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the objective's number."""
        return self.objective.removeprefix(LARGE)

    def changes(self, place: Sequence[float]) -> dict[str, float]:
        """Return the keys and their values at a point of the unit cube."""
        pairs = zip(self.bounds.items(), place, strict=True)
        return {key: low + share * (high - low) for (key, (low, high)), share in pairs}

    def margins(self, numbers: Mapping[str, float]) -> dict[str, float]:
        """Return the margin to each limit, in the unit of its number; negative if violated."""
        found: dict[str, float] = {}
        for name, (low, high) in self.limits.items():
            value = numbers.get(name, math.nan)
            found |= {f"{name} >= {low:g}": value - low} if math.isfinite(low) else {}
            found |= {f"{name} <= {high:g}": high - value} if math.isfinite(high) else {}
        return found

    def judged(self, place: Sequence[float]) -> JudgedPoint:
        """Return the objective and margins of a point."""
        point = tuple(float(np.clip(share, 0.0, 1.0)) for share in place)
        try:
            numbers = summary(self.asked, self.changes(point))
        except (ConfigurationError, MotionError):
            numbers = {}
        sign = -1.0 if self.objective.startswith(LARGE) else 1.0
        value = sign * numbers.get(self.name, math.nan) / self.scales[self.name]
        margins = [margin / self.scales[name.split(" ")[0]] for name, margin in self.margins(numbers).items()]
        if not math.isfinite(value):
            value, margins = BROKEN, [*margins, -BROKEN]
        else:
            margins = [*margins, 0.0]
        return JudgedPoint(point, value, tuple(margin if math.isfinite(margin) else -BROKEN for margin in margins))


def run_search(
    machine: str,
    parameters: Parameters,
    objective: str,
    bounds: Mapping[str, Range],
    limits: Mapping[str, Range],
    duration_s: float,
) -> RunSearch:
    """Return a search, checked against the numbers of the unchanged machine.

    Raises
    ------
    StudyError
        A key or number does not exist, or a bound or limit is invalid.
    """
    if not isinstance(objective, str):
        raise StudyError(f"objective {objective!r:.80}: expected the name of a number")
    bounds, limits = (
        bounds_by_name("bounds", bounds, "bounds by key"),
        bounds_by_name("limits", limits, "limits by name"),
    )
    if not bounds:
        raise StudyError("a search by runs needs at least one key and its bounds: --bound KEY=LOW:HIGH")
    asked = question(machine, parameters, {key: (low,) for key, (low, _) in bounds.items()}, (), duration_s)
    for key, (low, high) in bounds.items():
        real_number(f"bounds of {key}, low", low, "a finite number")
        real_number(f"bounds of {key}, high", high, f"a finite number above {low:g}")
        if not low < high:
            raise StudyError(f"bounds of {key}: {low:g} < {high:g} fails")
        there = value_in(asked.tree, key)
        if isinstance(there, str | int):
            raise StudyError(
                f"bounds of {key}: {there!r} is a choice or a count; expected a key of real numbers; "
                "a sweep takes its values one by one"
            )
    known = summary(asked, {})
    for what, name in (("objective", objective.removeprefix(LARGE)), *(("limit", name) for name in limits)):
        require_number(asked, name, known, what)
    for name, (low, high) in limits.items():
        if not low <= high or not (math.isfinite(low) or math.isfinite(high)):
            raise StudyError(f"limit {name}: {low:g} <= {high:g} fails; expected NAME=LOW:HIGH, one of them at least")
    counted = (objective.removeprefix(LARGE), *limits)
    scales = {name: abs(known[name]) or 1.0 for name in counted}
    return RunSearch(asked, dict(bounds), objective, dict(limits), scales)


@refusing()
def search_runs(
    machine: str,
    objective: str,
    bounds: Mapping[str, tuple[float, float]],
    *,
    parameters: Parameters | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    duration_s: float = 0.0,
    seed: int = 1,
    cores: int | None = None,
) -> Design:
    """Return the best design of any machine by its report and simulated runs; the same for the same seed.

    Parameters
    ----------
    machine : str
        Machine of the catalogue, or the path of a page.
    objective : str
        Number of the report or of a run to minimise; with ``-`` before it, to maximise.
    bounds : mapping
        Lower and upper bound of each design key.
    parameters : Parameters, optional
        The rest of the configuration; the installed one if absent.
    limits : mapping, optional
        Lower and upper limits of numbers; infinite for none.
    duration_s : float
        Simulated time of each design; 0 for the report alone.
    seed : int
        Seed of the scan.
    cores : int, optional
        Processes to spread over; all cores if absent.

    Raises
    ------
    StudyError
        No design satisfies every limit; the message gives the nearest one.
    """
    known, seed = parameters or machine_parameters(machine), whole_number("seed", seed, 0, GREATEST_SEED)
    asked = run_search(machine, known, objective, bounds, limits or {}, duration_s)
    keys, workers = len(asked.bounds), used_cores(cores)
    power = min(SCAN_POWER + keys - 1, MOST_SCAN_POWER)
    places = qmc.Sobol(keys, scramble=True, seed=np.random.default_rng(seed)).random_base2(power)
    steps = len(places) + REFINED
    points, begun = [tuple(place) for place in places.tolist()], time.monotonic()
    scanned = [asked.judged(points[0])]  # in this process, so that kernels are compiled before others need them
    if (time.monotonic() - begun) * (len(points) + REFINED * EVALUATIONS * keys) < WORTH_SPREADING_S:
        workers = 1
    scanned += _spread(asked.judged, points[1:], workers, steps, 1)
    if len({(point.objective, point.margins) for point in scanned}) == 1 and scanned[0].objective != BROKEN:
        raise StudyError(
            f"{asked.name} is the same at all {len(scanned)} points tried: {', '.join(asked.bounds)} "
            "changes nothing that is asked; is another key in its place?"
        )
    starts = [point.place for point in sorted(scanned, key=lambda point: point.rank)[:REFINED]]
    refined = _spread(partial(refined_from, asked), starts, workers, steps, len(places))
    best = min((*scanned, *refined), key=lambda point: (point.rank, point.place))
    changes = asked.changes(best.place)
    numbers = summary(asked.asked, changes)
    margins = asked.margins(numbers)
    broken = {name: margin for name, margin in margins.items() if not margin >= 0.0}
    if broken:
        nearest = ", ".join(f"{key} = {value:.6g}" for key, value in changes.items())
        shortfalls = ", ".join(f"{name} by {-margin:.4g}" for name, margin in broken.items())
        raise StudyError(f"found no design that keeps every limit; the nearest, {nearest}, misses {shortfalls}")
    found = varied(known, changes)
    return Design(changes, {asked.name: numbers[asked.name]}, margins, found, _checked(asked, found))


def _checked(asked: RunSearch, found: Parameters) -> InShorterSteps | None:
    """Return objective and margins of a design in a run with shorter steps; None without such a run."""
    machine = catalogue_entry(asked.asked.machine).build(found)
    known = dict(machine.report())
    names = {asked.name, *asked.limits} - known.keys()
    if asked.asked.duration_s == 0.0 or not names:
        return None
    try:
        step_s, beside_s, numbers = checked_numbers(machine, asked.asked.duration_s, names)
    except StudyError:
        return None
    return InShorterSteps(step_s, beside_s, {**numbers, **asked.margins({**known, **numbers})})


def refined_from(asked: RunSearch, start: Place) -> JudgedPoint:
    """Return the best point found from a start in `EVALUATIONS` for each key."""
    known: dict[Place, JudgedPoint] = {}
    most = EVALUATIONS * len(start)

    def at(place: Any) -> JudgedPoint:
        point = tuple(float(share) for share in place)
        if point not in known:
            known[point] = asked.judged(point)
        return known[point]

    def inside(place: Any) -> Array:
        return np.concatenate((place, 1.0 - np.asarray(place)))

    limited = [{"type": "ineq", "fun": inside}, {"type": "ineq", "fun": lambda place: np.array(at(place).margins)}]
    minimize(
        lambda place: at(place).objective,
        np.array(start),
        method="COBYLA",
        constraints=limited,
        options={"rhobeg": FIRST_STEP, "tol": LAST_STEP, "maxiter": most},
    )
    best, before = min(known.values(), key=lambda point: point.rank), None
    while best is not before and len(known) < most:
        best, before = _by_simplices(at, best, most - len(known)), best
    return best


def _by_simplices(at: Callable[[Any], JudgedPoint], start: JudgedPoint, most: int) -> JudgedPoint:
    """Return the best of at most so many points from a start on, itself among them."""
    best, place = start, np.array(start.place)

    def cost(tried: Any) -> float:
        nonlocal best
        point = at(tried)
        best = min(best, point, key=lambda each: each.rank)
        return point.objective + PENALTY * point.rank[0]

    steps = np.diag(np.where(place > 0.5, -FIRST_STEP, FIRST_STEP))
    first, bounds = np.vstack((place, place + steps)), [(0.0, 1.0)] * len(place)
    options = {"initial_simplex": first, "xatol": LAST_STEP, "fatol": LAST_STEP, "maxfev": most}
    minimize(cost, place, method="Nelder-Mead", bounds=bounds, options=options)
    return best


def _spread(
    function: Callable[[Place], JudgedPoint], points: list[Place], cores: int, steps: int, done: int
) -> list[JudgedPoint]:
    """Return the results of a function at points, computed on several cores, sorted by point."""
    found: list[JudgedPoint] = []
    with closing(spread(function, points, cores)) as results:
        for result in results:
            found.append(result)
            tell(done + len(found), steps)
    return sorted(found, key=lambda point: point.place)
