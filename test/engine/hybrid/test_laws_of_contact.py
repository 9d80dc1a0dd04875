# SPDX-License-Identifier: Apache-2.0
"""The one loop against closed forms and published cases: bounces, stick-slip, simultaneous impacts, stops, friction.

F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts, Wiley 1996; V. Acary, B. Brogliato, Numerical
Methods for Nonsmooth Dynamical Systems, Springer 2008 (bouncing ball, chain of balls, block on a belt).
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from engine.hybrid.linear_system import AFTER, BEFORE, IMPULSE, KIND, LAW, TIME, TwoByTwo, accelerations_of, linear, run
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from work_arrays import room_for

from mech_twin.engine.hybrid.laws import HIGH, HOLD, LOW, OPEN

G = 9.81
STRUCK, CHANGED, PASSED = 0, 1, 2


def of_kind(rows, kind):
    """Return the rows of a kind."""
    return rows[rows[:, KIND] == kind]


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 7, 40])
def test_a_bouncing_ball_strikes_at_the_times_of_the_closed_form_and_rests_at_their_limit(steps):
    e, height, mass = 0.5, 1.0, 2.0
    ball = linear([mass], [[1.0]], load=[-mass * G], e=[e])
    y, regimes, rows = run(ball, [height], [0.0], [OPEN], 2.0, steps)
    blows, first = of_kind(rows, STRUCK), math.sqrt(2.0 * height / G)
    speed = math.sqrt(2.0 * G * height)
    times = [first + 2.0 * speed / G * sum(e**k for k in range(1, i + 1)) for i in range(len(blows))]
    assert len(blows) > 25
    np.testing.assert_allclose(blows[:, TIME], times, rtol=0, atol=1e-12)
    np.testing.assert_allclose(blows[:10, IMPULSE], [mass * (1.0 + e) * speed * e**i for i in range(10)], rtol=1e-9)
    assert blows[-1, TIME] == pytest.approx(first * (1.0 + 2.0 * e / (1.0 - e)), abs=1e-9)
    assert regimes[0] == HOLD
    assert abs(y[0]) < 1e-15 and y[1] == 0.0


def test_a_ball_that_is_let_go_upward_comes_back_to_the_stop_it_left():
    ball = linear([1.0], [[1.0]], load=[-G], e=[1.0])
    _, _, rows = run(ball, [0.0], [3.0], [OPEN], 2.0 * 3.0 / G * 2.5)
    np.testing.assert_allclose(of_kind(rows, STRUCK)[:, TIME], [6.0 / G, 12.0 / G], atol=1e-12)


def test_a_bound_that_grows_with_time_releases_a_block_at_the_instant_it_is_reached():
    block = linear([3.0], [[1.0]], load_rate=[4.0], low=[-6.0], high=[6.0])
    y, regimes, rows = run(block, [0.0], [0.0], [HOLD], 2.0)
    (change,) = of_kind(rows, CHANGED)
    assert change[TIME] == pytest.approx(1.5, abs=1e-12)
    assert regimes[0] == LOW
    assert y[1] == pytest.approx(4.0 * 0.5**2 / 2.0 / 3.0, rel=1e-10)  # u = 4 (t - 1.5)^2/(2 m)
    assert y[2] == pytest.approx(-6.0 * y[0], rel=1e-10)  # friction takes its force times the way


def test_a_sliding_block_stops_when_its_momentum_is_used_up_and_stays():
    block = linear([2.0], [[1.0]], low=[-5.0], high=[5.0])
    y, regimes, rows = run(block, [0.0], [-4.0], [HIGH], 3.0, 11)
    (change,) = of_kind(rows, CHANGED)
    assert change[TIME] == pytest.approx(2.0 * 4.0 / 5.0, abs=1e-12)
    assert regimes[0] == HOLD and y[1] == 0.0
    assert y[0] == pytest.approx(-0.5 * 4.0 * 1.6, abs=1e-11)
    assert y[2] == pytest.approx(-0.5 * 2.0 * 4.0**2, rel=1e-10)


def test_a_block_on_a_belt_sticks_and_slips_with_the_period_of_the_closed_form():
    """Spring k to the wall, belt of speed v, sticking force s, sliding force c < s held by the belt's own drift."""
    mass, k, v, c, s = 1.0, 100.0, 0.5, 3.0, 3.0
    belt = linear([mass], [[1.0]], stiffness=[k], drift=[-v], low=[-c], high=[s])
    y, _, rows = run(belt, [-0.02], [v], [HOLD], 2.0, 50)
    first = of_kind(rows, CHANGED)[0]
    assert first[TIME] == pytest.approx((s / k + 0.02) / v, abs=1e-11)  # it is carried until the spring holds s
    assert first[BEFORE] == HOLD
    # with equal bounds it then swings about c/k with the belt's speed, and never overtakes it: no further stick
    w = math.sqrt(k / mass)
    t = 2.0 - first[TIME]
    assert y[0] == pytest.approx(c / k + v / w * math.sin(w * t), abs=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.3])
