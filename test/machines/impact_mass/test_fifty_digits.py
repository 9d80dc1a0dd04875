# SPDX-License-Identifier: Apache-2.0
"""The motion of random machines against 50 digits: another event walk, in mpmath, from the samples' side."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp, mpf, sqrt

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine

DIGITS = 50
LISTED = 1e-5  # of the first impact of a series: the reference lists no slower ones
SLOWEST_M_PER_S = 0.05  # impacts that are compared


def reference(case, duration_s):
    """Return (time, speed before) of every impact faster than `LISTED` of its series' first, up to a duration."""
    with mp.workdps(DIGITS):
        gap, speed = mpf(case["stop"]) - mpf(case["x0"]), mpf(case["v0"])
        found, number = [], 0
        while number * mpf(case["T"]) < duration_s:
            begin = number * mpf(case["T"])
            parts = ((case["P1"], begin, begin + mpf(case["t1"])), (case["P2"], begin + mpf(case["t1"]), None))
            for force, now, end in parts:
                until = (number + 1) * mpf(case["T"]) if end is None else end
                gap, speed = _phase(gap, speed, mpf(force) / mpf(case["m"]), now, until, mpf(case["R"]), found)
            number += 1
        return [(float(t), float(v)) for t, v in found if t <= duration_s]


def _phase(gap, speed, a, now, until, r, found):
    if gap == 0 and speed == 0 and a >= 0:
        return gap, speed
    first = None
    while True:
        square = speed**2 + 2 * a * gap
        if square <= 0 or (speed <= 0 and a <= 0):
            break
        before = sqrt(square)
        wait = 2 * gap / (speed + before) if speed >= 0 else (before - speed) / a
        if now + wait > until:
            break
        now += wait
        first = first or before
        if a > 0 and first == before and now + 2 * r * before / (a * (1 - r)) <= until:
            while before >= LISTED * first:
                found.append((now, before))
                now, before = now + 2 * r * before / a, r * before
            return mpf(0), mpf(0)
        if before >= LISTED * first:
            found.append((now, before))
        gap, speed = mpf(0), -r * before
    left = until - now
    return gap - left * (speed + a * left / 2), speed + a * left


RANDOM = np.random.default_rng(11)
CASES = [
    {
        "m": RANDOM.uniform(0.2, 5.0),
        "stop": RANDOM.uniform(-1.0, 1.0),
        "R": RANDOM.uniform(0.05, 0.9),
        "T": (period := RANDOM.uniform(0.02, 0.3)),
        "t1": period * (share := RANDOM.uniform(0.2, 0.8)),
        "P1": (push := RANDOM.uniform(400.0, 4000.0)),
        "P2": push * share / (1.0 - share) * RANDOM.uniform(-0.8, 0.2),
        "v0": RANDOM.uniform(-5.0, 5.0),
    }
    for _ in range(25)
]


@pytest.mark.parametrize("case", CASES, ids=range(len(CASES)))
def test_impacts_of_a_run_are_those_of_fifty_digits(case):
    case = {**case, "x0": case["stop"] - 0.3}
    keys = {
        "mass_kg": "m", "stop_position_m": "stop", "restitution": "R", "period_s": "T", "phase1_duration_s": "t1",
        "phase1_force_n": "P1", "phase2_force_n": "P2", "initial_position_m": "x0", "initial_velocity_m_per_s": "v0",
    }  # fmt: skip
    overrides = {key: float(case[short]) for key, short in keys.items()}
    duration = 8.0 * case["T"]
    run = frames(machine("impact_mass", overrides=overrides), duration + 0.002)
    blows = [e for f in run for e in f.linkage.events if e.kind == "impact" and e.time_s <= duration]
    exact = [(t, v) for t, v in reference(case, duration) if v > SLOWEST_M_PER_S]
    ours = [(e.time_s, e.pre_velocity_m_per_s) for e in blows if e.pre_velocity_m_per_s > SLOWEST_M_PER_S]
    assert len(ours) == len(exact) > 0
    for (mine_t, mine_v), (t, v) in zip(ours, exact, strict=True):
        assert mine_t == pytest.approx(t, rel=1e-9, abs=1e-12)
        assert mine_v == pytest.approx(v, rel=1e-8)
