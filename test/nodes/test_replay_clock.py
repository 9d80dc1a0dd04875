# SPDX-License-Identifier: Apache-2.0
"""The position of a replay: it runs at its rate, stands still while paused, and never floods."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from mech_twin.nodes.replay.source import LARGEST_LAG_S, ReplayClock

RATES = st.floats(0.001, 1000.0)
TIMES = st.floats(0.0, 1000.0)


@given(RATES, TIMES)
def test_the_position_runs_at_the_rate(rate: float, elapsed_s: float) -> None:
    clock = ReplayClock(5, rate, 10.0)
    position = clock.position_ns(10.0 + elapsed_s)
    rounding_ns = 0.5 + 10.0 * rate  # positions are whole nanoseconds, and the steady time has its own last bit
    assert math.isclose(position - 5, elapsed_s * rate * 1e9, rel_tol=1e-9, abs_tol=rounding_ns)
    assert abs(clock.wait_s(position, 10.0 + elapsed_s)) < 1e-8 / rate + 1e-8


@given(RATES, RATES, TIMES)
def test_a_change_of_rate_moves_nothing(before: float, after: float, elapsed_s: float) -> None:
    clock = ReplayClock(0, before, 0.0)
    position = clock.position_ns(elapsed_s)
    clock.change_rate(after, elapsed_s)
    assert clock.position_ns(elapsed_s) == position


def test_a_pause_takes_no_recorded_time() -> None:
    clock = ReplayClock(0, 2.0, 0.0)
    clock.pause(1.0)
    assert clock.position_ns(50.0) == 2_000_000_000
    assert clock.wait_s(0, 50.0) == math.inf
    clock.resume(100.0)
    assert clock.position_ns(101.0) == 4_000_000_000


def test_who_cannot_keep_up_gets_slower_rather_than_floods() -> None:
    clock = ReplayClock(0, 1.0, 0.0)
    assert not clock.give_way(0, LARGEST_LAG_S / 2)
    assert clock.give_way(0, 10.0)
    assert clock.position_ns(10.0) == 0
