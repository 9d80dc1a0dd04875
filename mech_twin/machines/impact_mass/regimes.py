# SPDX-License-Identifier: Apache-2.0
"""Long-run regimes of the impact mass over a sweep of one parameter, and their bifurcation picture.

How regimes are told apart (every rule but the last two is exact):

*Rest*: at the stop with A1 >= 0 and A2 >= 0; no phase ever releases the mass.
*Escape*: <A> <= 0 and a period without contact that ends no nearer and no faster than it began.
*Periodic*, by release: every release from rest starts the same motion, so two releases close an exact period.
The order of the motion is the number of forcing periods between them.
*Not resolved*: periodic by release, but a perturbation of the size of rounding (1e-16) does not stay small from
one release to the next: the order found would be an accident of the arithmetic.
*Periodic*, by return: gap and velocity at the period starts repeat after k periods, throughout a window of
`WINDOW` periods, within 1e-9 of the largest gap and speed in it; k at most half the window.  What parts them after
fewer periods must stay: a motion that settles slowly, by turns on either side, has not a period of 2.
Neither: the run is doubled, `DOUBLINGS` times, as it may be a long transient.
*Chaotic* then if the largest Lyapunov exponent (closed-form tangent map of flights and blows) exceeds 0.01 a period
in both halves of a last long window.
*Undecided* otherwise: a transient longer than the run, or a marginal motion.

The growth of a small perturbation is in closed form (tangent map).  A perturbation is (dx, dv) at one time, with dx
divided by the period so that both are speeds.  Flight: (1 t; 0 1).
Impact with speed v- under A: (-R 0; (1 + R) A/v- -R).  A completed series erases every perturbation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.plots import sheet
from mech_twin.files.output_file import written_file
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.impact_mass.dynamics import (
    CHATTER_END,
    FLIGHT,
    IMPACT,
    IMPACTS_SUMMED,
    PHASE_1,
    PHASE_2,
    PHASE_CHANGE,
    ImpactSystem,
    MassMotion,
    MotionEvent,
    acceleration,
    leaves_for_good,
    next_event,
    next_period,
    phase_end,
    rests_for_good,
)
from mech_twin.machines.impact_mass.parameters import ImpactMass

GENERIC = (1.0, 0.7)  # a direction that is no eigenvector of a flight or an impact
WINDOW = 512
LARGEST_LOG = 700.0  # of a growth that is still a double
DOUBLINGS = 4
RETURN_TOLERANCE = 1e-9
CHAOS_EXPONENT = 0.01
EXPONENT_PERIODS = 4000
ROUNDING = 1e-16
RESOLVED = 1e-3  # growth of a small difference times rounding up to which the number of periods is told
REST, ESCAPE, GOING = 1, 2, 0
NOT_RESOLVED = "not resolved"


@kernel
def after_summed(
    dx: float, dv: float, motion: MassMotion, event: MotionEvent, system: ImpactSystem
) -> tuple[float, float]:
    """Return the perturbation at the last of several impacts of one series, from that right after the preceding one.

    The speed of the next impact changes by dv_1 = (v dv - A dx)/v_1 and its time by dt_1 = (dv_1 - dv)/A; from there
    dv_n = R^(n-1) dv_1 and dt_n = dt_1 + 2 R dv_1/A (1 - R^(n-1))/(1 - R).
    """
    a, r = acceleration(motion, system) * system.period_s, system.restitution
    change = (motion.velocity_m_per_s * dv - a * dx) / event.pre_m_per_s
    later = (change - dv) / a
    decay = math.pow(r, event.impacts - 1.0)
    later += 2.0 * r * change / a * (1.0 - decay) / (1.0 - r)
    return -event.post_m_per_s * later, -r * decay * change - a * later


@kernel
def tangent_after(
    dx: float, dv: float, motion: MassMotion, event: MotionEvent, system: ImpactSystem
) -> tuple[float, float]:
    """Return the perturbation after an event (impacts or a change of phase), from that after the last event."""
    if event.kind == IMPACTS_SUMMED:
        return after_summed(dx, dv, motion, event, system)
    if event.kind == IMPACT:
        dx += dv * (event.tau_s - motion.tau_s) / system.period_s
        turn = (1.0 + system.restitution) * acceleration(motion, system) * system.period_s / event.pre_m_per_s
        return -system.restitution * dx, turn * dx - system.restitution * dv
    return dx + dv * (phase_end(motion, system) - motion.tau_s) / system.period_s, dv


@kernel
def exponent(motion: MassMotion, system: ImpactSystem, periods: int) -> tuple[MassMotion, float]:
    """Return the motion after a number of periods and the largest Lyapunov exponent per period (natural log).

    A completed series erases every perturbation: the exponent is -inf.
    """
    dx, dv = GENERIC
    growth, last = 0.0, motion.period + periods
    while motion.period < last:
        event, after = next_event(motion, system)
        if event.impacts == 0.0 and event.kind != PHASE_CHANGE:
            return after, -math.inf
        dx, dv = tangent_after(dx, dv, motion, event, system)
        size = math.hypot(dx, dv)
        growth += math.log(size)
        dx, dv, motion = dx / size, dv / size, after
    return motion, growth / periods


@kernel
def release_growth(system: ImpactSystem, most_periods: float) -> tuple[float, float]:
    """Return the periods from one release to the end of the next completed series, and the growth between (log).

    Every release from rest starts the same motion.  The growth is the largest of a perturbation between any two
    changes of phase; rounding errors grow by it.  Returns 0 periods if no series completes within ``most_periods``.
    """
    phase = PHASE_2 if system.acceleration2 < 0.0 else PHASE_1
    tau = system.phase1_s if phase == PHASE_2 else 0.0
    motion = MassMotion(0.0, tau, phase, 0.0, 0.0, FLIGHT, 0.0, 0.0, 0.0)
    dx, dv = GENERIC
    size, least, growth = 0.0, 0.0, 0.0
    while motion.period <= most_periods:
        event, after = next_event(motion, system)
        if event.kind == CHATTER_END:
            return (motion.period if phase == PHASE_2 else motion.period + 1.0), growth
        dx, dv = tangent_after(dx, dv, motion, event, system)
        now = math.hypot(dx, dv)
        size += math.log(now)
        dx, dv, motion = dx / now, dv / now, after
        if event.kind == PHASE_CHANGE:
            least, growth = min(least, size), max(growth, size - least)
    return 0.0, growth


class PeriodTable(NamedTuple):
    """One row a period: gap (m) and velocity (m/s) at its start, impacts, chatter ends, hardest blow, releases."""

    gap_m: NDArray[np.float64]
    velocity_m_per_s: NDArray[np.float64]
    impacts: NDArray[np.float64]
    chatter_ends: NDArray[np.float64]
    hardest_m_per_s: NDArray[np.float64]
    releases: NDArray[np.float64]

    def last(self, periods: int) -> PeriodTable:
        """Return the last rows."""
        return PeriodTable(*(column[-periods:] for column in self))

    @property
    def blows_m_per_s(self) -> tuple[float, ...]:
        """Hardest blow of each period with an impact."""
        return tuple(self.hardest_m_per_s[self.impacts > 0.0].tolist())


@dataclass(frozen=True)
class LongRunRegime:
    """Long-run regime of the motion.

    ``impacts_per_period`` lists one period of the motion (a completed series counts as -1 in its period: endless).
    It ends with the endless series, or begins where it is least, so that equal motions have equal lists.
    ``blows_m_per_s`` are the hardest blows of these periods (of the last window where there is no period).
    ``growth`` is the factor by which a perturbation grows from release to release, if periodic by release.
    """

    kind: str
    period: int
    impacts_per_period: tuple[int, ...]
    completed_chatter: bool
    blows_m_per_s: tuple[float, ...]
    exponent_per_period: float | None
    walked_periods: int
    growth: float | None = None

    @property
    def note(self) -> str:
        """Why there is no number where one would be expected; empty otherwise."""
        return f"period not resolved, growth {self.growth:.0e}" if self.kind == NOT_RESOLVED else ""


@kernel
def recorded(motion: MassMotion, system: ImpactSystem, periods: int) -> tuple[MassMotion, int, int, PeriodTable]:
    """Return the motion after a number of periods, how it ended (going, rest, escape), the periods done, and a table.

    Rows of the table beyond the walked ones are zero.
    """
    table = PeriodTable(
        np.zeros(periods), np.zeros(periods), np.zeros(periods), np.zeros(periods), np.zeros(periods), np.zeros(periods)
    )
    for i in range(periods):
        start = motion
        table.gap_m[i], table.velocity_m_per_s[i] = motion.gap_m, motion.velocity_m_per_s
        if rests_for_good(motion, system):
            return motion, REST, i, table
        done = next_period(motion, system)
        motion, table.impacts[i], table.chatter_ends[i] = done.motion, done.impacts, done.chatter_ends
        table.hardest_m_per_s[i], table.releases[i] = done.largest_blow_m_per_s, done.releases
        if leaves_for_good(start, motion, table.impacts[i], system):
            return motion, ESCAPE, i + 1, table
    return motion, GOING, periods, table


def return_period(table: PeriodTable) -> int:
    """Return the least k after which gap and velocity repeat throughout the table; 0 if none, or still settling."""
    state = np.column_stack([table.gap_m, table.velocity_m_per_s])
    scale = np.abs(state).max(axis=0)
    for k in range(1, len(state) // 2 + 1):
        if np.all(np.abs(state[k:] - state[:-k]) <= RETURN_TOLERANCE * scale):
            parted = (np.abs(state[d:] - state[:-d]) for d in range(1, k) if k % d == 0)
            faded = (each[:k].max(axis=0) - each[-k:].max(axis=0) for each in parted)
            return 0 if any(np.any(each > 0.5 * RETURN_TOLERANCE * scale) for each in faded) else k
    return 0


def _periodic(table: PeriodTable, k: int, walked: int, growth: float | None) -> LongRunRegime:
    last = table.last(k)
    impacts = tuple(-1 if ends > 0.0 else int(n) for ends, n in zip(last.chatter_ends, last.impacts, strict=True))
    completed = -1 in impacts
    hardest = last.hardest_m_per_s.tolist()
    starts = [i for i in range(k) if not completed or impacts[i - 1] == -1]
    first = min(starts, key=lambda i: (impacts[i:] + impacts[:i], -hardest[i]))
    impacts, last = impacts[first:] + impacts[:first], PeriodTable(*(np.roll(column, -first) for column in last))
    return LongRunRegime("periodic", k, impacts, completed, last.blows_m_per_s, None, walked, growth)


def _released(system: ImpactSystem, table: PeriodTable, k: int, walked: int) -> LongRunRegime:
    """Return the regime of a motion with releases k periods apart: periodic, or not resolved."""
    _, exponent_log = release_growth(system, float(k))
    growth = math.exp(min(exponent_log, LARGEST_LOG))
    if growth * ROUNDING <= RESOLVED:
        return _periodic(table, k, walked, growth)
    return LongRunRegime(NOT_RESOLVED, 0, (), True, table.last(WINDOW).blows_m_per_s, None, walked, growth)


def regime(system: ImpactSystem, motion: MassMotion, settling_periods: int = 1000) -> LongRunRegime:
    """Return the long-run regime of a motion.

    Parameters
    ----------
    system : ImpactSystem
        What acts on the mass.
    motion : MassMotion
        Where it starts.
    settling_periods : int
        Periods left out at first; doubled while no regime is found.
    """
    walked, settling = 0, settling_periods
    for _ in range(DOUBLINGS + 1):
        motion, ended, count, table = recorded(motion, system, settling + WINDOW)
        walked += count
        if ended != GOING:
            return LongRunRegime("rest" if ended == REST else "escape", 0, (), False, (), None, walked)
        *_, before, last = (-1, -1, *np.flatnonzero(table.releases))
        if before >= 0:
            return _released(system, table, int(last - before), walked)
        returned = return_period(table.last(WINDOW))
        if returned:
            return _periodic(table, returned, walked, None)
        settling *= 2
    return _without_period(motion, system, table.last(WINDOW), walked)


def _without_period(motion: MassMotion, system: ImpactSystem, window: PeriodTable, walked: int) -> LongRunRegime:
    motion, first = exponent(motion, system, EXPONENT_PERIODS)
    motion, second = exponent(motion, system, EXPONENT_PERIODS)
    kind = "chaotic" if min(first, second) > CHAOS_EXPONENT else "undecided"
    mean = 0.5 * (first + second)
    completed = bool(np.any(window.chatter_ends > 0.0))
    shown = mean if math.isfinite(mean) else None
    return LongRunRegime(kind, 0, (), completed, window.blows_m_per_s, shown, walked + 2 * EXPONENT_PERIODS)


def regime_of(parameters: ImpactMass, settling_periods: int = 1000) -> LongRunRegime:
    """Return the long-run regime from the configured start."""
    return regime(parameters.system, parameters.start, settling_periods)


def write_bifurcation_picture(key: str, values: Sequence[float], regimes: Sequence[LongRunRegime], path: Path) -> None:
    """Write the bifurcation picture: hardest blow of each period against the swept key, coloured by regime."""
    colours = {
        "periodic": "#3c5ab4",
        "chatter": "#c83c28",
        NOT_RESOLVED: "#e0a030",
        "chaotic": "#5a5a5a",
        "undecided": "#b0b0b0",
    }
    marks: dict[str, tuple[list[float], list[float]]] = {name: ([], []) for name in (*colours, "rest", "escape")}
    for value, found in zip(values, regimes, strict=True):
        name = "chatter" if found.kind == "periodic" and found.completed_chatter else found.kind
        blows = found.blows_m_per_s or (0.0,)
        x, y = marks[name]
        x.extend([value] * len(blows))
        y.extend(blows)
    figure, (axes,) = sheet(width=9.0, height=5.0)
    for name, (x, y) in marks.items():
        if x:
            sign = {"rest": "s", "escape": "^"}.get(name, ".")
            axes.plot(x, y, sign, color=colours.get(name, "#000000"), markersize=3.0, linestyle="none", label=name)
    axes.set_xlabel(key)
    axes.set_ylabel("hardest blow of a period, m/s")
    axes.legend(loc="best", fontsize="small")
    with written_file(path, force=True) as unfinished:
        figure.savefig(unfinished, dpi=120)