def test_friction_holds_a_block_that_an_impact_has_stopped(e):
    """Pressed to a wall by 5 N that fall to 0, a block stays there: friction of 1 N pushes it neither on nor off."""
    laws = {"low": [0.0, -1.0], "high": [math.inf, 1.0], "e": [e, -1.0]}
    block = linear([2.0], [[1.0], [1.0]], load=[-5.0], load_rate=[1.0], **laws)
    y, regimes, rows = run(block, [1.0], [0.0], [OPEN, HIGH], 5.5, 550)
    assert abs(y[0]) < 1e-12
    assert y[1] == 0.0
    assert regimes[1] == HOLD
    assert len(rows) < 200


def test_a_gap_that_friction_keeps_closed_without_force_is_no_event():
    """Pulled off a wall by less than its friction, a block rests on the wall without pressing it."""
    laws = {"low": [0.0, -3.0], "high": [math.inf, 3.0], "e": [0.0, -1.0]}
    block = linear([2.0], [[1.0], [1.0]], load=[-2.0], load_rate=[2.0], **laws)
    y, regimes, rows = run(block, [0.0], [0.0], [HOLD, HOLD], 2.0, 20)
    assert y[0] == 0.0
    assert y[1] == 0.0
    assert regimes[1] == HOLD
    assert len(rows) < 10


@pytest.mark.parametrize("gap", [0.0, -2e-16, 2e-16])
def test_friction_that_lets_go_at_a_wall_lets_the_gap_open(gap):
    """The pull grows past the friction while the block lies on the wall: it leaves at 2.5 s, whatever rounding says."""
    laws = {"low": [0.0, -3.0], "high": [math.inf, 3.0], "e": [0.3, -1.0], "gap": [gap, 0.0]}
    block = linear([2.0], [[1.0], [1.0]], load=[-2.0], load_rate=[2.0], **laws)
    y, regimes, rows = run(block, [0.0], [0.0], [HOLD, HOLD], 3.5, 35)
    assert y[0] == pytest.approx(2.0 / 2.0 * 1.0**3 / 6.0, abs=1e-9)  # x'' = 2 (t - 2.5)/2
    assert list(regimes) == [OPEN, LOW]
    assert len(rows) < 20


def test_equal_balls_in_a_row_pass_the_momentum_on_as_moreau_has_it():
    """A ball strikes a chain of two that touch: with Newton's law for both gaps at once (Acary, Brogliato, 3.4)."""
    m, e = 1.0, 0.0
    balls = linear([m, m, m], [[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]], gap=[-0.0, 0.0], e=[e, e])
    y, _, rows = run(balls, [-0.5, 0.0, 0.0], [1.0, 0.0, 0.0], [OPEN, HOLD], 1.0)
    np.testing.assert_allclose(y[3:6], [1.0 / 3.0] * 3, atol=1e-12)
    assert {row[LAW] for row in of_kind(rows, STRUCK)} == {0.0, 1.0}
    assert of_kind(rows, STRUCK)[0, TIME] == pytest.approx(0.5, abs=1e-12)


