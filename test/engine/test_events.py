# SPDX-License-Identifier: Apache-2.0
"""Events within a step: roots at the start, dips through zero and back, two at once, direction, the first in time.

The motions have closed solutions (a ball thrown up, an oscillation), written out here.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mech_twin.engine.events import FALLING, NONE, RISING, UNKNOWN, Step, first_event, signals_of
from mech_twin.engine.integration import rates_of, start_step, take_step, workspace
from mech_twin.engine.tableaus import COOPER_VERNER_8

GRAVITY = 9.81
HEIGHT, SPEED, BARE_HEIGHT, SINE, COUNTDOWN = range(5)


class Ball(NamedTuple):
    """A ball in the air, and the phase of an oscillation that runs beside it."""

    floor_m: float
    frequency_rad_per_s: float


@rates_of(Ball, COOPER_VERNER_8)
def ball_rates(system, t, y, out):
    out[0], out[1], out[2] = y[1], -GRAVITY, system.frequency_rad_per_s


@signals_of(Ball)
def ball_signals(system, index, t, y):
    if index == HEIGHT:
        return y[0] - system.floor_m, y[1]
    if index == SPEED:
        return y[1], -GRAVITY
    if index == BARE_HEIGHT:
        return y[0] - system.floor_m, UNKNOWN
    if index == COUNTDOWN:
        return system.floor_m - t, -1.0
    return math.sin(y[2]), system.frequency_rad_per_s * math.cos(y[2])


class Swing(NamedTuple):
    """An oscillator of 1 rad/s, watched for coming lower than a bound without a derivative."""

    bound: float


@rates_of(Swing, COOPER_VERNER_8)
def swing_rates(system, t, y, out):
    out[0], out[1] = y[1], -y[0]


@signals_of(Swing)
def swing_signals(system, index, t, y):
    return y[0] - system.bound, UNKNOWN


def first(ball, state, span, *watches, start=0.0):
    """Return what is seen first and when, and the state there."""
    work, y = workspace(COOPER_VERNER_8, len(state)), np.array(state, dtype=float)
    start_step(ball, start, y, work)
    take_step(ball, start, y, span, work)
    table = np.array([tuple(int(v) for v in w) for w in watches], dtype=np.int64)
    which, when = first_event(Step(ball, start, y, span, work), table, len(table), work.end.copy())
    take_step(ball, start, y, when, work)
    return which, when, work.end.copy()


@given(height=st.floats(1e-9, 5.0), speed=st.floats(-20.0, 20.0))
@settings(max_examples=200, deadline=None)
def test_landing_is_where_the_throw_s_parabola_is_zero(height, speed):
    root = math.sqrt(speed * speed + 2.0 * GRAVITY * height)
    landing = (speed + root) / GRAVITY if speed > 0.0 else 2.0 * height / (root - speed)
    which, when, end = first(Ball(0.0, 1.0), (height, speed, 0.0), 1.5 * landing, (HEIGHT, FALLING, False))
    assert which == 0
    scale = max(abs(end[1]), 1e-9)
    assert abs(when - landing) <= 1e-14 * landing + 4e-15 * (abs(speed) * landing + height) / scale


def test_root_at_the_start_is_not_found_again_and_the_next_one_is():
    which, when, _ = first(Ball(0.0, 1.0), (0.0, 5.0, 0.0), 2.0, (HEIGHT, FALLING, True))
    assert which == 0
    assert when == pytest.approx(2.0 * 5.0 / GRAVITY, rel=1e-14)


def test_start_that_misses_its_root_by_rounding_gives_the_next_root_too():
    for miss in (-3e-17, 3e-17):
        which, when, _ = first(Ball(0.0, 1.0), (miss, 5.0, 0.0), 2.0, (HEIGHT, FALLING, True))
        assert (which, when) == (0, pytest.approx(2.0 * 5.0 / GRAVITY, rel=1e-14))


def test_start_at_the_root_and_falling_is_an_event_at_once():
    assert first(Ball(0.0, 1.0), (0.0, -1.0, 0.0), 1.0, (HEIGHT, FALLING, True))[:2] == (0, 0.0)
    assert first(Ball(0.0, 1.0), (0.0, -1.0, 0.0), 1.0, (HEIGHT, FALLING, False))[:2] == (0, 0.0)


def test_start_at_the_root_without_speed_falls_off_it_later():
    """Thrown up with no speed at an upward acceleration it stays above; the sine leaves its root and comes back."""
    which, when, _ = first(Ball(0.0, 3.0), (9.0, 0.0, 0.0), 1.2, (SINE, FALLING, True))
    assert (which, when) == (0, pytest.approx(math.pi / 3.0, rel=1e-14))


@pytest.mark.parametrize("signal", [HEIGHT, BARE_HEIGHT], ids=["by its derivative", "by the parabola"])
def test_dip_through_zero_and_back_is_found(signal):
    """Ceiling just under the top of the throw: out and back within 4 ms of a step of 1 s."""
    top = 5.0 * 5.0 / (2.0 * GRAVITY)
    depth = 0.5 * GRAVITY * 0.002**2
    which, when, _ = first(Ball(top - depth, 1.0), (0.0, 5.0, 0.0), 1.0, (signal, RISING, False))
    assert which == 0
    assert when == pytest.approx(5.0 / GRAVITY - 0.002, abs=1e-11)


@pytest.mark.parametrize("signal", [HEIGHT, BARE_HEIGHT])
def test_dip_that_misses_zero_is_no_event(signal):
    top = 5.0 * 5.0 / (2.0 * GRAVITY)
    assert first(Ball(top + 1e-12, 1.0), (0.0, 5.0, 0.0), 1.0, (signal, RISING, False))[0] == NONE


def test_touch_without_crossing_is_where_the_motion_turns():
    which, when, end = first(Ball(0.0, 1.0), (0.0, 5.0, 0.0), 1.0, (SPEED, FALLING, False))
    assert (which, when) == (0, pytest.approx(5.0 / GRAVITY, rel=1e-14))
    assert abs(end[1]) <= 1e-14


def test_only_the_asked_direction_counts():
    state = (1.0, 0.0, -1.0)  # the sine rises through zero at 0.1 s, falls at 0.1 (1 + pi)
    ball = Ball(0.0, 10.0)
    assert first(ball, state, 0.5, (SINE, RISING, False))[1] == pytest.approx(0.1, rel=1e-14)
    assert first(ball, state, 0.2, (SINE, FALLING, False))[0] == NONE


@given(floor=st.floats(-2.0, 0.5), frequency=st.floats(0.5, 6.0))
@settings(max_examples=100, deadline=None)
def test_of_two_events_the_first_in_time_ends_the_step(floor, frequency):
    state, span = (1.0, 0.0, 0.1), 0.5
    landing, crossing = math.sqrt(2.0 * (1.0 - floor) / GRAVITY), (math.pi - 0.1) / frequency
    both = first(Ball(floor, frequency), state, span, (HEIGHT, FALLING, False), (SINE, FALLING, False))
    times = [when if when <= span else math.inf for when in (landing, crossing)]
    if min(times) == math.inf:
        assert both[:2] == (NONE, span)
    else:
        assert both[0] == times.index(min(times))
        assert both[1] == pytest.approx(min(times), rel=1e-13)


def test_of_equal_times_the_one_watched_first_is_told():
    ball = Ball(0.0, 1.0)
    for order in ((HEIGHT, BARE_HEIGHT), (BARE_HEIGHT, HEIGHT)):
        which, when, _ = first(ball, (1.0, 0.0, 0.0), 0.6, *((signal, FALLING, False) for signal in order))
        assert which == 0
        assert when == pytest.approx(math.sqrt(2.0 / GRAVITY), rel=1e-14)


def test_state_at_the_root_has_the_event_behind_it():
    _, _, end = first(Ball(0.0, 1.0), (1.0, 2.0, 0.0), 1.0, (HEIGHT, FALLING, False))
    assert -1e-14 <= end[0] <= 0.0


def test_apex_above_a_height_is_found_without_a_derivative_wherever_in_the_step_it_is():
    """Below at both ends, above between: the parabola through three points is the ball's own."""
    speed, level = 5.0, 1.27
    rise = (speed - math.sqrt(speed * speed - 2.0 * GRAVITY * level)) / GRAVITY
    for span in (0.6, 0.7, 0.9):
        which, when, _ = first(Ball(level, 1.0), (0.0, speed, 0.0), span, (BARE_HEIGHT, RISING, False))
        assert which == 0
        assert when == pytest.approx(rise, rel=1e-12)


