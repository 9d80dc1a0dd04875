# SPDX-License-Identifier: Apache-2.0
"""A step is due when the steady clock has come as far; a lag is told, and caught up or given up.  Without ROS."""

from __future__ import annotations

import pytest

from mech_twin.nodes.roles.run_control import (
    BEGINNING_S,
    GIVEN_UP_FROM_S,
    LOGGED_EVERY_S,
    LOGGED_FROM_S,
    LagNotice,
    StepPacer,
)


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_at_full_pace_every_step_is_due() -> None:
    pacer = StepPacer(1e-3, realtime=False)
    assert pacer.wait_s(10**9) == 0.0
    assert pacer.worst_lag_s == 0.0


def test_in_real_time_a_step_waits_for_its_time() -> None:
    clock = Clock()
    pacer = StepPacer(1e-3, realtime=True, clock=clock)
    assert pacer.wait_s(50) == 0.0
    assert pacer.wait_s(53) == pytest.approx(3e-3)
    clock.now_s += 5e-3
    assert pacer.wait_s(53) == 0.0
    pacer.passed(53)
    assert pacer.worst_lag_s == pytest.approx(2e-3)


def test_after_a_wait_the_schedule_begins_anew_from_the_clock_as_it_is() -> None:
    clock = Clock()
    pacer = StepPacer(1e-3, realtime=True, clock=clock)
    pacer.wait_s(0)
    clock.now_s += 60.0
    pacer.resume()
    assert pacer.wait_s(10) == 0.0
    assert pacer.wait_s(11) == pytest.approx(1e-3)


def test_what_holds_a_run_up_as_it_begins_is_not_caught_up() -> None:
    clock = Clock()
    pacer = StepPacer(1e-3, realtime=True, clock=clock)
    pacer.wait_s(1)
    clock.now_s += 0.7
    pacer.passed(2)
    assert pacer.lag_s == pacer.worst_lag_s == 0.0
    assert pacer.wait_s(3) == 0.0
    assert pacer.wait_s(4) == pytest.approx(1e-3)
    clock.now_s += BEGINNING_S
    pacer.passed(4)
    assert pacer.lag_s == pytest.approx(BEGINNING_S - 1e-3)


def behind(lag_s: float) -> tuple[Clock, StepPacer, LagNotice]:
    """Return a run that is late by a time at its step 1000."""
    clock = Clock()
    pacer = StepPacer(1e-3, realtime=True, clock=clock)
    pacer.wait_s(0)
    clock.now_s += 1.0 + lag_s
    pacer.passed(1000)
    return clock, pacer, LagNotice(clock)


def test_a_lag_is_told_at_once_and_every_ten_seconds_and_its_end_once() -> None:
    clock, pacer, notice = behind(3.0)
    assert notice.lines(pacer) == ("behind by 3.0 s", "behind by 3.0 s")
    clock.now_s += 0.5 * LOGGED_EVERY_S
    assert notice.lines(pacer) == ("behind by 3.0 s", "")
    clock.now_s += 0.6 * LOGGED_EVERY_S
    assert notice.lines(pacer) == ("behind by 3.0 s", "behind by 3.0 s")
    pacer.passed(1000 + round(1e3 * (3.0 + 1.1 * LOGGED_EVERY_S)))
    assert pacer.lag_s == pytest.approx(0.0, abs=1e-9)
    assert notice.lines(pacer) == ("", "caught up with the wall clock")
    assert notice.lines(pacer) == ("", "")
    assert pacer.worst_lag_s == pytest.approx(3.0)


def test_a_run_that_is_behind_waits_for_nothing_until_it_has_caught_up() -> None:
    _, pacer, _ = behind(3.0)
    assert pacer.wait_s(1001) == pacer.wait_s(3999) == 0.0
    assert pacer.wait_s(4001) == pytest.approx(1e-3)


def test_a_small_lag_is_not_told() -> None:
    _, pacer, notice = behind(0.9 * LOGGED_FROM_S)
    assert notice.lines(pacer) == ("", "")


def test_a_lag_that_is_too_large_is_given_up_counted_and_told_once() -> None:
    lag_s = GIVEN_UP_FROM_S + 2.0
    _, pacer, notice = behind(lag_s)
    assert pacer.given_up_s == pytest.approx(lag_s)
    state, line = notice.lines(pacer)
    assert state == line == "gave up 12.0 s it was behind; this machine is too slow for real time"
    assert pacer.wait_s(1001) == 0.0
    assert pacer.wait_s(1002) == pytest.approx(1e-3)
    pacer.passed(1001)
    assert notice.lines(pacer) == ("", "caught up with the wall clock")
