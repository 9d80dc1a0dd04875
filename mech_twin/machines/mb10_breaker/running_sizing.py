# SPDX-License-Identifier: Apache-2.0
"""Preload of the running breaker: the tool seated before every blow, in the worst case over the tolerances.

The worst corner is sought one number at a time; the measure is the share of the cycle in flight at a preload below
the limit.  Then the preload chosen is run at the neighbouring corners and at random points within the box.  A point
that breaks a limit becomes the new worst one, until none is found.

A run of the breaker from standstill until it is steady, and the breaker with another preload.
"""

from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from typing import NamedTuple

from pydantic import ValidationError

from mech_twin.capabilities.design import InShorterSteps
from mech_twin.capabilities.progress import tell
from mech_twin.capabilities.sizing import Constraint, Sizing, binding_of
from mech_twin.capabilities.variation import Factors, inner_points, neighbours, scaled, varied
from mech_twin.engine.rollout import roll_out
from mech_twin.engine.run import frames, shorter_step_s
from mech_twin.errors import StudyError
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.run_metrics import BodyCycle
from mech_twin.machines.mb10_breaker.sizing import LIMITS, out_of_reach
from mech_twin.machines.mb10_breaker.state import EventSide

SETTLED_S = 8.0  # of a run from standstill: some eighty blows, the last twenty of which count
COUNTED_S = 6.0  # from then on a cycle counts as steady in a seating run of SETTLED_S


class Seating(NamedTuple):
    """Seating of the tool in a run from standstill: blows, misses, worst gap and flight share, extremes once steady."""

    blows: int
    missed: int
    gap_at_blow_m: float
    flight_share: float
    return_speed_m_per_s: float
    largest_force_n: float


