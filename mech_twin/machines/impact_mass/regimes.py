"""Long-run regimes of the impact mass over a sweep of one parameter, and their bifurcation picture.

How regimes are told apart (every rule but the last two is exact):

- *rest*: at the stop with A1 >= 0 and A2 >= 0; no phase ever releases it.
- *escape*: <A> <= 0 and a period without contact that ends no nearer and no faster than it began.
- *periodic*, by release: a mass released from rest always goes on the same way, so two releases close an exact
  period; its length is the number of periods between them.
- *periodic*, by return: gap and velocity at the period starts repeat after k periods, throughout a window of
  `WINDOW` periods, within 1e-9 of the largest gap and speed in it; k at most half the window.
- Neither: the run is doubled, `DOUBLINGS` times, for it may be a long transient.  Then *chaotic* if the largest
  Lyapunov exponent (closed-form tangent map of flights and blows) exceeds 0.01 a period in both halves of a last
  long window, else *undecided*: a transient longer than the run, or a marginal motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mech_twin.configuration_tree import configuration_tree, merged_tree, tree_from_flat
from mech_twin.kernel import kernel
from mech_twin.machines.impact_mass.batch import leaves_for_good
from mech_twin.machines.impact_mass.dynamics import (
    ImpactSystem,
    MassMotion,
    acceleration,
    initial_motion,
    next_event,
    phase_end,
    rests_for_good,
)
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.states import (
    CHATTER_END,
    IMPACT,
    PHASE_CHANGE,
    RELEASE,
)

WINDOW = 512
DOUBLINGS = 4
RETURN_TOLERANCE = 1e-9
CHAOS_EXPONENT = 0.01
EXPONENT_PERIODS = 4000
ROW = 6  # of a period: gap, velocity at its start, impacts, chatter ends, hardest blow, releases
REST, ESCAPE, GOING = 1, 2, 0


@dataclass(frozen=True)
class LongRunRegime:
    """What the motion does in the long run.

    ``impacts_per_period`` lists one period of the motion (a completed series counts as -1 in its period: endless);
    ``blows_m_per_s`` are the hardest blows of these periods (of the last window where there is no period).
    """

    kind: str
    period: int
    impacts_per_period: tuple[int, ...]
    completed_chatter: bool
    blows_m_per_s: tuple[float, ...]
    exponent_per_period: float | None
    walked_periods: int


@dataclass(frozen=True)
class RegimeMap:
    """Regimes over the values of one configuration key."""

    key: str
    values: tuple[float, ...]
    regimes: tuple[LongRunRegime, ...]


@kernel
def recorded(motion: MassMotion, system: ImpactSystem, periods: int) -> tuple[MassMotion, int, NDArray[np.float64]]:
    """Return the motion after so many periods, how it ended (going, rest, escape), and a row for each period."""
    rows = np.zeros((periods, ROW))
    for i in range(periods):
        row, start = rows[i], motion
        row[0], row[1] = motion.gap_m, motion.velocity_m_per_s
        if rests_for_good(motion, system):
            return motion, REST, rows[:i]
        while motion.period == start.period:
            event, motion = next_event(motion, system)
            if event.impacts > 0.0:
                row[2] += event.impacts
                row[4] = max(row[4], event.pre_m_per_s)
            elif event.kind == RELEASE:
                row[5] += 1.0
            elif event.kind == CHATTER_END:
                row[3] += 1.0
        if leaves_for_good(start, motion, row[2], system):
            return motion, ESCAPE, rows[: i + 1]
    return motion, GOING, rows


@kernel
def flown_tangent(dx: float, dv: float, duration_s: float) -> tuple[float, float]:
    """Return a small difference of two motions after a flight: dx + dv t, dv."""
    return dx + dv * duration_s, dv


@kernel
def exponent(motion: MassMotion, system: ImpactSystem, periods: int) -> tuple[MassMotion, float]:
    """Return the motion after so many periods and the mean growth of a small difference per period (natural log).

    Flight: (1 t; 0 1).  Blow with speed v- under A: (-R 0; (1 + R) A/v- -R).  Lengths are scaled by the period, so
    that both components are speeds.  A completed series forgets every difference: the growth is -inf.
    """
    dx, dv, growth = 1.0, 0.7, 0.0
    last = motion.period + periods
    while motion.period < last:
        a, end = acceleration(motion, system), phase_end(motion, system)
        event, after = next_event(motion, system)
        if event.kind == IMPACT:
            dx, dv = flown_tangent(dx, dv, (event.tau_s - motion.tau_s) / system.period_s)
            turn = (1.0 + system.restitution) * a * system.period_s / event.pre_m_per_s
            dx, dv = -system.restitution * dx, turn * dx - system.restitution * dv
        elif event.kind != PHASE_CHANGE:
            return after, -math.inf
        else:
            dx, dv = flown_tangent(dx, dv, (end - motion.tau_s) / system.period_s)
        size = math.hypot(dx, dv)
        growth += math.log(size)
        dx, dv, motion = dx / size, dv / size, after
    return motion, growth / periods


def return_period(rows: NDArray[np.float64]) -> int:
    """Return the least k after which gap and velocity repeat throughout the rows, or 0."""
    state = rows[:, :2]
    scale = np.abs(state).max(axis=0)
    for k in range(1, len(rows) // 2 + 1):
        if np.all(np.abs(state[k:] - state[:-k]) <= RETURN_TOLERANCE * scale):
            return k
    return 0


def release_period(rows: NDArray[np.float64]) -> int:
    """Return the number of periods between the last two releases, or 0 if there are not two."""
    released = np.flatnonzero(rows[:, 5])
    return int(released[-1] - released[-2]) if len(released) > 1 else 0


def _counts(rows: NDArray[np.float64]) -> tuple[int, ...]:
    return tuple(-1 if row[3] > 0.0 else int(row[2]) for row in rows)


def _periodic(rows: NDArray[np.float64], k: int, walked: int) -> LongRunRegime:
    last = rows[-k:]
    blows = tuple(float(v) for v in last[last[:, 2] > 0.0, 4])
    return LongRunRegime("periodic", k, _counts(last), bool(np.any(last[:, 3] > 0.0)), blows, None, walked)


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
        motion, ended, rows = recorded(motion, system, settling + WINDOW)
        walked += len(rows)
        if ended != GOING:
            return LongRunRegime("rest" if ended == REST else "escape", 0, (), False, (), None, walked)
        k = release_period(rows) or return_period(rows[-WINDOW:])
        if k:
            return _periodic(rows, k, walked)
        settling *= 2
    motion, first = exponent(motion, system, EXPONENT_PERIODS)
    motion, second = exponent(motion, system, EXPONENT_PERIODS)
    kind = "chaotic" if min(first, second) > CHAOS_EXPONENT else "undecided"
    window = rows[-WINDOW:]
    blows = tuple(float(v) for v in window[window[:, 2] > 0.0, 4])
    mean = 0.5 * (first + second)
    completed = bool(np.any(window[:, 3] > 0.0))
    shown = mean if math.isfinite(mean) else None
    return LongRunRegime(kind, 0, (), completed, blows, shown, walked + 2 * EXPONENT_PERIODS)


def regime_of(parameters: ImpactMass, settling_periods: int = 1000) -> LongRunRegime:
    """Return the long-run regime from the configured start."""
    system = parameters.system
    start = initial_motion(parameters.initial_gap_m, parameters.initial_velocity_m_per_s, system)
    return regime(system, start, settling_periods)


def with_value(parameters: ImpactMass, key: str, value: float) -> ImpactMass:
    """Return the parameters with one key changed, validated anew."""
    changes: dict[str, Any] = tree_from_flat({key: value})
    return ImpactMass.model_validate(merged_tree(configuration_tree(parameters), changes))


def regime_map(
    parameters: ImpactMass,
    values: Sequence[float],
    key: str = "phase1_duration_s",
    settling_periods: int = 1000,
    progress: Callable[[int, int], None] | None = None,
) -> RegimeMap:
    """Return the long-run regimes for each value of a configuration key, each from the configured start.

    Parameters
    ----------
    parameters : ImpactMass
        The rest of the configuration.
    values : sequence of float
        Values of the key, in its unit.
    key : str
        Configuration key.
    settling_periods : int
        See `regime`.
    progress : callable, optional
        ``progress(done, all)`` after each value.

    Raises
    ------
    pydantic.ValidationError
        If a value makes a configuration that cannot be.
    """
    found = []
    for number, value in enumerate(values, 1):
        found.append(regime_of(with_value(parameters, key, float(value)), settling_periods))
        if progress is not None:
            progress(number, len(values))
    return RegimeMap(key, tuple(float(v) for v in values), tuple(found))


def write_bifurcation_picture(regimes: RegimeMap, path: Path) -> None:
    """Write the bifurcation picture: hardest blow of each period against the swept key, coloured by regime."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    colours = {"periodic": "#3c5ab4", "chatter": "#c83c28", "chaotic": "#5a5a5a", "undecided": "#b0b0b0"}
    marks: dict[str, tuple[list[float], list[float]]] = {name: ([], []) for name in (*colours, "rest", "escape")}
    for value, found in zip(regimes.values, regimes.regimes, strict=True):
        name = "chatter" if found.kind == "periodic" and found.completed_chatter else found.kind
        blows = found.blows_m_per_s or (0.0,)
        marks[name][0].extend([value] * len(blows))
        marks[name][1].extend(blows)
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for name, (x, y) in marks.items():
        if x:
            sign = {"rest": "s", "escape": "^"}.get(name, ".")
            axes.plot(x, y, sign, color=colours.get(name, "#000000"), markersize=3.0, linestyle="none", label=name)
    axes.set_xlabel(regimes.key)
    axes.set_ylabel("hardest blow of a period, m/s")
    axes.legend(loc="best", fontsize="small")
    figure.savefig(path, dpi=120)
