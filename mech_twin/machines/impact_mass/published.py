# SPDX-License-Identifier: Apache-2.0
"""Published numbers of the impact mass, and the motions, velocities and phase portraits of figs. 2, 3 and 4."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.plots import BLUE, GREY, INK, PURPLE, RED, Picture, blank, published, sheet
from mech_twin.capabilities.published import CONTRADICTS, Literature, PublishedRow
from mech_twin.capabilities.variation import varied
from mech_twin.machines.impact_mass.cycle_verdict import endurance, verdict
from mech_twin.machines.impact_mass.dynamics import gap_after, next_event, phase_end
from mech_twin.machines.impact_mass.one_impact_cycle import CycleSpec, synthesised_cycle
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.regimes import PeriodTable, recorded
from mech_twin.machines.impact_mass.synthesis import (
    cycle_spec,
    printed_periods,
    published_parameters,
    with_phase2_force,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPER = "Manzhosov, Novikov"
WORKED = "exact computation"
BLOW_M_PER_S = 20.0  # published, fig. 4
AXIS_M_PER_S = {"a": (-15.0, 25.0), "b": (30.0,)}  # published ends of the velocity axes of figs. 3a and 3b
ARC = 24  # points of a parabola between two events


def first_periods(parameters: ImpactMass, periods: int) -> PeriodTable:
    """Return the table of the first periods from the configured start."""
    return recorded(parameters.start, parameters.system, periods)[-1]


def cycle_of_figure_4(parameters: ImpactMass) -> CycleSpec:
    """Return the cycle of fig. 4, from rest."""
    return replace(cycle_spec(parameters, BLOW_M_PER_S), initial_velocity_m_per_s=0.0)


def rows(parameters: ImpactMass) -> Iterator[PublishedRow]:
    """Yield printed and computed values, first those of the synthesised cycle that collapses."""
    yield from _collapse(parameters)
    yield from _synthesis(parameters)
    yield from _settling(parameters)
    yield from _missed(parameters)


def _collapse(parameters: ImpactMass) -> Iterator[PublishedRow]:
    synthesised = published_parameters(cycle_of_figure_4(parameters))
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
    if printed_s <= synthesised.phase1_duration_s:
        return  # the cut leaves no phase 2
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
    spec = cycle_of_figure_4(parameters)
    found = synthesised_cycle(spec)
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
    seen = first_periods(parameters, 40)
    first, last = map(float, seen.hardest_m_per_s[[0, -1]])
    inputs = f"t1 {parameters.phase1_duration_s:g} s, T {parameters.period_s:g} s, R {parameters.rebound:g}"
    paper = Literature(PAPER, "Fig. 2", f"{inputs}, xc 0 assumed")
    yield paper.limit(
        "steady blow over the first (print: well below, so below 1)",
        1.0,
        last / first if first > 0.0 else math.nan,
        "the print says 'well below the first cycles'; its picture has no numbers",
        "below",
    )
    completed = float(np.count_nonzero(seen.chatter_ends))
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
        case = varied(parameters, {"phase1_duration_s": t1})
        seen, speeds = first_periods(case, periods), path(case, periods).velocity_m_per_s
        paper = Literature(PAPER, figure, f"as Fig. 2, t1 {t1:g} s")
        missed = float(np.count_nonzero((seen.impacts == 0.0) & (seen.chatter_ends == 0.0)))
        yield paper.limit(
            f"periods of {periods} without impact (print: impacts are missed, so one at least)",
            1.0,
            missed,
            "counted in the event walk",
            "above",
        )
        yield paper.gated(
            "top of the velocity axis, m/s", top, speeds.max(), "the motion fills it, as printed", absolute=0.05
        )
        for foot in feet:
            why = "the motion fits the printed axis"
            yield paper.limit("foot of the velocity axis, m/s", foot, speeds.min(), why, "above")


class MotionCurves(NamedTuple):
    """A motion as curves: time (s), position (m), velocity (m/s); jumps of velocity stand as two points at one time."""

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    velocity_m_per_s: NDArray[np.float64]


def path(parameters: ImpactMass, periods: int) -> MotionCurves:
    """Return the curves of the motion from the configured start, arc by arc between events."""
    system, motion, rows = parameters.system, parameters.start, []
    while motion.period < periods:
        event, after = next_event(motion, system)
        end = phase_end(motion, system) if after.period > motion.period else after.tau_s
        start = motion.period * system.period_s + motion.tau_s
        for t in np.linspace(0.0, end - motion.tau_s, ARC):
            gap, velocity = gap_after(motion, system, t)
            rows.append((start + t, parameters.stop_position_m - max(gap, 0.0), velocity))
        rows.append((event.period * system.period_s + event.tau_s, rows[-1][1], event.post_m_per_s))
        motion = after
    table = np.array(rows)
    return MotionCurves(table[:, 0], table[:, 1], table[:, 2])


def pictures(parameters: ImpactMass) -> Iterator[Picture]:
    """Yield the figures."""
    yield _figure_2(parameters)
    for name, t1, periods in (("a", 0.025, 6), ("b", 0.03, 36)):
        yield _figure_3(parameters, name, t1, periods)
    yield _figure_4(parameters)


def _motion_panels(panels: list[Axes], shown: MotionCurves, period_s: float) -> None:
    panels[0].plot(1000.0 * shown.time_s, shown.position_m, color=BLUE)
    panels[1].plot(1000.0 * shown.time_s, shown.velocity_m_per_s, color=RED, linewidth=1.1)
    panels[0].set_ylabel(r"position $x$, m")
    panels[1].set_ylabel(r"velocity $\dot{x}$, m/s")
    panels[1].set_xlabel("time, ms")
    for axes in panels[:2]:
        axes.set_xlim(0.0, 1000.0 * shown.time_s[-1])
        for n in range(1, round(shown.time_s[-1] / period_s)):
            axes.axvline(1000.0 * n * period_s, color=GREY, linewidth=0.4)


def _figure_2(parameters: ImpactMass) -> Picture:
    shown = path(parameters, 10)
    figure, panels = sheet(2, 1, 7.2, 5.0, sharex=True)
    _motion_panels(panels, shown, parameters.period_s)
    panels[0].set_title("Settling from rest (Fig. 2)")
    caption = "Blows of 31.6, 20.5, 20.3, 19.7, 17.5 m/s, then 13.0 m/s with a completed chatter in every period."
    return Picture("impact_mass_fig2", caption, figure)


def _figure_3(parameters: ImpactMass, name: str, t1: float, periods: int) -> Picture:
    case = varied(parameters, {"phase1_duration_s": t1})
    shown = path(case, 6)
    later = path(case, periods)
    figure = blank(8.6, 5.0)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.5, 1.0))
    panels = [figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[:, 1])]
    _motion_panels(panels, shown, case.period_s)
    panels[2].plot(later.position_m, later.velocity_m_per_s, color=PURPLE, linewidth=0.8)
    panels[2].set_xlabel(r"position $x$, m")
    panels[2].set_ylabel(r"velocity $\dot{x}$, m/s")
    for limit in AXIS_M_PER_S[name]:
        label = "end of the printed axis" if limit > 0.0 else None
        panels[1].axhline(limit, color=INK, linewidth=0.9, linestyle="--", label=label)
    low, high = panels[1].get_ylim()
    panels[1].set_ylim(low, high + 0.3 * (high - low))
    panels[1].legend(loc="upper right")
    panels[0].set_title(f"$t_1 = {1000.0 * t1:g}$ ms (Fig. 3{name})")
    panels[2].set_title(f"phase portrait, {periods} periods (Fig. 3{name})")
    ends = "1, 0, 1, 1, 1, then an endless series"
    if name == "b":
        ends = "1, 0, 2, 1, 0, an endless series, then a period of five"
    return Picture(f"impact_mass_fig3{name}", f"Missed impacts: per period {ends}.", figure)


def _figure_4(parameters: ImpactMass) -> Picture:
    made = published_parameters(cycle_of_figure_4(parameters))
    rounded = made.model_copy(update={"period_s": 0.216})
    figure, panels = sheet(3, 1, 7.2, 6.4, sharex=True)
    robust = with_phase2_force(made, BLOW_M_PER_S, -20.0).model_copy(update={"period_s": 0.216})
    for axes, case, title in (
        (panels[0], made, r"synthesised cycle, $T$ in full (Fig. 4)"),
        (panels[1], rounded, r"the same, $T = 0.216$ s as printed (Fig. 4)"),
        (panels[2], robust, r"robust cycle, $T = 0.216$ s (own)"),
    ):
        shown = path(case, 10)
        axes.plot(shown.time_s, shown.velocity_m_per_s, color=RED)
        axes.set_ylabel(r"velocity $\dot{x}$, m/s")
        axes.set_title(title)
        axes.set_ylim(-16.0, 24.0)
    blows = [0.05 + n * made.period_s for n in range(10)]
    published(panels[0], blows, [BLOW_M_PER_S] * 10, r"published $v^- = 20$, $v^+ = -6$ m/s")
    published(panels[0], blows, [-parameters.rebound * BLOW_M_PER_S] * 10, "")
    panels[0].legend(loc="lower right")
    panels[2].set_xlabel("time, s")
    panels[2].set_xlim(0.0, 10.0 * rounded.period_s)
    caption = "The published cycle is at the limit of existence and is lost with T rounded as printed; the robust"
    return Picture("impact_mass_fig4", f"{caption} cycle is stable.", figure)