def turns_of_two_balls(e, gap, load, most=400):
    """Return the instants of impacts of two balls and a wall by turns, and the speeds after them.

    Of mass 1 kg each: ball 1 rests ``gap`` from the wall, ball 2 comes from twice that with 1 m/s, pushed by a load.
    """
    x1, x2, u1, u2, t, times = gap, 2.0 * gap, 0.0, -1.0, 0.0, []
    while len(times) < most:
        opening = u2 - u1
        root = math.sqrt(opening * opening - 2.0 * load * x2)
        wall, both = x1 / -u1 if u1 < 0.0 else math.inf, math.inf
        if opening < 0.0:
            both = 2.0 * x2 / (root - opening)
        elif load < 0.0:
            both = -(opening + root) / load
        span = min(wall, both)
        if span == math.inf:
            break
        x1, x2, u2, t = x1 + u1 * span, x2 + (opening + 0.5 * load * span) * span, u2 + load * span, t + span
        if wall < both:
            x1, u1 = 0.0, -e * u1
        else:
            x2, u1, u2 = 0.0, 0.5 * (u1 + u2 + e * (u2 - u1)), 0.5 * (u1 + u2 - e * (u2 - u1))
        times.append(t)
    return np.array(times), (u1, u2)


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize(("load", "e"), [(0.0, 0.05), (0.0, 0.15), (-3.0, 0.1), (-1.0, 0.05)])
def test_two_balls_that_strike_each_other_and_a_wall_by_turns_rest_at_the_limit_of_their_series(load, e, steps):
    """Below e = 3 - 2 sqrt 2 even balls that nothing presses strike infinitely often in a time that is over."""
    gap, (times, _) = 0.01, turns_of_two_balls(e, 0.01, load)
    balls = linear([1.0, 1.0], [[1.0, 0.0], [-1.0, 1.0]], load=[0.0, load], e=[e, e])
    y, regimes, rows = run(balls, [gap, 3.0 * gap], [0.0, -1.0], [OPEN, OPEN], 1.2, steps)
    blows = of_kind(rows, STRUCK)
    blows = blows[np.concatenate([[True], np.diff(blows[:, TIME]) > 1e-9])]
    told = times < times[-1] - 1e-6
    np.testing.assert_allclose(blows[: told.sum(), TIME], times[told], rtol=0, atol=1e-11)
    assert blows[-1, TIME] == pytest.approx(times[-1], abs=1e-8)
    assert list(regimes) == [HOLD, HOLD]
    np.testing.assert_allclose(y[:4], 0.0, atol=1e-10)


@pytest.mark.parametrize("e", [0.2, 0.6, 1.0])
def test_impacts_by_turns_that_end_apart_are_told_however_close_in_time(e):
    gap = 3e-10
    times, speeds = turns_of_two_balls(e, gap, 0.0)
    balls = linear([1.0, 1.0], [[1.0, 0.0], [-1.0, 1.0]], e=[e, e])
    y, regimes, rows = run(balls, [gap, 3.0 * gap], [0.0, -1.0], [OPEN, OPEN], 1.0)
    assert len(of_kind(rows, STRUCK)) == len(times) < 20
    np.testing.assert_allclose(y[2:4], speeds, rtol=1e-9)
    assert list(regimes) == [OPEN, OPEN]


def test_two_stops_on_one_body_share_the_force_and_hold_it():
    body = linear([1.0], [[1.0], [1.0]], load=[-7.0], e=[0.2, 0.2])
    y, regimes, _ = run(body, [0.3], [0.0], [OPEN, OPEN], 1.5)
    assert list(regimes).count(HOLD) >= 1
    assert abs(y[0]) < 1e-14 and y[1] == 0.0


