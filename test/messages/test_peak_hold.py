# SPDX-License-Identifier: Apache-2.0
"""A decimated stream keeps the extreme of every window."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mech_twin.messages.stream_window import PeakHoldWindow


@given(st.lists(st.floats(0.0, 1e6), min_size=1), st.integers(1, 12))
def test_of_each_window_the_greatest_survives(values: list[float], length: int) -> None:
    window = PeakHoldWindow[float](length)
    sent = [kept for value in values for kept in window.offer(value, value)]
    assert [*sent, *window.rest()] == [max(values[i : i + length]) for i in range(0, len(values), length)]
