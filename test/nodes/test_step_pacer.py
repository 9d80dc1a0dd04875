"""A step is due when the steady clock has come as far; time lost is not chased.  Without ROS."""

from __future__ import annotations

import pytest

from mech_twin.nodes.step_pacer import StepPacer


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