def settled_run_metrics(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> dict[str, float]:
    """Return the metrics of a run from standstill, the means and peaks of its last blows among them."""
    machine = build(parameters)
    observer = machine.observer()
    for frame in frames(machine, duration_s):
        observer.observe(frame)
    return observer.numbers()


def seating(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> Seating:
    """Return the seating of the tool in a run.

    Gap, flight and misses are of all blows from standstill; return speed and force are of the last quarter.

    Raises
    ------
    MotionError
        If the run ends early.
    """
    machine, body = build(parameters), parameters.body
    run = roll_out(machine, duration_s, columns=("linkage.body.position",))
    if run.error is not None:
        raise run.error
    steady_s = duration_s * COUNTED_S / SETTLED_S
    blows = missed = 0
    gap = flight = returned = 0.0
    cycle = BodyCycle(0.0, 0.0)
    for step, event in run.stepped_events:
        if event.contact == "collar":
            cycle.take_event(event)
        if event.contact == "tool":
            blows += event.kind == "blow"
            missed += event.kind in {"missed", "stalled"}
            if event.kind == "blow":
                gap = max(gap, body.tool_radius_m * EventSide(*event.pre).body.position)
                flight = max(flight, 1.0 - cycle.contact_share(event.time_s))
                cycle = cycle.next(event)
        elif step * machine.coupling_step_s > steady_s and event.kind in {"touchdown", "settled"}:
            returned = max(returned, abs(event.pre_velocity_m_per_s))
    lift = float(run["linkage.body.position"][run["time_s"] > steady_s].max(initial=0.0))
    force = body.spring_rate_n_per_m * (body.spring_arm_m * lift + body.preload_deflection_m)
    return Seating(blows, missed, gap, flight, returned, force)


def in_shorter_steps(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> BreakerParameters:
    """Return the breaker with a shorter coupling step; unchanged if its step is the shortest allowed."""
    try:
        return varied(parameters, {"coupling.step_s": shorter_step_s(build(parameters), duration_s)})
    except ValidationError:
        return parameters


def with_rest_force(parameters: BreakerParameters, rest_force_n: float) -> BreakerParameters:
    """Return the breaker with the preload that gives this spring force at rest."""
    deflection = rest_force_n / parameters.body.spring_rate_n_per_m
    return varied(parameters, {"body.preload_deflection_m": deflection})


# what the configuration calls assumed and the seating depends on
ASSUMED = (
    "body.inertia_kg_m2",
    "body.restitution",
    "tool.mass_kg",
    "tool.restitution",
    "tool.overtravel_m",
    "linkage.crank_inertia_kg_m2",
)
FORCES_N = (300.0, 400.0, 500.0, 600.0, 700.0, 850.0, 1000.0, 1300.0, 1700.0, 2300.0, 3000.0)
INNER = 6
SEARCH_RUNS, ROUND_RUNS = 14, 30  # about what the search for an edge takes, and a round over the box after it
MOST_ROUNDS = 5
SEATED = ("gap_at_blow_m", "flight_share")
NAMES = (*SEATED, "return_speed_m_per_s", "largest_force_n")
Run = Callable[[float, Mapping[str, float]], Seating]


def seats(found: Seating, limits: Mapping[str, float] = LIMITS) -> bool:
    """Return whether a run had blows, none of them missed, and every one found the tool seated within these limits."""
    return found.blows > 0 and found.missed == 0 and all(getattr(found, name) <= limits[name] for name in SEATED)


def running_sizing(soft: BreakerParameters, limits: Mapping[str, float], objective: str, tolerance: float) -> Sizing:
    """Return the preload with the smallest objective of those that keep the limits at all points tried."""
    runs: dict[tuple[float, tuple[tuple[str, float], ...]], Seating] = {}
    expected = 2 * SEARCH_RUNS if tolerance == 0.0 else SEARCH_RUNS + 2 * len(ASSUMED)

    def at(force: float, factors: Mapping[str, float]) -> Seating:
        key = (force, tuple(sorted(factors.items())))
        if key not in runs:
            # the spring is made as it is chosen: its preload does not follow the assumed numbers
            runs[key] = seating(scaled(with_rest_force(soft, force), factors))
            tell(len(runs), expected)
        return runs[key]

    below, nominal = _least_seating(at, {}, limits)
    worst = _worst_corner(at, nominal, tolerance)
    chosen, tried = nominal, 1
    for _ in range(MOST_ROUNDS):
        expected += ROUND_RUNS if worst else 0
        low, bound = (below, nominal) if not worst else _least_seating(at, worst, limits)
        chosen = _least_objective(at, worst, bound, limits, objective)
        broken, tried = _broken_at(at, chosen, worst, limits, tolerance)
        if broken is None:
            break
        worst = broken
    else:
        raise StudyError(
            f"no preload found that keeps the limits within {100.0 * tolerance:g} % in {MOST_ROUNDS} rounds"
        )
    metrics = _metrics(at(chosen, worst))
    shorter = in_shorter_steps(scaled(with_rest_force(soft, chosen), worst))
    constraints = (
        Constraint("rest_force_n", chosen, bound, "above"),
        *(Constraint(name, metrics[name], limit) for name, limit in limits.items() if limit < inf),
    )
    binding = binding_of(constraints, f"none: {objective} is least here")
    if chosen == bound:
        where = "in the worst case" if worst else "as configured"
        rest = 100.0 * (1.0 - limits["flight_share"])
        binding = f"every blow on a seated tool, at rest for {rest:.3g} % of the cycle: {where} "
        binding += f"not at {low:.0f} N at rest, but at {bound:.0f} N"
    sized = with_rest_force(soft, chosen)
    return Sizing(
        "mb10_breaker",
        objective,
        {
            "body.spring_rate_n_per_m": soft.body.spring_rate_n_per_m,
            "body.preload_deflection_m": sized.body.preload_deflection_m,
        },
        sized,
        {
            "rest_force_n": chosen,
            "rational_from_rest_force_n": bound,
            "nominal_edge_rest_force_n": nominal,
            "points_tried_in_the_box": float(tried),
            **metrics,
            **{f"worst_factor_of_{key}": factor for key, factor in worst.items()},
        },
        constraints,
        binding,
        tuple(
            {"rest_force_n": force, "seated": "yes" if seats(found, limits) else "no", **_metrics(found)}
            for (force, factors), found in sorted(runs.items())
            if factors == tuple(sorted(worst.items()))
        ),
        tolerance,
        ASSUMED if worst else (),
        InShorterSteps(shorter.coupling.step_s, soft.coupling.step_s, _metrics(seating(shorter))),
    )


def _metrics(found: Seating) -> dict[str, float]:
    return {name: float(getattr(found, name)) for name in NAMES}


def _kept(found: Seating, limits: Mapping[str, float]) -> bool:
    return seats(found, limits) and all(float(getattr(found, name)) <= limit for name, limit in limits.items())


def _least_seating(at: Run, factors: Mapping[str, float], limits: Mapping[str, float]) -> tuple[float, float]:
    """Return two spring forces at rest (N), one or two newtons apart: some blow is unseated at the first only."""
    place = next((i for i, force in enumerate(FORCES_N) if seats(at(force, factors), limits)), None)
    if place is None:
        raise StudyError(f"no preload between {FORCES_N[0]:g} and {FORCES_N[-1]:g} N seats the tool before every blow")
    if place == 0:
        return 0.0, FORCES_N[0]
    low, high = FORCES_N[place - 1], FORCES_N[place]
    while high - low > 2.0:
        middle = float(round(0.5 * (low + high)))
        low, high = (low, middle) if seats(at(middle, factors), limits) else (middle, high)
    return low, high


def _worst_corner(at: Run, edge_n: float, tolerance: float) -> Factors:
    """Return the corner of the box whose deviations each, alone, lengthen the flight just below the nominal limit."""
    if tolerance == 0.0:
        return {}

    def flight(key: str, factor: float) -> tuple[float, float]:
        found = at(0.97 * edge_n, {key: factor})
        return found.flight_share, found.gap_at_blow_m

    return {key: max((1.0 - tolerance, 1.0 + tolerance), key=partial(flight, key)) for key in ASSUMED}


def _least_objective(
    at: Run, worst: Mapping[str, float], bound_n: float, limits: Mapping[str, float], objective: str
) -> float:
    """Return the spring force at rest (N), at least the bound, with the smallest objective within the limits.

    The best of a few forces, then of the middles between the best and its neighbours, down to two newtons.
    """
    forces = [bound_n, *(force for force in FORCES_N if force > bound_n)]

    def rank(force: float) -> tuple[bool, float, float]:
        found = at(force, worst)
        return not _kept(found, limits), float(getattr(found, objective)), force

    good = [force for force in forces if _kept(at(force, worst), limits)]
    if not good:
        tried = [at(force, worst) for force in forces]
        best = {name: min(float(getattr(found, name)) for found in tried if seats(found, limits)) for name in limits}
        raise StudyError(f"no preload that seats the tool meets the limits: {out_of_reach(best, limits)}")
    least = min(good, key=rank)
    place = forces.index(least)
    low, high = forces[max(place - 1, 0)], forces[min(place + 1, len(forces) - 1)]
    while max(least - low, high - least) > 2.0:
        upper = high - least > least - low
        middle = float(round(0.5 * (least + (high if upper else low))))
        if rank(middle) < rank(least):
            low, least, high = (least, middle, high) if upper else (low, middle, least)
        else:
            low, high = (low, middle) if upper else (middle, high)
    return least


def _broken_at(
    at: Run, force: float, worst: Factors, limits: Mapping[str, float], tolerance: float
) -> tuple[Factors | None, int]:
    """Return a point of the box at which this preload breaks a limit (None: none found), and how many were tried."""
    if not worst:
        return None, 1
    points: list[Factors] = [{}, *neighbours(worst, tolerance), *inner_points(ASSUMED, tolerance, INNER)]
    for tried, point in enumerate(points, start=2):
        if not _kept(at(force, point), limits):
            return point, tried
    return None, len(points) + 1
