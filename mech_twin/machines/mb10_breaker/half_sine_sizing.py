# SPDX-License-Identifier: Apache-2.0
"""Preload of the breaker's body under the half sine: the worst case over every corner of the tolerances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.sizing import Constraint, Sizing, binding_of
from mech_twin.capabilities.tolerance_box import corners, inner_points, scaled
from mech_twin.capabilities.variation import varied
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.pressed_body.parameters import PressedBody, pressed_body
from mech_twin.machines.mb10_breaker.spring_curves import collar_point, rational_ranges

ASSUMED = ("body.inertia_kg_m2", "body.restitution", "excitation.amplitude_nm")
NAMES = ("gap_at_blow_m", "flight_share", "return_speed_m_per_s", "largest_force_n")
STEPS = 200
INNER = 8
Worst = dict[str, float]


def half_sine_sizing(soft: BreakerParameters, limits: Mapping[str, float], objective: str, tolerance: float) -> Sizing:
    """Return the preload with the smallest objective between settling in time and never lifting (p = 1)."""
    (span,) = rational_ranges(soft.body, soft.excitation, (soft.body.spring_rate_n_per_m,))
    low, full = span.ratios.settled, span.never_lifts_deflection_m
    places = [low + (1.0 - low) * i / STEPS for i in range(STEPS + 1)]
    bodies = _box(soft, tolerance)
    found = {p: _worst(bodies, p * full) for p in places}
    nominal = {p: _worst(bodies[:1], p * full) for p in places} if tolerance > 0.0 else found
    good = [p for p in places if _kept(found[p], limits)]
    if not good:
        raise StudyError("no preload of the rational range meets the limits: " + _nearest(found, limits))
    p = min(good, key=lambda place: (found[place][objective], place))
    chosen = varied(soft, {"body.preload_deflection_m": p * full})
    constraints = (
        Constraint("preload_ratio", p, low, "above"),
        Constraint("preload_ratio", p, 1.0),
        *(Constraint(name, found[p][name], limit) for name, limit in limits.items() if limit < inf),
    )
    edge = next((place for place in places if _kept(nominal[place], limits)), p)
    return Sizing(
        "mb10_breaker",
        objective,
        {"body.spring_rate_n_per_m": soft.body.spring_rate_n_per_m, "body.preload_deflection_m": p * full},
        chosen,
        {
            "preload_ratio": p,
            "rest_force_n": soft.body.spring_rate_n_per_m * p * full,
            "frequency_ratio": span.frequency_ratio,
            "rational_from_ratio": low,
            "first_return_before_blow_ratio": span.ratios.returned,
            "nominal_edge_ratio": edge,
            **{name: found[p][name] for name in NAMES},
        },
        constraints,
        _binding(places, p, found, limits, objective, constraints),
        tuple({"preload_ratio": place, **{name: found[place][name] for name in NAMES}} for place in places[::20]),
        tolerance,
    )


def _box(soft: BreakerParameters, tolerance: float) -> list[PressedBody]:
    """Return the bodies of the box: as configured, then corners and points within."""
    points = [soft]
    if tolerance > 0.0:
        drawn = (*corners(ASSUMED, tolerance), *inner_points(ASSUMED, tolerance, INNER))
        points += [scaled(soft, factors) for factors in drawn]
    return [pressed_body(point.body, point.excitation) for point in points]


def _worst(bodies: Sequence[PressedBody], deflection_m: float) -> Worst:
    """Return the largest of each metric over the bodies; ``unsettled`` counts those still in motion at the load."""
    points = [
        collar_point(body._replace(deflection=deflection_m, rest_angle=deflection_m / body.arm)) for body in bodies
    ]
    worst = {name: max(float(getattr(point.metrics, name)) for point in points) for name in NAMES}
    return {**worst, "unsettled": float(sum(not point.settles for point in points))}


def _kept(worst: Worst, limits: Mapping[str, float]) -> bool:
    return worst["unsettled"] == 0.0 and all(worst[name] <= limit for name, limit in limits.items())


def _binding(
    places: Sequence[float],
    p: float,
    found: Mapping[float, Worst],
    limits: Mapping[str, float],
    objective: str,
    constraints: tuple[Constraint, ...],
) -> str:
    before = places.index(p) - 1
    if before < 0 or _kept(found[places[before]], limits):
        return binding_of(constraints, f"none: {objective} is least here")
    return f"a step less preload breaks {_nearest({before: found[places[before]]}, limits)}"


def _nearest(found: Mapping[float, Worst], limits: Mapping[str, float]) -> str:
    """Return the limits broken, each with the best value there is."""
    best = {name: min(worst[name] for worst in found.values()) for name in limits}
    broken = [f"{name} <= {limit:.4g} (has {best[name]:.4g})" for name, limit in limits.items() if best[name] > limit]
    return "; ".join(broken) or "the limits one by one, but not together"
