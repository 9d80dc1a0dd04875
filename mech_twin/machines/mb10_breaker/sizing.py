# SPDX-License-Identifier: Apache-2.0
"""Sizing of the breaker: spring rate and preload by runs.

The spring's rate is the soft one, k = 0.3 of the blow frequency.  Its preload is the least objective with which every
blow finds the tool seated, in the worst case over a box of tolerances: every number that is assumed, not published,
off by up to the tolerance.

The worst corner is searched one number at a time; the measure is the share of the cycle in flight at a preload below
the limit.  Then the preload chosen is run at the neighbouring corners and at random points within the box.  A point
that breaks a limit becomes the new worst one, until none is found.
"""

from collections.abc import Mapping
from functools import partial
from math import inf, pi
from typing import NamedTuple

from pydantic import ValidationError

from mech_twin.capabilities.design import InShorterSteps
from mech_twin.capabilities.progress import tell
from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import Factors, inner_points, neighbours, scaled, varied
from mech_twin.engine.rollout import roll_out
from mech_twin.engine.run import frames, shorter_step_s
from mech_twin.errors import StudyError
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.metrics import SEATED_GAP_M, SEATED_REST
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.run_metrics import BodyCycle
from mech_twin.machines.mb10_breaker.state import EventSide

# gap at the blow (m), part of the cycle not at rest on the collar, return speed (m/s), largest spring force (N)
LIMITS: dict[str, float] = {
    "gap_at_blow_m": SEATED_GAP_M,
    "flight_share": 1.0 - SEATED_REST,
    "return_speed_m_per_s": inf,
    "largest_force_n": inf,
}
OBJECTIVES = ("largest_force_n", "return_speed_m_per_s", "gap_at_blow_m", "flight_share")
USUAL_TOLERANCE = 0.05
SOFTNESS = 0.3  # k over the blow frequency: soft, so that the spring's force hardly changes over the lift
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

    @property
    def metrics(self) -> dict[str, float]:
        """What limits and objectives speak of, by name."""
        return {name: getattr(self, name) for name in LIMITS}