@given(
    depth=st.floats(1e-4, 0.015),  # much less lies beside the lowest point of the parabola
    span=st.floats(0.5, 0.6),
    share=st.floats(0.4, 0.6),
)
@settings(max_examples=200, deadline=None)
def test_swing_that_dips_under_a_bound_is_found_without_a_derivative(depth, span, share):
    ahead = share * span  # until the lowest point, -1
    state, below = (-math.cos(ahead), -math.sin(ahead)), math.acos(1.0 - depth)
    which, when, _ = first(Swing(depth - 1.0), state, span, (0, FALLING, False))
    assert which == 0
    missed = 1e-9  # by a step of half a radian, at most
    assert when == pytest.approx(ahead - below, abs=missed / math.sin(below))
    above = first(Swing(-depth - 1.0), state, span, (0, FALLING, False))
    assert above[0] == NONE


def test_at_rest_on_the_root_only_the_side_it_leaves_to_is_an_event():
    assert first(Ball(0.0, 1.0), (0.0, 0.0, 0.0), 1.0, (HEIGHT, FALLING, False))[:2] == (0, 0.0)
    assert first(Ball(0.0, 1.0), (0.0, 0.0, 0.0), 1.0, (HEIGHT, RISING, False))[0] == NONE


def test_signal_of_time_is_asked_at_the_time_of_the_run():
    assert first(Ball(3.4, 1.0), (0.0, 0.0, 0.0), 1.0, (COUNTDOWN, FALLING, False), start=3.0)[:2] == (
        0,
        pytest.approx(0.4),
    )
    assert first(Ball(4.1, 1.0), (0.0, 0.0, 0.0), 1.0, (COUNTDOWN, FALLING, False), start=3.0)[0] == NONE


def test_landing_after_the_step_is_no_event_of_it_with_or_without_a_derivative():
    for seen in (HEIGHT, BARE_HEIGHT):
        assert first(Ball(0.0, 1.0), (3.0, 0.0, 0.0), 0.5, (seen, FALLING, False))[0] == NONE


def test_next_root_after_a_start_off_the_root_is_the_return_to_where_it_started():
    for miss in (-1e-4, 1e-4):
        which, when, _ = first(Ball(0.0, 1.0), (miss, 5.0, 0.0), 2.0, (HEIGHT, FALLING, True))
        assert (which, when) == (0, pytest.approx(2.0 * 5.0 / GRAVITY, rel=1e-13))


def test_root_at_the_very_end_of_a_step_belongs_to_the_step_that_ends():
    seen = first(Ball(3.5, 1.0), (0.0, 0.0, 0.0), 0.5, (COUNTDOWN, FALLING, False), start=3.0)
    assert seen[:2] == (0, 0.5)
