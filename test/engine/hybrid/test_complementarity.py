# SPDX-License-Identifier: Apache-2.0
"""The law's problem against a second solution by enumeration, and what is said where laws depend on each other."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from work_arrays import room_for

from mech_twin.engine.hybrid.complementarity import CONTRADICTION, SOLVED, solve_laws
from mech_twin.engine.hybrid.laws import HIGH, HOLD, LOW


def solve(matrix, free, low, high, status):
    """Return the answer, forces, accelerations and status of a problem."""
    at = room_for(1, len(free), 0, 3).at
    at.matrix[:], at.free[:], at.least[:], at.most[:], at.status[:] = matrix, free, low, high, status
    force = np.zeros(len(free))
    answer = solve_laws(at, force)
    return answer, force, np.asarray(matrix) @ force + free, at.status.copy()


def enumerated(matrix, free, low, high):
    """Return the forces of the combination of low, high and holding laws that meets every condition."""
    m = len(free)
    for modes in itertools.product((LOW, HIGH, HOLD), repeat=m):
        bounds = [(low, high)[mode == HIGH][i] for i, mode in enumerate(modes)]
        if any(mode != HOLD and not math.isfinite(b) for mode, b in zip(modes, bounds, strict=True)):
            continue
        force = np.array([0.0 if mode == HOLD else b for mode, b in zip(modes, bounds, strict=True)])
        hold = [i for i, mode in enumerate(modes) if mode == HOLD]
        if hold:
            force[hold] = np.linalg.solve(matrix[np.ix_(hold, hold)], -(free + matrix @ force)[hold])
        a = matrix @ force + free
        near = 1e-9 * (1.0 + np.abs(a).max())
        fits = all(
            (mode == LOW and a[i] >= -near)
            or (mode == HIGH and a[i] <= near)
            or (mode == HOLD and low[i] - 1e-9 <= force[i] <= high[i] + 1e-9)
            for i, mode in enumerate(modes)
        )
        if fits:
            return force
    return None


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_forces_are_those_of_the_one_combination_that_meets_every_condition(seed, m):
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(m, m + 2))
    matrix, free = w @ w.T, rng.normal(size=m) * 10.0 ** rng.uniform(-2, 3)
    low = -(10.0 ** rng.uniform(-1, 2, m)) * (rng.random(m) < 0.7)
    high = np.where(rng.random(m) < 0.5, math.inf, 10.0 ** rng.uniform(-1, 2, m))
    status = rng.choice([HOLD, LOW], m)
    answer, force, a, _ = solve(matrix, free, low, high, status)
    expected = enumerated(matrix, free, low, high)
    assert answer == SOLVED
    np.testing.assert_allclose(force, expected, rtol=1e-7, atol=1e-7 * (1.0 + np.abs(expected).max()))
    assert np.all((force > low) | (a >= -1e-7 * (1.0 + np.abs(a).max())))


@pytest.mark.slow
def test_of_two_stops_on_one_body_the_first_declared_carries_the_load():
    matrix, free = np.ones((2, 2)), np.array([-7.0, -7.0])
    answer, force, a, _ = solve(matrix, free, np.zeros(2), np.full(2, math.inf), [HOLD, HOLD])
    assert answer == SOLVED
    np.testing.assert_allclose(force, [7.0, 0.0])
    np.testing.assert_allclose(a, 0.0, atol=1e-12)


def test_a_stop_that_moves_toward_a_body_carries_it_away_from_one_that_does_not():
    """Two stops under one body, the second accelerating upward: it presses, the first lets go."""
    answer, force, a, status = solve(
        np.ones((2, 2)), np.array([-7.0, -9.0]), np.zeros(2), np.full(2, math.inf), [HOLD, HOLD]
    )
    assert answer == SOLVED
    np.testing.assert_allclose(force, [0.0, 9.0])
    assert a[0] == pytest.approx(2.0)
    assert list(status) == [LOW, HOLD]


def test_two_drives_that_prescribe_different_motions_of_one_joint_contradict_each_other():
    everything = np.full(2, math.inf)
    answer, *_ = solve(np.ones((2, 2)), np.array([-7.0, -9.0]), -everything, everything, [HOLD, HOLD])
    assert answer == CONTRADICTION


@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.integers(1, 3))
def test_bounded_forces_along_dependent_directions_have_a_solution(seed, m, rank):
    """Friction under the feet of one body: the feet share their direction, and turn so that they cannot all stick."""
    rng = np.random.default_rng(seed)
    w = rng.integers(-1, 2, size=(m, rank)) + np.eye(m, rank)
    matrix, high = w @ w.T + 0.0, 10.0 ** rng.uniform(0, 3, m)
    free = w @ rng.normal(size=rank) * 10.0 ** rng.uniform(0, 4) + rng.normal(size=m) * 10.0 ** rng.uniform(-6, 2)
    answer, force, a, _ = solve(matrix, free, -high, high, rng.choice([HOLD, LOW, HIGH], m))
    near = 1e-7 * (1.0 + np.abs(free).max())
    assert answer == SOLVED
    assert np.all(np.abs(force) <= high * (1.0 + 1e-9))
    assert np.all((a <= near) | (force <= -high * (1.0 - 1e-9)))
    assert np.all((a >= -near) | (force >= high * (1.0 - 1e-9)))


@given(st.floats(40.0, 60.0), st.floats(1e-17, 1e-14))
def test_bounds_below_the_rounding_of_other_forces_do_not_keep_pivoting_from_its_end(fall, friction):
    """A tool between a wall and a striker whose crank a weight takes away: friction of the crank is next to nothing."""
    tool, arm, crank = 0.1, 0.0823, 3.322
    matrix = np.array([[tool, tool, 0.0], [tool, tool + arm**2 / crank, arm], [0.0, arm, crank]])
    free = np.array([0.0, fall * arm / crank, fall])
    low, high = np.array([-1e6, -friction, -friction]), np.array([friction, math.inf, friction])
    answer, force, a, status = solve(matrix, free, low, high, [HOLD, HOLD, HOLD])
    assert answer == SOLVED
    assert list(status[1:]) == [LOW, LOW]
    np.testing.assert_allclose(a, free, atol=1e-9)
    assert abs(force[0]) <= 2.0 * friction
