# SPDX-License-Identifier: Apache-2.0
"""A decimated stream keeps the extreme of every window."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mech_twin.messages.peak_hold import PeakHoldWindow


@given(st.lists(st.floats(0.0, 1e6), min_size=1), st.integers(1, 12))
def test_of_each_window_the_greatest_survives(values: list[float], length: int) -> None:
    window = PeakHoldWindow[float](length)
    sent = [kept for value in values if (kept := window.offer(value, value)) is not None]
    rest = window.rest()
    if rest is not None:
        sent.append(rest)
    assert sent == [max(values[i : i + length]) for i in range(0, len(values), length)]
