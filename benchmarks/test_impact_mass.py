# SPDX-License-Identifier: Apache-2.0
"""Impacts per second beside scipy's ``solve_ivp`` with events, and the time errors of both against 60 digits.

Three cases, each the same for both: 200 periods towards a stable one-impact motion (T = 0.2 s, t1 = 0.05 s, P1 = 560 N,
P2 = -20 N); the first five periods of fig. 3b, which end before the first endless series (the peer cannot pass one);
and one glancing blow.  The peer gets a terminal event, a restart after every blow and at every
change of the force, and tight tolerances; with free steps it may step over a root, so it also runs with short ones.

Run ``pytest benchmarks/test_impact_mass.py -s`` for the ratios; nothing here asserts a time.
"""

from __future__ import annotations

import resource
import sys
import time
from typing import NamedTuple

import numpy as np
import pytest
from literature.impact_reference import number, walk
from scipy.integrate import solve_ivp

from mech_twin.machines.impact_mass.batch import empty_tally, event_batch
from mech_twin.machines.impact_mass.dynamics import (
    impact_system,
    initial_motion,
    next_event,
)
from mech_twin.machines.impact_mass.states import (
    IMPACT,
)


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


def told(line: str) -> None:
    sys.stdout.write(f"\n{line}\n")


def test_impacts_per_second(benchmark):
    system, start = started(STEADY)
    event_batch(start, system, empty_tally(start), 10, 1e9)
    tally = benchmark(lambda: event_batch(start, system, empty_tally(start), 3_000_000, 1e9)[1])
    ours = tally.impacts / benchmark.stats.stats.min
    begun = time.perf_counter()
    peer = len(peer_times(STEADY)) / (time.perf_counter() - begun)
    told(f"impacts per second: ours {ours:.3g}, solve_ivp {peer:.3g}, ratio {ours / peer:.3g}")


@pytest.mark.parametrize("case", [STEADY, FIG3B, GLANCING], ids=["steady", "fig_3b", "glancing"])
def test_largest_time_error(case):
    exact = exact_times(case)
    ours = our_times(case)
    told(f"largest time error: ours {largest_error(ours, exact)}")
    told(f"  solve_ivp, free steps: {largest_error(peer_times(case), exact)}")
    short = case.period_s / 50.0
    told(f"  solve_ivp, steps of T/50 at most: {largest_error(peer_times(case, short), exact)}")
    assert ours == pytest.approx(exact, rel=1e-9)


@pytest.mark.slow
def test_ten_million_events_in_flat_memory_at_constant_speed():
    system, motion = started(STEADY)
    tally, rates = empty_tally(motion), []
    event_batch(motion, system, tally, 10, 1e9)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(10):
        begun = time.perf_counter()
        motion, tally = event_batch(motion, system, tally, 1_000_000, 1e12)
        rates.append(1e6 / (time.perf_counter() - begun))
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    told(f"{tally.events:.0f} events: {min(rates):.3g} to {max(rates):.3g} a second; memory grew by {grown} KiB")
    assert tally.events == 10_000_000
    assert grown < 2_000