def settled_run_metrics(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> dict[str, float]:
    """Return the metrics of a run from standstill, the means and peaks of its last blows among them."""
    machine = build(parameters)
    observer = machine.observer()
    for frame in frames(machine, duration_s):
        observer.observe(frame)
    return observer.numbers()


def seating(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> Seating:
    """Return the seating of the tool in a run; under the half sine at the blows of the body's own clock.

    Gap, flight and misses are of all blows from standstill; return speed and force are of the last quarter.

    Raises
    ------
    MotionError
        If the run ends early.
    """
    machine, body = build(parameters), parameters.body
    held = parameters.excitation.kind == "approximated"
    struck, lift = ("collar", "body.body.position") if held else ("tool", "linkage.body.position")
    run = roll_out(machine, duration_s, columns=(lift, "body.memory.blow_angle_rad") if held else (lift,))
    if run.error is not None:
        raise run.error
    steady_s = duration_s * COUNTED_S / SETTLED_S
    blows = missed = 0
    flight = returned = 0.0
    gap = body.tool_radius_m * float(run["body.memory.blow_angle_rad"].max()) if held else 0.0
    cycle = BodyCycle(0.0, 0.0)
    for step, event in run.stepped_events:
        if event.contact == "collar":
            cycle.take_event(event)
            if step * machine.coupling_step_s > steady_s and event.kind in {"touchdown", "settled"}:
                returned = max(returned, abs(event.pre_velocity_m_per_s))
        if event.contact == struck:
            missed += event.kind in {"missed", "stalled"}
            if event.kind == "blow":
                blows += 1
                gap = gap if held else max(gap, body.tool_radius_m * EventSide(*event.pre).body.position)
                flight = max(flight, 1.0 - cycle.contact_share(event.time_s))
                cycle = cycle.next(event)
    top = float(run[lift][run["time_s"] > steady_s].max(initial=0.0))
    force = body.spring_rate_n_per_m * (body.spring_arm_m * top + body.preload_deflection_m)
    return Seating(blows, missed, gap, flight, returned, force)


def in_shorter_steps(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> BreakerParameters:
    """Return the breaker with a shorter coupling step; unchanged if its step is the shortest allowed."""
    try:
        return varied(parameters, {"coupling.step_s": shorter_step_s(build(parameters), duration_s)})
    except ValidationError:
        return parameters


def with_soft_spring(parameters: BreakerParameters) -> BreakerParameters:
    """Return the breaker with the soft spring, k = 0.3 of the blow frequency."""
    omega = 2.0 * pi * parameters.excitation.blow_rate_hz
    rate = parameters.body.inertia_kg_m2 * (SOFTNESS * omega / parameters.body.spring_arm_m) ** 2
    return varied(parameters, {"body.spring_rate_n_per_m": rate})


def with_rest_force(parameters: BreakerParameters, rest_force_n: float) -> BreakerParameters:
    """Return the breaker with the preload that gives this spring force at rest."""
    deflection = rest_force_n / parameters.body.spring_rate_n_per_m
    return varied(parameters, {"body.preload_deflection_m": deflection})


# what the configuration calls assumed and the seating depends on
ASSUMED = {
    "from_forces": (
        "body.inertia_kg_m2",
        "body.restitution",
        "tool.mass_kg",
        "tool.restitution",
        "tool.overtravel_m",
        "linkage.crank_inertia_kg_m2",
    ),
    "approximated": ("body.inertia_kg_m2", "body.restitution", "excitation.amplitude_nm"),
}
FORCES_N = (300.0, 400.0, 500.0, 600.0, 700.0, 850.0, 1000.0, 1300.0, 1700.0, 2300.0, 3000.0)
SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # of the force from which on a half sine does not lift
INNER = 6
SEARCH_RUNS, ROUND_RUNS = 14, 30  # about what the search for an edge takes, and a round over the box after it
MOST_ROUNDS = 5


def seats(found: Seating, limits: Mapping[str, float] = LIMITS) -> bool:
    """Return whether a run had blows, none of them missed, and every one found the tool seated within these limits."""
    seated = found.gap_at_blow_m <= limits["gap_at_blow_m"] and found.flight_share <= limits["flight_share"]
    return found.blows > 0 and found.missed == 0 and seated


class SpringSearch:
    """Search for the preload: the breaker with its soft spring, the limits, the objective, the tolerance of the box.

    Attributes
    ----------
    assumed : tuple of str
        Keys off by the tolerance.
    forces : tuple of float
        Spring forces at rest that are tried first (N).
    """

    def __init__(self, soft: BreakerParameters, limits: Mapping[str, float], objective: str, tolerance: float) -> None:
        self.soft, self.limits, self.objective, self.tolerance = soft, limits, objective, tolerance
        self.assumed = ASSUMED[soft.excitation.kind]
        self.forces: tuple[float, ...] = FORCES_N
        if soft.excitation.kind == "approximated":  # from the force at which the half sine lifts the body no more
            full = abs(soft.excitation.amplitude_nm) / soft.body.spring_arm_m
            self.forces = tuple(full * share for share in SHARES)
        self.runs: dict[tuple[float, tuple[tuple[str, float], ...]], Seating] = {}
        self.expected = 2 * SEARCH_RUNS if tolerance == 0.0 else SEARCH_RUNS + 2 * len(self.assumed)

    def at(self, force: float, factors: Mapping[str, float]) -> Seating:
        """Return the seating with a spring force at rest (N), at a point of the box."""
        key = (force, tuple(sorted(factors.items())))
        if key not in self.runs:
            # the spring is made as it is chosen: its preload does not follow the assumed numbers
            self.runs[key] = seating(scaled(with_rest_force(self.soft, force), factors))
            tell(len(self.runs), self.expected)
        return self.runs[key]

    def kept(self, found: Seating) -> bool:
        """Return whether a run keeps every limit."""
        return seats(found, self.limits) and all(found.metrics[name] <= limit for name, limit in self.limits.items())

    def least_seating(self, factors: Mapping[str, float]) -> tuple[float, float]:
        """Return two spring forces at rest (N), one or two newtons apart: some blow is unseated at the first only."""
        forces = self.forces
        place = next((i for i, force in enumerate(forces) if seats(self.at(force, factors), self.limits)), None)
        if place is None:
            raise StudyError(f"no preload between {forces[0]:g} and {forces[-1]:g} N seats the tool before every blow")
        if place == 0:
            return 0.0, forces[0]
        low, high = forces[place - 1], forces[place]
        while high - low > 2.0:
            middle = float(round(0.5 * (low + high)))
            low, high = (low, middle) if seats(self.at(middle, factors), self.limits) else (middle, high)
        return low, high

    def worst_corner(self, edge_n: float) -> Factors:
        """Return the corner whose deviations each, alone, lengthen the flight just below the nominal limit."""
        if self.tolerance == 0.0:
            return {}

        def flight(key: str, factor: float) -> tuple[float, float]:
            found = self.at(0.97 * edge_n, {key: factor})
            return found.flight_share, found.gap_at_blow_m

        ends = 1.0 - self.tolerance, 1.0 + self.tolerance
        return {key: max(ends, key=partial(flight, key)) for key in self.assumed}

    def least_objective(self, worst: Mapping[str, float], bound_n: float) -> float:
        """Return the spring force at rest (N), at least the bound, with the smallest objective within the limits.

        The best of a few forces, then of the middles between the best and its neighbours, down to two newtons.
        """
        forces = [bound_n, *(force for force in self.forces if force > bound_n)]

        def rank(force: float) -> tuple[bool, float, float]:
            found = self.at(force, worst)
            return not self.kept(found), found.metrics[self.objective], force

        least = min(forces, key=rank)
        if rank(least)[0]:
            seated = [found.metrics for force in forces if seats(found := self.at(force, worst), self.limits)]
            best = {name: min(metrics[name] for metrics in seated) for name in self.limits}
            broken = [
                f"{key} <= {most:.4g} (has {best[key]:.4g})" for key, most in self.limits.items() if best[key] > most
            ]
            text = "; ".join(broken) or "the limits one by one, but not together"
            raise StudyError(f"no preload that seats the tool meets the limits: {text}")
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

    def broken_at(self, force: float, worst: Factors) -> tuple[Factors | None, int]:
        """Return a point of the box at which a preload breaks a limit (None: none found), and how many were tried."""
        if not worst:
            return None, 1
        inner = inner_points(self.assumed, self.tolerance, INNER)
        points: list[Factors] = [{}, *neighbours(worst, self.tolerance), *inner]
        for tried, point in enumerate(points, start=2):
            if not self.kept(self.at(force, point)):
                return point, tried
        return None, len(points) + 1


def sizing(
    parameters: BreakerParameters, limits: Mapping[str, float], objective: str, table: Table, tolerance: float
) -> Sizing:
    """Return spring rate and preload: the smallest objective of those that keep the limits at all points tried.

    Parameters
    ----------
    parameters : BreakerParameters
        Configuration; spring rate and preload are replaced.
    limits : mapping
        Every limit of ``LIMITS``.
    objective : str
        What to make small in the worst case: one of ``OBJECTIVES``.
    table : callable
        Not needed here.
    tolerance : float
        Part of its value by which each assumed number may be off.
    """
    if parameters.body.contact == "none":
        raise StudyError("body.contact is none; expected one_sided, a collar that seats the tool")
    soft = with_soft_spring(parameters)
    search = SpringSearch(soft, limits, objective, tolerance)
    below, nominal = search.least_seating({})
    worst = search.worst_corner(nominal)
    chosen, tried = nominal, 1
    for _ in range(MOST_ROUNDS):
        search.expected += ROUND_RUNS if worst else 0
        low, bound = (below, nominal) if not worst else search.least_seating(worst)
        chosen = search.least_objective(worst, bound)
        broken, tried = search.broken_at(chosen, worst)
        if broken is None:
            break
        worst = broken
    else:
        raise StudyError(
            f"no preload found that keeps the limits within {100.0 * tolerance:g} % in {MOST_ROUNDS} rounds"
        )
    metrics = search.at(chosen, worst).metrics
    shorter = in_shorter_steps(scaled(with_rest_force(soft, chosen), worst))
    constraints = (
        Constraint("rest_force_n", chosen, bound, "above"),
        *(Constraint(name, metrics[name], limit) for name, limit in limits.items() if limit < inf),
    )
    binding = binding_of(constraints, f"none: {objective} is least here")
    if chosen == bound:
        where = "in the worst case" if worst else "as configured"
        rest = 100.0 * (1.0 - limits["flight_share"])
        gap = f"gap_at_blow_m at most {limits['gap_at_blow_m']:.3g}"
        binding = f"every blow on a seated tool, {gap}, at rest for {rest:.3g} % of the cycle: {where} "
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
            {"rest_force_n": force, "seated": "yes" if seats(found, limits) else "no", **found.metrics}
            for (force, factors), found in sorted(search.runs.items())
            if factors == tuple(sorted(worst.items()))
        ),
        tolerance,
        search.assumed if worst else (),
        InShorterSteps(shorter.coupling.step_s, soft.coupling.step_s, seating(shorter).metrics),
    )
