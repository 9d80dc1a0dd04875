"""Spring and preload of the breaker's body."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, pi, sqrt

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.pressed_body.metrics import with_preload
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.settled_run import settled_run_metrics, with_rest_force
from mech_twin.machines.mb10_breaker.spring_curves import CollarPoint, collar_point, rational_ranges

# gap at the blow (m), return speed (m/s), largest spring force (N); 0.02 mm is a tool that is seated
LIMITS: dict[str, float] = {"gap_at_blow_m": 2e-5, "return_speed_m_per_s": inf, "largest_force_n": inf}
OBJECTIVES = ("largest_force_n", "return_speed_m_per_s", "gap_at_blow_m")
SOFTNESS = 0.3  # k over the blow frequency: soft, so that the spring's force hardly changes over the lift
STEPS = 200
RUN_S = 8.0
FORCES_N = (300.0, 400.0, 500.0, 600.0, 700.0, 850.0, 1000.0, 1300.0, 1700.0, 2300.0, 3000.0)
RUN_NAMES = {
    "gap_at_blow_m": "steady_gap_at_blow_m",
    "return_speed_m_per_s": "steady_largest_return_speed_m_per_s",
    "largest_force_n": "largest_spring_force_n",
}


def sizing(
    parameters: BreakerParameters, limits: Mapping[str, float], objective: str, table: Table, tolerance: float = 0.0
) -> Sizing:
    """Return spring rate and preload in the rational range.

    The rate keeps k at 0.3 of the blow frequency.  Under the half sine the preload is the one with the smallest
    objective between settling in time (lower bound) and never lifting (p = 1); of the running machine it is the one
    with the smallest objective among those that seat the tool before every blow.
    """
    if parameters.excitation.kind == "from_forces":
        return _running(parameters, limits, objective)
    omega = 2.0 * pi * parameters.excitation.blow_rate_hz
    rate = parameters.body.inertia_kg_m2 * (SOFTNESS * omega / parameters.body.spring_arm_m) ** 2
    soft = varied(parameters, {"body.spring_rate_n_per_m": rate})
    constants = pressed_body(soft.body, soft.excitation)
    (span,) = rational_ranges(soft.body, soft.excitation, (rate,))
    low = span.ratios.settled
    places = [low + (1.0 - low) * i / STEPS for i in range(STEPS + 1)]
    found = {p: collar_point(with_preload(constants, p)) for p in places}
    good = {p: point for p, point in found.items() if _kept(point, limits)}
    if not good:
        raise StudyError("no preload of the rational range meets the limits: " + _nearest(found, limits))
    p = min(good, key=lambda place: (_figure(good[place], objective), place))
    chosen = varied(soft, {"body.preload_deflection_m": good[p].preload_deflection_m})
    constraints = (
        Constraint("preload_ratio", p, low, "above"),
        Constraint("preload_ratio", p, 1.0),
        *(Constraint(name, _figure(good[p], name), limit) for name, limit in limits.items() if limit < inf),
    )
    step = places[places.index(p) - 1] if places.index(p) > 0 else None
    broken = "" if step is None or _kept(found[step], limits) else _nearest({step: found[step]}, limits)
    where = f"a step less preload breaks {broken}" if broken else f"none: {objective} is least here"
    return Sizing(
        "mb10_breaker",
        objective,
        {"body.spring_rate_n_per_m": rate, "body.preload_deflection_m": good[p].preload_deflection_m},
        chosen,
        {
            "preload_ratio": p,
            "rest_force_n": rate * good[p].preload_deflection_m,
            "frequency_ratio": sqrt(rate / parameters.body.inertia_kg_m2) * parameters.body.spring_arm_m / omega,
            "rational_from_ratio": low,
            "first_return_before_blow_ratio": span.ratios.returned,
            **{name: _figure(good[p], name) for name in LIMITS},
        },
        constraints,
        (broken and f"{where}") or binding_of(constraints, where),
        tuple(
            {"preload_ratio": place, **{name: _figure(found[place], name) for name in LIMITS}} for place in places[::20]
        ),
    )


def seats(figures: Mapping[str, float]) -> bool:
    """Return whether a run had blows, and every one of them on a seated tool."""
    lost = figures["missed_blows"] + figures["unseated_blows"] + figures["stalled"]
    return lost == 0.0 and "steady_blows" in figures


def _running(parameters: BreakerParameters, limits: Mapping[str, float], objective: str) -> Sizing:
    omega = 2.0 * pi * parameters.excitation.blow_rate_hz
    rate = parameters.body.inertia_kg_m2 * (SOFTNESS * omega / parameters.body.spring_arm_m) ** 2
    soft = varied(parameters, {"body.spring_rate_n_per_m": rate})
    found: dict[float, dict[str, float]] = {}

    def at(force: float) -> dict[str, float]:
        if force not in found:
            found[force] = settled_run_metrics(with_rest_force(soft, force), RUN_S)
        return found[force]

    low, bound = _least_seating(at)
    for force in FORCES_N:
        if force > bound:
            at(force)
    good = [force for force, figures in found.items() if force >= bound and _run_kept(figures, limits)]
    if not good:
        best = {name: min(f.get(RUN_NAMES[name], inf) for f in found.values() if seats(f)) for name in limits}
        text = "; ".join(f"{name} <= {limit:.4g} (has {best[name]:.4g})" for name, limit in limits.items())
        raise StudyError(f"no preload that seats the tool meets the limits: {text}")
    chosen = min(good, key=lambda force: (at(force)[RUN_NAMES[objective]], force))
    figures = {name: at(chosen)[key] for name, key in RUN_NAMES.items()}
    constraints = (
        Constraint("rest_force_n", chosen, bound, "above"),
        *(Constraint(name, figures[name], limit) for name, limit in limits.items() if limit < inf),
    )
    binding = binding_of(constraints, f"none: {objective} is least here")
    if chosen == bound:
        binding = f"every blow on a seated tool: at {low:.0f} N at rest blows are unseated, at {bound:.0f} N none"
    sized = with_rest_force(soft, chosen)
    return Sizing(
        "mb10_breaker",
        objective,
        {"body.spring_rate_n_per_m": rate, "body.preload_deflection_m": sized.body.preload_deflection_m},
        sized,
        {"rest_force_n": chosen, "rational_from_rest_force_n": bound, **figures},
        constraints,
        binding,
        tuple(
            {
                "rest_force_n": force,
                "seated": "yes" if seats(found[force]) else "no",
                **{name: found[force].get(key, inf) for name, key in RUN_NAMES.items()},
            }
            for force in sorted(found)
        ),
    )


def _least_seating(at: Callable[[float], dict[str, float]]) -> tuple[float, float]:
    """Return two rest forces (N) a newton or so apart: blows are unseated at the first, at the second none."""
    place = next((i for i, force in enumerate(FORCES_N) if seats(at(force))), None)
    if place is None:
        raise StudyError(f"no preload between {FORCES_N[0]:g} and {FORCES_N[-1]:g} N seats the tool before every blow")
    if place == 0:
        return 0.0, FORCES_N[0]
    low, high = FORCES_N[place - 1], FORCES_N[place]
    while high - low > 2.0:
        middle = float(round(0.5 * (low + high)))
        low, high = (low, middle) if seats(at(middle)) else (middle, high)
    return low, high


def _run_kept(figures: Mapping[str, float], limits: Mapping[str, float]) -> bool:
    return seats(figures) and all(figures[RUN_NAMES[name]] <= limit for name, limit in limits.items())


def _figure(point: CollarPoint, name: str) -> float:
    value: float = getattr(point.metrics, name)
    return value


def _kept(point: CollarPoint, limits: Mapping[str, float]) -> bool:
    return point.seated and all(_figure(point, name) <= limit for name, limit in limits.items())


def _nearest(found: Mapping[float, CollarPoint], limits: Mapping[str, float]) -> str:
    """Return the limits broken, each with the best value there is."""
    best = {name: min(_figure(point, name) for point in found.values()) for name in limits}
    broken = [f"{name} <= {limit:.4g} (has {best[name]:.4g})" for name, limit in limits.items() if best[name] > limit]
    return "; ".join(broken) or "the limits one by one, but not together"
