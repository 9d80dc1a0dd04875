# SPDX-License-Identifier: Apache-2.0
"""Sizing of the breaker: spring rate and preload, or tool and striker; what both have in common.

The limits hold in the worst case over a box of tolerances: every number that is assumed, not published, off by up to
the tolerance.  The spring's rate is the soft one, k = 0.3 of the blow frequency.

Preload of the breaker's body under the half sine: the worst case over every corner of the tolerances.

The body over spring rate and preload: the paper's two figures, without a collar, are amplitude and largest pressing
force against spring rate.  On its collar gap at the blow and return speed are traded off for force.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import inf, isnan, pi
from typing import NamedTuple

from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import corners, inner_points, scaled, varied
from mech_twin.errors import StudyError
from mech_twin.machines.mb10_breaker import tool_sizing
from mech_twin.machines.mb10_breaker.metrics import SEATED_GAP_M, SEATED_REST
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.pressed_body.free_swing import SwingRegime, swing_regime
from mech_twin.machines.mb10_breaker.pressed_body.metrics import (
    CycleMetrics,
    preload_range,
    steady_metrics,
)
from mech_twin.machines.mb10_breaker.pressed_body.parameters import (
    BodyParameters,
    ExcitationParameters,
    PressedBody,
    pressed_body,
)

ASSUMED = ("body.inertia_kg_m2", "body.restitution", "excitation.amplitude_nm")
NAMES = ("gap_at_blow_m", "flight_share", "return_speed_m_per_s", "largest_force_n")
STEPS = 200
INNER = 8
Worst = dict[str, float]


def half_sine_sizing(soft: BreakerParameters, limits: Mapping[str, float], objective: str, tolerance: float) -> Sizing:
    """Return the preload with the smallest objective between settling in time and never lifting (p = 1)."""
    body = pressed_body(soft.body, soft.excitation)
    span = preload_range(body, body.k)
    low, full = span.settled, body.amplitude / (body.rate * body.arm)
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
            "frequency_ratio": body.k * body.period / (2.0 * pi),
            "rational_from_ratio": low,
            "first_return_before_blow_ratio": span.returned,
            "nominal_edge_ratio": edge,
            **{name: found[p][name] for name in NAMES},
        },
        constraints,
        _binding(places, p, found, limits, objective, constraints),
        tuple({"preload_ratio": place, **{name: found[place][name] for name in NAMES}} for place in places[::20]),
        tolerance,
        ASSUMED,
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
    return out_of_reach({name: min(worst[name] for worst in found.values()) for name in limits}, limits)


def out_of_reach(best: Mapping[str, float], limits: Mapping[str, float]) -> str:
    """Return the limits that the best value of each breaks, with that value."""
    broken = [f"{name} <= {limit:.4g} (has {best[name]:.4g})" for name, limit in limits.items() if best[name] > limit]
    return "; ".join(broken) or "the limits one by one, but not together"


# gap at the blow (m), part of the cycle not at rest on the collar, return speed (m/s), largest spring force (N)
OF_SPRING: dict[str, float] = {
    "gap_at_blow_m": SEATED_GAP_M,
    "flight_share": 1.0 - SEATED_REST,
    "return_speed_m_per_s": inf,
    "largest_force_n": inf,
}
LIMITS: dict[str, float] = {**OF_SPRING, **tool_sizing.LIMITS}
OBJECTIVES = ("largest_force_n", "return_speed_m_per_s", "gap_at_blow_m", "flight_share", tool_sizing.OBJECTIVE)
USUAL_TOLERANCE = 0.05
SOFTNESS = 0.3  # k over the blow frequency: soft, so that the spring's force hardly changes over the lift


def sizing(
    parameters: BreakerParameters, limits: Mapping[str, float], objective: str, table: Table, tolerance: float
) -> Sizing:
    """Return spring rate and preload in the rational range, the tool seated before every blow.

    With the objective `tool_sizing.OBJECTIVE`: tool and striker for most energy in the wall.

    Parameters
    ----------
    parameters : BreakerParameters
        Configuration; spring rate and preload are replaced.
    limits : mapping
        Every limit of ``LIMITS``.
    objective : str
        What to make small in the worst case, or large: one of ``OBJECTIVES``.
    table : callable
        Not needed here.
    tolerance : float
        Part of its value by which each assumed number may be off.
    """
    from mech_twin.machines.mb10_breaker.running_sizing import running_sizing

    asked = tool_sizing.LIMITS if objective == tool_sizing.OBJECTIVE else OF_SPRING
    for name, usual in LIMITS.items():
        if name not in asked and limits[name] != usual:
            raise StudyError(f"limit {name}: not of the objective {objective}, whose limits are {', '.join(asked)}")
    if objective == tool_sizing.OBJECTIVE:
        return tool_sizing.tool_sizing(parameters, {name: limits[name] for name in tool_sizing.LIMITS}, tolerance)
    limits = {name: limits[name] for name in OF_SPRING}
    omega = 2.0 * pi * parameters.excitation.blow_rate_hz
    rate = parameters.body.inertia_kg_m2 * (SOFTNESS * omega / parameters.body.spring_arm_m) ** 2
    soft = varied(parameters, {"body.spring_rate_n_per_m": rate})
    answer = running_sizing if parameters.excitation.kind == "from_forces" else half_sine_sizing
    return answer(soft, limits, objective, tolerance)


def swing_curve(
    body: BodyParameters,
    excitation: ExcitationParameters,
    rates_n_per_m: Iterable[float],
    preload_deflection_m: float = 0.0,
) -> tuple[SwingRegime, ...]:
    """Return the swing at each spring rate, without a collar; its kind must stand beside every figure of these.

    Parameters
    ----------
    body, excitation
        Configuration; its spring rate and preload are replaced.
    rates_n_per_m : iterable of float
        Spring rates, N/m.
    preload_deflection_m : float
        Preload deflection a, m; the paper's figures have 0.
    """
    preload = {"preload_deflection_m": preload_deflection_m}
    sprung = (varied(body, {"spring_rate_n_per_m": rate, **preload}) for rate in rates_n_per_m)
    return tuple(swing_regime(pressed_body(each, excitation)) for each in sprung)


class CollarPoint(NamedTuple):
    """The body on its collar: metrics of the steady cycle, and whether it settles before the next load every cycle."""

    metrics: CycleMetrics
    settles: bool


def collar_point(constants: PressedBody) -> CollarPoint:
    """Return the metrics of one body on its collar."""
    steady = steady_metrics(constants)
    never_off = steady.metrics.contact_share == 1.0
    settles = steady.repeats_after == 1 and not isnan(steady.metrics.settled_s)
    return CollarPoint(steady.metrics, never_off or settles)
