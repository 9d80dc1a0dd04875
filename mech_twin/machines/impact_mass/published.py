"""Published figures of the impact mass."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from mech_twin.capabilities.published import CHANGED, CONTRADICTS, REPRODUCED, Row, Source
from mech_twin.capabilities.variation import varied
from mech_twin.machines.impact_mass.cycle_verdict import endurance, verdict
from mech_twin.machines.impact_mass.dynamics import (
    initial_motion,
    next_event,
)
from mech_twin.machines.impact_mass.one_impact_cycle import synthesised_cycle
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.states import (
    CHATTER_END,
    IMPACT,
)
from mech_twin.machines.impact_mass.synthesis import CycleSpec, printed_periods, published_parameters, with_phase2_force

PAPER = "Manzhosov, Novikov"
WORKED = "exact computation"
ENDLESS = -1.0  # stands for the impacts of a period in which the series completes
BLOW_M_PER_S = 20.0  # published, fig. 4


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
    return CycleSpec(p.mass_kg, p.stop_position_m, p.initial_position_m, 0.0, BLOW_M_PER_S, p.restitution)


def rows(parameters: ImpactMass) -> Iterator[Row]:
    """Yield the rows, the synthesised cycle that collapses first."""
    yield from _collapse(parameters)
    yield from _synthesis(parameters)
    yield from _settling(parameters)
    yield from _missed(parameters)


def _collapse(parameters: ImpactMass) -> Iterator[Row]:
    published = published_parameters(cycle_spec(parameters))
    judged = verdict(published, None)
    paper = Source(PAPER, "Fig. 4", "synthesis with v0 = 0, v- 20 m/s")
    border = published.phase2_force_n / (parameters.restitution**2 * published.phase1_force_n)
    yield paper.reported(
        "largest multiplier of the cycle, 1 being the border (print: a steady cycle)",
        1.0,
        1.0 - judged.margin,
        CONTRADICTS,
        "v0 = 0 always lands on P2 = R^2 P1, the border of existence: the cycle is not robustly stable",
        absolute=True,
    )
    worked = Source(WORKED, "Fig. 4", paper.inputs)
    yield worked.gated("P2 over R^2 P1", 1.0, border, "the border of existence", relative=1e-12)
    for period_s, held in zip(printed_periods(published.period_s), (7, 8), strict=True):
        lasting = endurance(published.model_copy(update={"period_s": period_s}), 1000)
        yield worked.at("Fig. 4", f"{paper.inputs}, T as printed, {period_s:g} s").gated(
            "period in which it comes to permanent rest",
            float(held),
            float(lasting.rests_in_period),
            "with T rounded the cycle collapses against the stop",
            absolute=0.0,
            verdict=CONTRADICTS,
        )
    robust = with_phase2_force(published, BLOW_M_PER_S, -20.0)
    changed = worked.at("robust synthesis", "same v-, T, t1; P2 -20 N")
    yield changed.gated(
        "P1, N",
        586.667,
        robust.phase1_force_n,
        "forces moved until stable with a margin",
        absolute=5e-4,
        verdict=CHANGED,
    )
    yield changed.limit(
        "largest multiplier", 1.0, 1.0 - verdict(robust, None).margin, "stable where the paper's cycle is not", "below"
    )
    lasting = endurance(robust, 100_000)
    yield changed.gated(
        "periods held of 100000", 100000.0, float(lasting.held_periods), "one impact every period", absolute=0.0
    )


def _synthesis(parameters: ImpactMass) -> Iterator[Row]:
    spec = cycle_spec(parameters)
    found = synthesised_cycle(
        spec.mass_kg,
        spec.stop_position_m,
        spec.initial_position_m,
        spec.initial_velocity_m_per_s,
        spec.impact_speed_m_per_s,
        spec.restitution,
    )
    paper = Source(
        PAPER, "Fig. 4", f"m {spec.mass_kg:g}, x0 {spec.initial_position_m:g}, v0 0, v- 20, R {spec.restitution:g}"
    )
    for name, value, computed in (
        ("v+, m/s", -6.0, found.rebound_velocity_m_per_s),
        ("t1, s", 0.05, found.phase1_duration_s),
        ("P1, N", 400.0, found.phase1_force_n),
        ("P2, N", 36.0, found.phase2_force_n),
    ):
        yield paper.gated(name, value, computed, "closed form of the synthesis", relative=1e-12)
    yield paper.gated(
        "T, s", 0.216, math.floor(found.period_s * 1000.0) / 1000.0, "0.2166667, cut to three decimals", absolute=1e-12
    )
    worked = Source(WORKED, "Fig. 4", paper.inputs)
    yield worked.gated("T, s", 0.05 + 1.0 / 6.0, found.period_s, "in full precision", relative=1e-12)


def _settling(parameters: ImpactMass) -> Iterator[Row]:
    seen = walk(parameters, 40)
    inputs = f"t1 {parameters.phase1_duration_s:g} s, T {parameters.period_s:g} s, R {parameters.restitution:g}"
    worked = Source(WORKED, "Fig. 2", inputs)
    for number, value in enumerate((31.6228, 20.4813, 20.2744, 19.7455, 17.4812)):
        name = f"first blow of period {number + 1}, m/s"
        yield worked.gated(name, value, seen.blows_m_per_s[number], "event walk in closed form", absolute=5e-5)
    yield worked.gated("steady blow, m/s", 12.9904, seen.blows_m_per_s[-1], "period 40", absolute=5e-5)
    yield worked.gated(
        "end of the series in the period, s", 0.031625, seen.chatter_end_tau_s, "period 40", absolute=5e-7
    )
    paper = Source(PAPER, "Fig. 2", f"{inputs}, xc 0 assumed")
    yield paper.limit(
        "steady blow below the first, m/s",
        seen.blows_m_per_s[0],
        seen.blows_m_per_s[-1],
        "the print says 'well below the first cycles'; its picture has no numbers",
        "below",
    )
    yield paper.gated(
        "periods 6 to 40 with completed chatter",
        35.0,
        float(seen.impacts[5:].count(ENDLESS)),
        "the print says chatter appears: it completes every period",
        absolute=0.0,
    )


def _missed(parameters: ImpactMass) -> Iterator[Row]:
    cases = (
        ("Fig. 3a", 0.025, 6, (1, 0, 1, 1, 1, ENDLESS), (-14.69, 25.00), (-15.0, 25.0)),
        ("Fig. 3b", 0.03, 10, (1, 0, 2, 1, 0, ENDLESS), (-17.90, 30.00), (math.nan, 30.0)),
    )
    for figure, t1, periods, counts, span, axis in cases:
        seen = walk(figure_case(parameters, t1), periods)
        worked = Source(WORKED, figure, f"as Fig. 2, t1 {t1:g} s")
        for number, value in enumerate(counts):
            name = f"impacts of period {number + 1}" + (" (-1: endless series)" if value == ENDLESS else "")
            yield worked.gated(name, float(value), seen.impacts[number], "missed impacts, as printed", absolute=0.0)
        yield worked.gated("least velocity, m/s", span[0], seen.low_m_per_s, "at an event, so exact", absolute=5e-3)
        yield worked.gated("greatest velocity, m/s", span[1], seen.high_m_per_s, "at an event, so exact", absolute=5e-3)
        paper = Source(PAPER, figure, worked.inputs)
        yield paper.limit(
            "top of the velocity axis, m/s", axis[1] + 1e-9, seen.high_m_per_s, "the motion fills it", "below"
        )
        if not math.isnan(axis[0]):
            name, why = "foot of the velocity axis, m/s", "the motion fits the printed axis"
            yield paper.limit(name, axis[0], seen.low_m_per_s, why, "above")
    later = walk(figure_case(parameters, 0.03), 60)
    repeats = later.blows_m_per_s[10:55] == later.blows_m_per_s[15:60]
    yield Source(WORKED, "Fig. 3b", "as Fig. 2, t1 0.03 s").gated(
        "exact repetition after 5 periods (1 yes)", 1.0, float(repeats), "bit for bit", absolute=0.0, verdict=REPRODUCED
    )
