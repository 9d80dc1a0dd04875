# SPDX-License-Identifier: Apache-2.0
"""Which stamps lead the time of a machine that is followed: those that go on, never a single one.  Without ROS."""

from __future__ import annotations

import pytest

from mech_twin.nodes.shadow.inputs import MOST_HELD, SECOND_NS, FollowedClock, StampGate

WALL_NS = 1_790_000_000 * SECOND_NS
STEP_NS, STEP_S = SECOND_NS // 100, 0.01
STRAYS_NS = (WALL_NS, WALL_NS + 3600 * SECOND_NS, 0, -1, -(2**31) * SECOND_NS, (2**31 - 1) * SECOND_NS)


def clock_at(begin_ns: int) -> FollowedClock:
    clock = FollowedClock()
    for i in range(10):
        clock.admit(begin_ns + i * STEP_NS, i * STEP_S)
    assert clock.now_ns == begin_ns + 9 * STEP_NS
    return clock


@pytest.mark.parametrize("stray", STRAYS_NS)
def test_a_single_stamp_that_does_not_go_on_is_not_believed_and_leads_nothing(stray: int) -> None:
    begin_ns = 100 * SECOND_NS
    clock = clock_at(begin_ns)
    assert not clock.admit(stray, 0.1)
    assert clock.now_ns == begin_ns + 9 * STEP_NS
    assert clock.admit(begin_ns + 10 * STEP_NS, 0.1)
    assert clock.now_ns == begin_ns + 10 * STEP_NS
    assert clock.jumps == 0


def test_stamps_of_somebody_else_between_those_of_the_machine_never_lead() -> None:
    clock = clock_at(0)
    for i in range(10, 200):
        assert not clock.admit(WALL_NS + i * STEP_NS, i * STEP_S)
        assert clock.admit(i * STEP_NS, i * STEP_S)
    assert (clock.now_ns, clock.jumps) == (199 * STEP_NS, 0)


@pytest.mark.parametrize("begin_ns", [0, WALL_NS])
def test_a_machine_that_is_started_anew_is_followed_from_its_third_stamp_on(begin_ns: int) -> None:
    clock = clock_at(50 * SECOND_NS)
    believed = [clock.admit(begin_ns + i * STEP_NS, 0.1 + i * STEP_S) for i in range(5)]
    assert believed == [False, False, True, True, True]
    assert (clock.now_ns, clock.jumps) == (begin_ns + 4 * STEP_NS, 1)


def test_after_a_silence_the_machine_may_be_as_far_ahead_as_time_has_passed() -> None:
    clock = clock_at(0)
    assert clock.admit(60 * SECOND_NS, 60.0)
    assert not clock.admit(90 * SECOND_NS, 60.1)


def test_topics_a_little_behind_each_other_are_believed_and_time_does_not_go_back() -> None:
    clock = clock_at(50 * SECOND_NS)
    before = clock.now_ns
    assert clock.admit(50 * SECOND_NS - SECOND_NS // 2, 0.1)
    assert clock.now_ns == before


@pytest.mark.parametrize("stray", STRAYS_NS)
def test_what_comes_first_is_held_until_the_time_is_known(stray: int) -> None:
    admission = StampGate[str]()
    begin_ns = 50 * SECOND_NS
    assert admission.take("own", None, 0.0) == []
    assert admission.take("stray", stray, 0.0) == []
    found = [each for i in range(3) for each in admission.take(f"{i}", begin_ns + i * STEP_NS, i * STEP_S)]
    assert [each.item for each in found] == ["own", "stray", "0", "1", "2"]
    assert [each.believed for each in found] == [False, False, True, True, True]
    assert [each.at_ns - begin_ns for each in found] == [0, 0, 0, STEP_NS, 2 * STEP_NS]
    (late,) = admission.take("stray", stray, 0.1)
    assert (late.at_ns, late.believed) == (begin_ns + 2 * STEP_NS, False)


def test_two_publishers_that_begin_together_do_not_keep_each_other_from_being_followed() -> None:
    admission = StampGate[str]()
    found = []
    for i in range(4):
        for begin_ns in (0, WALL_NS):
            found += admission.take("", begin_ns + i * STEP_NS, i * STEP_S)
    assert sum(each.believed for each in found) == 4
    assert admission.clock.jumps == 0


def test_what_is_held_where_no_time_is_ever_known_is_bounded_and_comes_out() -> None:
    admission = StampGate[int]()
    found = [each for i in range(MOST_HELD + 1) for each in admission.take(i, None, 0.0)]
    assert [each.item for each in found] == list(range(MOST_HELD + 1))
    assert {each.at_ns for each in found} == {0}
    admission.take(-1, None, 0.0)
    assert [each.item for each in admission.released()] == [-1]
