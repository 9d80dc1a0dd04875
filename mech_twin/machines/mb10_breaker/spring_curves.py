# SPDX-License-Identifier: Apache-2.0
"""The body over spring rate and preload: amplitude, pressing force, metrics on the collar, the rational range.

The paper's two figures first (amplitude and largest pressing force against spring rate, no preload, no collar), then
the same with preload, then the machine on its collar: gap at the blow, return speed and pressing force weighed against
each other over spring rate and preload.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from mech_twin.machines.mb10_breaker.pressed_body.metrics import (
    CycleMetrics,
    PreloadRange,
    SteadyMetrics,
    preload_range,
    steady_metrics,
    with_preload,
)
from mech_twin.machines.mb10_breaker.pressed_body.parameters import (
    BodyParameters,
    ExcitationParameters,
    PressedBody,
    pressed_body,
)
from mech_twin.machines.mb10_breaker.pressed_body.swing_regime import SwingRegime, swing_regime


@dataclass(frozen=True)
class SwingPoint:
    """The free swing at one spring: what the paper plots.

    ``amplitude_rad`` is the periodic regime's |As|, inf where there is none; ``largest_travel_m`` is the largest travel
    at the tool in the periodic regime; the statement of ``regime`` must stand beside every figure made of these.
    """

    spring_rate_n_per_m: float
    preload_deflection_m: float
    frequency_ratio: float  # k/omega
    amplitude_rad: float
    largest_travel_m: float
    largest_force_n: float
    regime: SwingRegime


@dataclass(frozen=True)
class CollarPoint:
    """The body on its collar at one spring: the metrics of the steady cycle, and whether they will do."""

    spring_rate_n_per_m: float
    preload_deflection_m: float
    frequency_ratio: float
    preload_ratio: float
    steady: SteadyMetrics
    settles: bool  # before the next load begins, every cycle alike

    @property
    def metrics(self) -> CycleMetrics:
        """The metrics of the steady cycle."""
        return self.steady.metrics


@dataclass(frozen=True)
class RationalRange:
    """The rational preload of one spring rate.

    ``settled`` and ``returned`` are the numbers at the lower bound and where the first return comes before the blow;
    between the lower bound and ``never_lifts_deflection_m`` more preload buys gap and return speed with pressing force.
    """

    spring_rate_n_per_m: float
    frequency_ratio: float
    ratios: PreloadRange
    settled_deflection_m: float
    returned_deflection_m: float
    never_lifts_deflection_m: float
    settled: CollarPoint
    returned: CollarPoint


def _ratio(body: PressedBody) -> float:
    return body.k * body.period / (2.0 * math.pi)


def _sprung(body: BodyParameters, excitation: ExcitationParameters, rate: float, deflection: float) -> PressedBody:
    spring = {"spring_rate_n_per_m": rate, "preload_deflection_m": deflection}
    return pressed_body(BodyParameters(**{**body.model_dump(), **spring}), excitation)


def swing_curve(
    body: BodyParameters,
    excitation: ExcitationParameters,
    rates_n_per_m: Iterable[float],
    preload_deflection_m: float = 0.0,
) -> tuple[SwingPoint, ...]:
    """Return amplitude and largest pressing force against spring rate, without a collar.

    Parameters
    ----------
    body, excitation
        Configuration; its spring rate and preload are replaced.
    rates_n_per_m : iterable of float
        Spring rates, N/m.
    preload_deflection_m : float
        Preload deflection a, m; the paper's figures have 0.
    """
    points = []
    for rate in rates_n_per_m:
        constants = _sprung(body, excitation, rate, preload_deflection_m)
        regime = swing_regime(constants)
        points.append(
            SwingPoint(
                spring_rate_n_per_m=rate,
                preload_deflection_m=preload_deflection_m,
                frequency_ratio=_ratio(constants),
                amplitude_rad=regime.amplitude_rad,
                largest_travel_m=constants.radius * regime.periodic_angle_rad,
                largest_force_n=regime.periodic_force_n,
                regime=regime,
            )
        )
    return tuple(points)


def collar_point(constants: PressedBody) -> CollarPoint:
    """Return the metrics of one body on its collar."""
    steady = steady_metrics(constants)
    never_off = steady.metrics.contact_share == 1.0
    settles = steady.repeats_after == 1 and not math.isnan(steady.metrics.settled_s)
    return CollarPoint(
        spring_rate_n_per_m=constants.rate,
        preload_deflection_m=constants.deflection,
        frequency_ratio=_ratio(constants),
        preload_ratio=constants.preload_ratio,
        steady=steady,
        settles=never_off or settles,
    )


def collar_grid(
    body: BodyParameters,
    excitation: ExcitationParameters,
    rates_n_per_m: Iterable[float],
    preload_deflections_m: Iterable[float],
) -> tuple[CollarPoint, ...]:
    """Return the metrics over spring rates and preload deflections, rate by rate."""
    deflections = tuple(preload_deflections_m)
    return tuple(
        collar_point(_sprung(body, excitation, rate, deflection))
        for rate in rates_n_per_m
        for deflection in deflections
    )


def rational_ranges(
    body: BodyParameters, excitation: ExcitationParameters, rates_n_per_m: Iterable[float]
) -> tuple[RationalRange, ...]:
    """Return the rational preload of each spring rate, with the metrics at its bounds."""
    ranges = []
    for rate in rates_n_per_m:
        constants = _sprung(body, excitation, rate, body.preload_deflection_m)
        ratios = preload_range(constants, constants.k)
        deflection = constants.amplitude / (constants.rate * constants.arm)
        ranges.append(
            RationalRange(
                spring_rate_n_per_m=rate,
                frequency_ratio=_ratio(constants),
                ratios=ratios,
                settled_deflection_m=ratios.settled * deflection,
                returned_deflection_m=ratios.returned * deflection,
                never_lifts_deflection_m=deflection,
                settled=collar_point(with_preload(constants, ratios.settled)),
                returned=collar_point(with_preload(constants, ratios.returned)),
            )
        )
    return tuple(ranges)
