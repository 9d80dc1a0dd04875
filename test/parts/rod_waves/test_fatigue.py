# SPDX-License-Identifier: Apache-2.0
"""Cycles by rainflow as the standard counts them, and the damage of an S-N line."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.parts.rod_waves.fatigue import StressLine, blow_damage, cycle_damage, rainflow

LINE = StressLine(2e8, 2e6, 5.0, 9e8, 1.0)


def counted(history: list[float]) -> list[tuple[float, float, float]]:
    room = np.empty((len(history), 3))
    count = rainflow(np.array(history), np.empty(len(history)), room)
    return [tuple(row) for row in room[:count].tolist()]


def test_the_history_of_the_standard_is_counted_as_printed() -> None:
    """ASTM E1049-85, figure 6: half a cycle of 3, one and a half of 4, half of 6, one of 8, half of 9."""
    found: Counter[float] = Counter()
    for spread, _, count in counted([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0]):
        found[spread] += count
    assert found == {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}


@given(st.lists(st.integers(-9, 9).map(float), min_size=2, max_size=60))
def test_counted_ranges_add_up_to_the_way_of_the_history(history: list[float]) -> None:
    """A full cycle goes its range twice, half a cycle once; and the largest range is always counted."""
    found = counted(history)
    way = float(np.abs(np.diff(history)).sum())
    assert sum(2.0 * count * spread for spread, _, count in found) == way
    if way > 0.0:
        assert max(spread for spread, _, _ in found) == max(history) - min(history)


def test_a_cycle_on_the_line_takes_its_share() -> None:
    assert cycle_damage(LINE, 4e8, 0.0) == pytest.approx(1.0 / 2e6, rel=1e-14)
    assert cycle_damage(LINE, 2e8, 0.0) == pytest.approx(0.5**5 / 2e6, rel=1e-14)
    assert cycle_damage(LINE._replace(notch_factor=2.0), 2e8, 0.0) == pytest.approx(1.0 / 2e6, rel=1e-14)


def test_mean_tension_takes_life_and_mean_compression_gives_none() -> None:
    """Goodman: amplitude and mean on the line from S_0 to S_u take what S_0 alone takes."""
    assert cycle_damage(LINE, 2e8, 4.5e8) == pytest.approx(1.0 / 2e6, rel=1e-12)
    assert cycle_damage(LINE, 2e8, -4.5e8) == cycle_damage(LINE, 2e8, 0.0)
    assert cycle_damage(LINE, 1.0, 9e8) == np.inf


def test_the_worst_cell_is_told() -> None:
    """A pulse of compression is one cycle from 0; the cell of least area has the largest stress."""
    forces, area = np.array([[1e5, 1e5], [0.0, 2e4]]), np.array([1e-3, 5e-4])
    damage, cell = blow_damage(LINE, forces, area, np.empty((2, 4)), np.empty((4, 3)))
    assert cell == 1
    assert damage == pytest.approx(cycle_damage(LINE, 2e8, -1e8), rel=1e-12)
