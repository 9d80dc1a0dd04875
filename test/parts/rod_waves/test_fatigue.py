# SPDX-License-Identifier: Apache-2.0
"""Cycles by rainflow as the standard counts them, and the damage of an S-N line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.parts.rod_waves.fatigue import StressLine, blow_damage, cycle_damage

LINE = StressLine(2e8, 2e6, 5.0, 9e8, 1.0)


FLAT = StressLine(1.0, 1.0, 1.0, 1e300, 1.0)  # the damage is the sum of amplitudes, whatever their means


def damage_of(history: list[float], line: StressLine) -> float:
    """Return the damage in a rod of unit area whose stress begins and ends at 0."""
    return blow_damage(line, -np.array([history]).T, np.ones(1))[0]


@pytest.mark.parametrize("slope", [1.0, 3.0, 5.0])
def test_the_history_of_the_standard_is_counted_as_printed(slope: float) -> None:
    """ASTM E1049-85, figure 6, begun at 0: half of 3, one and a half of 4, half of 6, one of 8, half of 9."""
    history = [3.0, -1.0, 7.0, 1.0, 5.0, -2.0, 6.0]  # after its first point, -2, and before its last
    printed = {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}
    expected = sum(count * (0.5 * spread) ** slope for spread, count in printed.items())
    assert damage_of(history, FLAT._replace(slope=slope)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.slow
@given(st.lists(st.integers(-9, 9).map(float), min_size=2, max_size=60))
def test_counted_ranges_add_up_to_the_way_of_the_history(history: list[float]) -> None:
    """A full cycle goes its range twice, half a cycle once: amplitudes add up to a quarter of the way."""
    way = float(np.abs(np.diff([0.0, *history, 0.0])).sum())
    assert damage_of(history, FLAT) == pytest.approx(0.25 * way, rel=1e-12)


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
    damage, cell = blow_damage(LINE, forces, area)
    assert cell == 1
    assert damage == pytest.approx(cycle_damage(LINE, 2e8, -1e8), rel=1e-12)
