# SPDX-License-Identifier: Apache-2.0
"""The time of a recording is that of the run that is followed, and gaps are its gaps.  Without ROS."""

from __future__ import annotations

import pytest

from mech_twin.nodes.exchange.counting import StepSequence
from mech_twin.nodes.roles.recorder_node import LARGEST_NS, SAME_RUN_NS, RecordingClock

WALL_NS = 1_790_000_000 * 10**9


@pytest.mark.parametrize("stamp", [-1, -(10**18), WALL_NS, LARGEST_NS, 2**31 * 10**9])
def test_a_time_no_run_can_have_does_not_lead(stamp: int) -> None:
    clock = RecordingClock()
    assert clock.lead(5_000_000)
    assert not clock.lead(stamp)
    assert clock.now_ns == 5_000_000
    assert not clock.belongs(stamp)


def test_what_is_near_the_run_belongs_to_it() -> None:
    clock = RecordingClock()
    clock.lead(60 * 10**9)
    assert clock.belongs(60 * 10**9 - SAME_RUN_NS)
    assert clock.belongs(61 * 10**9)
    assert not clock.belongs(0)
    assert not clock.belongs(60 * 10**9 + SAME_RUN_NS + 1)


def test_steps_are_counted_as_missing_repeated_or_late() -> None:
    sequence = StepSequence()
    found = [sequence.take(step) for step in (3, 4, 8, 8, 5, 9)]
    assert [None if fault is None else (fault.kind, fault.number) for fault in found] == [
        None,
        None,
        ("missing", 3),
        ("repeated", 1),
        ("late", 1),
        None,
    ]
