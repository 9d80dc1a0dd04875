# SPDX-License-Identifier: Apache-2.0
"""A decimated stream keeps the first sample of each window, both sides of an impact, and the window's greatest."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.messages.topics import PeakHoldWindow, StreamWindow, steps_per_window

STEPS = st.lists(st.tuples(st.sampled_from([0.0, 1.0, 2.5, 7.0]), st.booleans()), min_size=1, max_size=60)


def sent(length: int, steps: list[tuple[float, bool]]) -> list[int]:
    """Return the steps that go out of a stream of (magnitude, impact)."""
    window = StreamWindow[int](length)
    out = [due for i, (size, impact) in enumerate(steps) for due in window.offer(i, i, size, impact)]
    return [*out, *window.rest()]


@given(st.integers(1, 12), STEPS)
def test_items_go_out_in_order_and_once(length: int, steps: list[tuple[float, bool]]) -> None:
    out = sent(length, steps)
    assert out == sorted(set(out))


@given(st.integers(1, 12), STEPS)
def test_the_first_of_each_window_goes_out(length: int, steps: list[tuple[float, bool]]) -> None:
    assert set(range(0, len(steps), length)) <= set(sent(length, steps))


@given(st.integers(1, 12), STEPS)
def test_both_sides_of_every_impact_go_out(length: int, steps: list[tuple[float, bool]]) -> None:
    struck = [i for i, (_, impact) in enumerate(steps) if impact]
    assert set(struck) | {i - 1 for i in struck if i > 0} <= set(sent(length, steps))


@pytest.mark.slow
@given(st.integers(1, 12), STEPS)
def test_the_greatest_of_each_window_goes_out(length: int, steps: list[tuple[float, bool]]) -> None:
    out = sent(length, steps)
    for begin in range(0, len(steps), length):
        window = range(begin, min(begin + length, len(steps)))
        assert max(steps[i][0] for i in window) == max(steps[i][0] for i in window if i in out)


@given(st.integers(2, 12), st.integers(1, 60))
def test_where_nothing_strikes_and_nothing_is_greater_one_a_window_goes_out(length: int, count: int) -> None:
    assert sent(length, [(1.0, False)] * count) == list(range(0, count, length))


def test_a_stream_as_fast_as_the_steps_has_every_step() -> None:
    for rate_hz in (1000.0, 5000.0):
        length = steps_per_window(rate_hz, 0.001)
        assert sent(length, [(0.0, False)] * 20) == list(range(20))


def test_a_window_is_the_step_over_the_rate() -> None:
    assert [steps_per_window(rate_hz, 0.001) for rate_hz in (1.0, 30.0, 100.0, 400.0)] == [1000, 33, 10, 2]
    assert steps_per_window(100.0, 2e-4) == 50


@pytest.mark.slow
@given(st.lists(st.floats(0.0, 1e6), min_size=1), st.integers(1, 12))
def test_of_each_window_the_greatest_survives(values: list[float], length: int) -> None:
    window = PeakHoldWindow[float](length)
    sent = [kept for value in values for kept in window.offer(value, value)]
    assert [*sent, *window.rest()] == [max(values[i : i + length]) for i in range(0, len(values), length)]
