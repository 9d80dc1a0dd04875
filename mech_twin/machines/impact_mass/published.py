# SPDX-License-Identifier: Apache-2.0
"""Published numbers of the impact mass."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from mech_twin.capabilities.published import CONTRADICTS, Literature, PublishedRow
from mech_twin.capabilities.variation import varied
from mech_twin.machines.impact_mass.cycle_verdict import endurance, verdict
from mech_twin.machines.impact_mass.dynamics import initial_motion, next_event
from mech_twin.machines.impact_mass.one_impact_cycle import synthesised_cycle
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.states import CHATTER_END, IMPACT
from mech_twin.machines.impact_mass.synthesis import CycleSpec, printed_periods, published_parameters

PAPER = "Manzhosov, Novikov"
WORKED = "exact computation"
ENDLESS = -1.0  # stands for the impacts of a period in which the series completes
BLOW_M_PER_S = 20.0  # published, fig. 4
AXIS_M_PER_S = {"a": (-15.0, 25.0), "b": (30.0,)}  # published ends of the velocity axes of figs. 3a and 3b


class FirstPeriods(NamedTuple):
    """First periods of a motion: impacts and first blow of each period, velocity range, when the last series ended."""

    impacts: tuple[float, ...]
    blows_m_per_s: tuple[float, ...]
    low_m_per_s: float
    high_m_per_s: float
    chatter_end_tau_s: float


def walk(parameters: ImpactMass, periods: int) -> FirstPeriods:
    """Return the first periods from the configured start; velocity is linear between events, so its range is exact."""
    system = parameters.system
    motion = initial_motion(parameters.initial_gap_m, parameters.initial_velocity_m_per_s, system)
    impacts, blows = [0.0] * periods, [0.0] * periods
    speeds, end = [parameters.initial_velocity_m_per_s], math.nan
    while motion.period < periods:
        event, motion = next_event(motion, system)
        speeds += [event.pre_m_per_s, event.post_m_per_s]
        if event.kind == IMPACT:
            number = int(event.period)
            blows[number] = blows[number] or event.pre_m_per_s
            impacts[number] += 1.0 if impacts[number] != ENDLESS else 0.0
        elif event.kind == CHATTER_END:
            impacts[int(event.period)], end = ENDLESS, event.tau_s
    return FirstPeriods(tuple(impacts), tuple(blows), min(speeds), max(speeds), end)


def figure_case(parameters: ImpactMass, phase1_duration_s: float) -> ImpactMass:
    """Return the case of figs. 2 and 3 with this duration of the first phase."""
    return varied(parameters, {"phase1_duration_s": phase1_duration_s})


def cycle_spec(parameters: ImpactMass) -> CycleSpec:
    """Return the cycle of fig. 4, from rest, for the configured mass, stop, start and restitution."""
    p = parameters
    return CycleSpec(p.mass_kg, p.stop_position_m, p.initial_position_m, 0.0, BLOW_M_PER_S, p.rebound)


def rows(parameters: ImpactMass) -> Iterator[PublishedRow]:
    """Yield printed and computed values, first those of the synthesised cycle that collapses."""
    yield from _collapse(parameters)
    yield from _synthesis(parameters)
    yield from _settling(parameters)
    yield from _missed(parameters)


def _collapse(parameters: ImpactMass) -> Iterator[PublishedRow]:
    synthesised = published_parameters(cycle_spec(parameters))
    paper = Literature(PAPER, "Fig. 4", "synthesis with v0 = 0, v- 20 m/s")
    yield paper.reported(
        "largest multiplier of the cycle (print: a steady cycle, so at most 1)",
        1.0,
        1.0 - verdict(synthesised, None).margin,
        CONTRADICTS,
        "v0 = 0 always lands on P2 = R^2 P1, the border of existence: the cycle is not robustly stable",
        absolute=True,
    )
    *_, printed_s = printed_periods(synthesised.period_s)
    lasting = endurance(synthesised.model_copy(update={"period_s": printed_s}), 1000)
    yield paper.at("Fig. 4", f"{paper.inputs}, T as printed, {printed_s:g} s").reported(
        "period in which it comes to permanent rest (print: a steady cycle, so none, 0)",
        0.0,
        float(lasting.rests_in_period),
        CONTRADICTS,
        "with T as printed the cycle collapses against the stop",
        absolute=True,
    )


def _synthesis(parameters: ImpactMass) -> Iterator[PublishedRow]:
    spec = cycle_spec(parameters)
    found = synthesised_cycle(
        spec.mass_kg,
        spec.stop_position_m,
        spec.initial_position_m,
        spec.initial_velocity_m_per_s,
        spec.impact_speed_m_per_s,
        spec.restitution,
    )
    paper = Literature(
        PAPER, "Fig. 4", f"m {spec.mass_kg:g}, x0 {spec.initial_position_m:g}, v0 0, v- 20, R {spec.restitution:g}"
    )
    for name, value, computed in (
        ("v+, m/s", -6.0, found.rebound_velocity_m_per_s),
        ("t1, s", 0.05, found.phase1_duration_s),
        ("P1, N", 400.0, found.phase1_force_n),
        ("P2, N", 36.0, found.phase2_force_n),
    ):
        yield paper.gated(name, value, computed, "closed form of the synthesis", relative=1e-12)
    cut = math.floor(found.period_s * 1000.0) / 1000.0
    yield paper.gated("T, s", 0.216, cut, "0.2166667: the print cuts to three decimals", absolute=1e-12)


def _settling(parameters: ImpactMass) -> Iterator[PublishedRow]:
    seen = walk(parameters, 40)
    inputs = f"t1 {parameters.phase1_duration_s:g} s, T {parameters.period_s:g} s, R {parameters.rebound:g}"
    paper = Literature(PAPER, "Fig. 2", f"{inputs}, xc 0 assumed")
    yield paper.limit(
        "steady blow over the first (print: well below, so below 1)",
        1.0,
        seen.blows_m_per_s[-1] / seen.blows_m_per_s[0],
        "the print says 'well below the first cycles'; its picture has no numbers",
        "below",
    )
    completed = float(seen.impacts.count(ENDLESS))
    yield paper.limit(
        "periods of 40 with chatter (print: it appears, so one at least)",
        1.0,
        completed,
        "it completes in every settled period",
        "above",
    )


def _missed(parameters: ImpactMass) -> Iterator[PublishedRow]:
    for panel, t1, periods in (("a", 0.025, 6), ("b", 0.03, 10)):
        figure, (*feet, top) = f"Fig. 3{panel}", AXIS_M_PER_S[panel]
        seen = walk(figure_case(parameters, t1), periods)
        paper = Literature(PAPER, figure, f"as Fig. 2, t1 {t1:g} s")
        missed = float(seen.impacts.count(0.0))
        yield paper.limit(
            f"periods of {periods} without impact (print: impacts are missed, so one at least)",
            1.0,
            missed,
            "counted in the event walk",
            "above",
        )
        yield paper.gated(
            "top of the velocity axis, m/s", top, seen.high_m_per_s, "the motion fills it, as printed", absolute=0.05
        )
        for foot in feet:
            why = "the motion fits the printed axis"
            yield paper.limit("foot of the velocity axis, m/s", foot, seen.low_m_per_s, why, "above")
