"""Spring and preload of the breaker's body."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, pi, sqrt

from mech_twin.machines.mb10_breaker_parameters import BreakerParameters
from mech_twin.parts.pressed_body.owner import with_preload
from mech_twin.parts.pressed_body.parameters import pressed_body
from mech_twin.studies.errors import StudyError
from mech_twin.studies.pressing import CollarPoint, collar_point, rational_ranges
from mech_twin.studies.sizing.answer import Constraint, Sizing, binding_of
from mech_twin.studies.variation import varied

# gap at the blow (m), return speed (m/s), largest spring force (N); 0.02 mm is a tool that is seated
LIMITS: dict[str, float] = {"gap_at_blow_m": 2e-5, "return_speed_m_per_s": inf, "largest_force_n": inf}
OBJECTIVES = ("largest_force_n", "return_speed_m_per_s", "gap_at_blow_m")
SOFTNESS = 0.3  # k over the blow frequency: soft, so that the spring's force hardly changes over the lift
STEPS = 200


def sizing(parameters: BreakerParameters, limits: Mapping[str, float], objective: str) -> Sizing:
    """Return spring rate and preload in the rational range under the half sine.

    The rate keeps k at 0.3 of the blow frequency; the preload is the one with the smallest objective between settling
    in time (lower bound) and never lifting (p = 1).
    """
    if parameters.excitation.kind != "approximated":
        raise StudyError("the half sine is meant: set excitation.kind=approximated, body.inertia_kg_m2=0.35")
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


def _figure(point: CollarPoint, name: str) -> float:
    value: float = getattr(point.figures, name)
    return value


def _kept(point: CollarPoint, limits: Mapping[str, float]) -> bool:
    return point.seated and all(_figure(point, name) <= limit for name, limit in limits.items())


def _nearest(found: Mapping[float, CollarPoint], limits: Mapping[str, float]) -> str:
    """Return the limits broken, each with the best value there is."""
    best = {name: min(_figure(point, name) for point in found.values()) for name in limits}
    broken = [f"{name} <= {limit:.4g} (has {best[name]:.4g})" for name, limit in limits.items() if best[name] > limit]
    return "; ".join(broken) or "the limits one by one, but not together"