def test_a_wall_that_gives_way_at_a_force_takes_the_work_of_that_force():
    """A tool of 1 kg pushed by a striker of 4 kg against a wall of 30 N that never comes back."""
    striker, tool, wall, v = 4.0, 1.0, 30.0, 2.0
    both = linear(
        [striker, tool],
        [[-1.0, 1.0], [0.0, 1.0]],
        e=[0.0, -1.0],
        low=[0.0, -wall],
        high=[math.inf, 0.0],
    )
    y, regimes, rows = run(both, [-0.2, 0.0], [v, 0.0], [OPEN, HOLD], 1.0)
    after = striker * v / (striker + tool)
    assert of_kind(rows, STRUCK)[0, AFTER] == pytest.approx(after, rel=1e-12)
    assert y[1] == pytest.approx((striker + tool) * after**2 / (2.0 * wall), rel=1e-10)
    assert regimes[1] == HOLD


@pytest.mark.parametrize("seed", range(4))
def test_an_impact_oscillator_agrees_with_an_integration_by_another_hand(seed):
    """Driven by a ramp, damped, against a stop: each flight by scipy, its impact by bracketing the solution."""
    rng = np.random.default_rng(seed)
    m, k, c, e, a = rng.uniform(0.5, 2), rng.uniform(20, 80), rng.uniform(0.1, 1), rng.uniform(0.3, 0.9), -5.0
    system = linear([m], [[1.0]], stiffness=[k], damping=[c], load=[a], e=[e])
    _, _, rows = run(system, [0.4], [0.0], [OPEN], 1.0, 9)
    t, state, blows = 0.0, np.array([0.4, 0.0]), []
    while t < 1.0 and len(blows) < 6:
        flight = solve_ivp(
            lambda _, x: [x[1], (a - k * x[0] - c * x[1]) / m], (t, 1.0), state, rtol=1e-12, atol=1e-13,
            dense_output=True, method="DOP853",
        )  # fmt: skip
        grid = np.linspace(t + 1e-6, 1.0, 4000)
        below = grid[flight.sol(grid)[0] < 0.0]
        if not len(below):
            break
        t = brentq(lambda x, f=flight: f.sol(x)[0], max(t + 1e-6, below[0] - 1e-3), below[0], xtol=1e-14)
        blows.append(t)
        state = np.array([0.0, -e * flight.sol(t)[1]])
    assert len(blows) >= 2
    np.testing.assert_allclose(of_kind(rows, STRUCK)[: len(blows), TIME], blows, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_sizes_known_to_the_compiler_change_no_bit_of_the_motion(seed):
    """A block on a block on a belt: both masses strike, slide and stick."""
    rng = np.random.default_rng(seed)
    coupled = [[rng.uniform(1.0, 2.0), 0.3], [0.3, rng.uniform(0.5, 1.0)]]
    system = linear(
        coupled, [[1.0, 0.0], [-1.0, 1.0]], stiffness=[[60.0, -20.0], [-20.0, 40.0]], load=rng.uniform(-8.0, -4.0, 2),
        drift=[0.0, 0.2], low=[0.0, -2.0], high=[math.inf, 2.0], e=[0.6, -1.0],
    )  # fmt: skip
    ways = [run(kind, [0.3, 0.1], [0.0, 0.4], [OPEN, LOW], 1.5, 7) for kind in (system, TwoByTwo(*system))]
    assert len(of_kind(ways[0][2], STRUCK)) > 1 and len(of_kind(ways[0][2], CHANGED)) > 1
    for one, other in zip(*ways, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.parametrize("seed", range(20))
def test_forces_of_holding_laws_are_those_of_one_system_of_equations(seed, alone):
    """Laws of one freedom each, or of several; others slide: M a - W' lam = h and W a = 0 where a law holds."""
    rng, n, m = np.random.default_rng(seed), 4, 5
    root = rng.normal(size=(n, n))
    directions = rng.normal(size=(m, n))
    holding = rng.permutation(m)[: rng.integers(0, n)]
    for i, k in zip(holding, rng.permutation(n), strict=False):
        directions[i] *= np.arange(n) == k if alone else 1.0
    low, high = rng.uniform(-3.0, -1.0, m), rng.uniform(1.0, 3.0, m)
    system = linear(root @ root.T + np.eye(n), directions, load=rng.normal(size=n), low=low, high=high)
    regimes = np.array([*rng.choice([LOW, HIGH], m), 0])
    regimes[holding] = HOLD
    room, y = room_for(n, m, 1, 2 * n + 1), np.concatenate([rng.normal(size=2 * n), [0.0]])
    accelerations_of(system, 0.0, y, regimes, room)
    held = directions[holding]
    slides = np.where(regimes[:m] == LOW, low, np.where(regimes[:m] == HIGH, high, 0.0))
    whole = np.block([[system.mass, -held.T], [held, np.zeros((len(holding), len(holding)))]])
    found = np.linalg.solve(whole, np.concatenate([system.load + directions.T @ slides, np.zeros(len(holding))]))
    np.testing.assert_allclose(room.at.acceleration, found[:n], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(room.at.multiplier[holding], found[n:], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(room.at.law_acceleration, directions @ found[:n], rtol=1e-9, atol=1e-9)


def test_a_dip_through_a_stop_within_one_long_step_is_seen():
    """A parabola that goes 1e-6 m below the stop and back within a step whose both ends are above it."""
    u = -math.sqrt(2.0 * 2.0 * (1.0 + 1e-6))
    ball = linear([1.0], [[1.0]], load=[2.0], e=[0.5])
    _, _, rows = run(ball, [1.0], [u], [OPEN], -2.0 * u / 2.0)
    assert of_kind(rows, STRUCK)[0, TIME] == pytest.approx((-u - math.sqrt(u * u - 4.0)) / 2.0, abs=1e-10)


def test_a_pass_above_a_stop_within_one_long_step_is_no_impact():
    u = -math.sqrt(2.0 * 2.0 * (1.0 - 1e-6))
    ball = linear([1.0], [[1.0]], load=[2.0], e=[0.5])
    _, _, rows = run(ball, [1.0], [u], [OPEN], -2.0 * u / 2.0)
    assert not len(of_kind(rows, STRUCK))


def test_of_two_events_in_a_step_the_earlier_comes_first():
    ball = linear([1.0], [[-1.0]], gap=[0.7], e=[1.0], mark=0.5)
    _, _, rows = run(ball, [0.0], [1.0], [OPEN], 1.0)
    assert list(rows[:, KIND]) == [PASSED, STRUCK]
    np.testing.assert_allclose(rows[:, TIME], [0.5, 0.7], atol=1e-12)


def test_energy_held_is_what_the_laws_have_left_of_it():
    """Two masses, a spring between them, friction of one and a stop of the other: T + V less work of the laws."""
    k = np.array([[40.0, -40.0], [-40.0, 40.0]])
    system = linear(
        [1.0, 2.0], [[1.0, 0.0], [0.0, 1.0]], stiffness=k, load=[0.0, -6.0], low=[-0.8, 0.0], high=[0.8, math.inf],
        e=[-1.0, 0.6],
    )  # fmt: skip

    def energy(y):
        q, u = y[:2], y[2:4]
        return 0.5 * q @ k @ q + 6.0 * q[1] + 0.5 * (u[0] ** 2 + 2.0 * u[1] ** 2)

    q, u = [0.1, 0.2], [0.5, -1.0]
    y, _, rows = run(system, q, u, [LOW, OPEN], 1.0, 20)
    lost = 0.0
    for blow in of_kind(rows, STRUCK):
        v = blow[IMPULSE] / (2.0 * 1.6)  # P = m (1 + e) v
        lost += 0.5 * 2.0 * v * v * (1.0 - 0.36)
    assert len(of_kind(rows, STRUCK)) >= 2
    assert energy(y) - energy(np.array([*q, *u])) == pytest.approx(y[4] - lost, abs=1e-9)
