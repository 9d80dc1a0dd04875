# SPDX-License-Identifier: Apache-2.0
"""Impacts per second beside scipy's ``solve_ivp`` with events, and the time errors of both against 60 digits.

Three cases, each the same for both: 200 periods towards a stable one-impact motion (T = 0.2 s, t1 = 0.05 s, P1 = 560 N,
P2 = -20 N); the first five periods of fig. 3b, which end before the first endless series (the peer cannot pass one);
and one glancing blow.  The peer gets a terminal event, a restart after every blow and at every
change of the force, and tight tolerances; with free steps it may step over a root, so it also runs with short ones.

``python benchmarks/impact_mass.py [--write]``.
"""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from comparison import Table, in_turn, measure, ratio
from scipy.integrate import solve_ivp

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.impact_mass.dynamics import (
    IMPACT,
    ImpactSystem,
    MassMotion,
    impact_system,
    initial_motion,
    next_event,
)

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
from literature.impact_reference import number, walk

ROUNDS, EVENTS, MEMORY_BLOCKS = 7, 1_000_000, 10


class Case(NamedTuple):
    period_s: float
    t1_s: float
    p1_n: float
    p2_n: float
    gap_m: float
    periods: int


STEADY = Case(0.2, 0.05, 560.0, -20.0, 0.5, 200)
FIG3B = Case(0.05, 0.03, 1000.0, -500.0, 0.5, 5)
GLANCING = Case(0.1, 0.02, 1000.0, -665.0, 0.5, 1)
R = 0.3


def started(case: Case):
    """Return what acts on the unit mass of a case, and its start."""
    system = impact_system((case.period_s, case.t1_s), (case.p1_n, case.p2_n), R, 0.0)
    return system, initial_motion(case.gap_m, 0.0, system)


def peer_times(case: Case, max_step_s: float = np.inf) -> list[float]:
    """Return the impact times of ``solve_ivp`` with a terminal event, restarted at every blow and change of force."""

    def stop(_, y):
        return y[0]

    stop.terminal, stop.direction = True, 1.0
    times, y = [], np.array([-case.gap_m, 0.0])
    options = {"events": stop, "rtol": 1e-10, "atol": 1e-12, "max_step": max_step_s}
    for n in range(case.periods):
        begin, middle, end = n * case.period_s, n * case.period_s + case.t1_s, (n + 1) * case.period_s
        for t, until, a in ((begin, middle, case.p1_n), (middle, end, case.p2_n)):
            now = t
            while now < until:
                run = solve_ivp(lambda _, y, a=a: (y[1], a), (now, until), y, **options)
                now, y = run.t[-1], run.y[:, -1].copy()
                if run.status == 1:
                    times.append(now)
                    y = np.array([-1e-14, -R * y[1]])  # a hair off the stop, or the event fires at once
    return times


def our_times(case: Case) -> list[float]:
    """Return our impact times, one event at a time."""
    system, motion = started(case)
    times = []
    while motion.period < case.periods:
        event, motion = next_event(motion, system)
        if event.kind == IMPACT:
            times.append(event.period * case.period_s + event.tau_s)
    return times


def exact_times(case: Case) -> list[float]:
    """Return the impact times in 60 digits, for the doubles of the case."""
    values = {"T": case.period_s, "t1": case.t1_s, "A1": case.p1_n, "A2": case.p2_n, "R": R}
    known = {k: number(v) for k, v in {**values, "gap": case.gap_m, "speed": 0.0}.items()}
    return [float(e.time) for e in walk(known, case.periods) if e.kind == "impact"]


def largest_error(times: list[float], exact: list[float]) -> str:
    """Return the largest time error as text, and how many impacts are missing or too many."""
    shared = min(len(times), len(exact))
    error = np.max(np.abs(np.array(times[:shared]) - np.array(exact[:shared])), initial=0.0)
    return f"{error:.1e} s, {len(times)} of {len(exact)} impacts"


@kernel
def walked(motion: MassMotion, system: ImpactSystem, events: int) -> tuple[MassMotion, float]:
    """Return the motion after a number of events, and the impacts among them."""
    impacts = 0.0
    for _ in range(events):
        event, motion = next_event(motion, system)
        impacts += event.impacts
    return motion, impacts


def speed() -> Table:
    """Return impacts a second of both in the stable motion."""
    system, start = started(STEADY)
    impacts = walked(start, system, EVENTS)[1]
    theirs = len(peer_times(STEADY))
    times = in_turn(
        {
            "ours": lambda: walked(start, system, EVENTS),
            "theirs": lambda: peer_times(STEADY),
        },
        ROUNDS,
    )
    each = {"ours": [t / impacts for t in times["ours"]], "theirs": [t / theirs for t in times["theirs"]]}
    rates = [f"{1.0 / min(each[who]):.2g}" for who in ("ours", "theirs")]
    how = f"Impacts a second in one stable motion, one core, processor time, best of {ROUNDS} rounds in turn."
    return Table(how, ("ours", "`solve_ivp` with events", "ratio (spread)"), [(*rates, ratio(each, "theirs", "ours"))])


def errors() -> Table:
    """Return the largest time errors of all cases."""
    rows = []
    for name, case in {"200 stable periods": STEADY, "five of fig. 3b": FIG3B, "one glancing blow": GLANCING}.items():
        exact, ours = exact_times(case), our_times(case)
        if len(ours) != len(exact) or not np.allclose(ours, exact, rtol=1e-9, atol=0.0):
            raise SystemExit(f"impact_mass: {name}: ours differs from 60 digits")
        short = peer_times(case, case.period_s / 50.0)
        rows.append((name, *(largest_error(times, exact) for times in (ours, peer_times(case), short))))
    how = "Largest error of an impact's time against 60 digits; impacts found of those there are."
    return Table(how, ("case", "ours", "`solve_ivp`, free steps", "`solve_ivp`, steps of T/50 at most"), rows)


def memory() -> Table:
    """Return speed and growth of memory over ten million events."""
    system, motion = started(STEADY)
    rates = []
    walked(motion, system, 10)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(MEMORY_BLOCKS):
        begun = time.process_time()
        motion, _ = walked(motion, system, EVENTS)
        rates.append(EVENTS / (time.process_time() - begun))
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    how = "Events one after the other, without an end to memory's growth if there were one."
    columns = ("events", "a second, slowest million", "fastest million", "memory grew by")
    return Table(
        how, columns, [(str(EVENTS * MEMORY_BLOCKS), f"{min(rates):.2g}", f"{max(rates):.2g}", f"{grown} KiB")]
    )


def measured() -> list[Table]:
    """Return all tables."""
    return [speed(), errors(), memory()]


if __name__ == "__main__":
    measure("impact_mass", measured)
