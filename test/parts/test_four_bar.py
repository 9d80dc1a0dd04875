# SPDX-License-Identifier: Apache-2.0
"""Laws of the four-bar: lengths, derivatives, mirror, equilibrium, power."""

import math
import re

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mech_twin.parts.four_bar import (
    CROSSED,
    OPEN,
    FourBar,
    Link,
    acute_angles,
    closure_error,
    coefficients,
    failing_inequality,
    link_angles,
    motion,
    pin_forces,
    position,
    reduced_inertia,
    smallest_transmission_angle,
)

CRANK, COUPLER, ROCKER = Link(5.0, 0.02, 0.01, 0.003), Link(4.0, 0.08, 0.2, 0.01), Link(5.0, 0.03, 0.15, -0.02)
PRESS = FourBar(0.06, 0.5, 0.3, 0.5, 0.24, OPEN)
BREAKER = FourBar(0.03, 0.2, 0.08, 0.2, 0.0, OPEN)

length = st.floats(0.05, 1.0)
bars = st.builds(
    FourBar, st.floats(0.01, 0.2), length, length, length, st.floats(-0.5, 0.5), st.sampled_from((OPEN, CROSSED))
)
angle = st.floats(-10.0, 10.0)


def turning(bar: FourBar) -> FourBar:
    assume(failing_inequality(bar) is None)
    return bar


def well_conditioned(bar: FourBar, f: float) -> None:
    assume(acute_angles(position(bar, f))[1] > 0.2)


@given(bars, angle)
@settings(deadline=None)  # the first call compiles
def test_rods_keep_their_length(bar, f):
    assert closure_error(turning(bar), position(bar, f)) <= 1e-12


@given(bars, angle)
@settings(max_examples=60, deadline=None)
def test_coefficients_are_derivatives_of_the_angles(bar, f):
    well_conditioned(turning(bar), f)
    step = 1e-5
    before, after = position(bar, f - step), position(bar, f + step)
    found, low, high = coefficients(position(bar, f)), coefficients(before), coefficients(after)
    scale = max(1.0, *(abs(x) for x in found)) ** 2
    for i in (0, 1):
        turned = math.remainder(link_angles(after)[i] - link_angles(before)[i], 2.0 * math.pi)
        assert turned / (2.0 * step) == pytest.approx(found[i], abs=1e-8 * scale)
        assert (high[i] - low[i]) / (2.0 * step) == pytest.approx(found[i + 2], abs=1e-7 * scale)
        assert (high[i + 2] - low[i + 2]) / (2.0 * step) == pytest.approx(found[i + 4], abs=1e-6 * scale)


@given(bars, angle)
@settings(deadline=None)  # the first call compiles
def test_branches_mirror_each_other(bar, f):
    mirror = bar._replace(pivot_y_m=-bar.pivot_y_m, branch=-bar.branch)
    here, there = position(turning(bar), f), position(mirror, -f)
    assert (here.b_x, here.b_y) == pytest.approx((there.b_x, -there.b_y), abs=1e-12)


@given(angle, st.floats(-30.0, 30.0), st.floats(-200.0, 200.0))
@settings(deadline=None)  # the first call compiles
def test_drive_moment_by_equilibrium_is_that_of_the_reduced_mass(f, w1, e1):
    at = position(PRESS, f)
    by = coefficients(at)
    inertia, slope = reduced_inertia(PRESS, CRANK, COUPLER, ROCKER, at, by)
    found = pin_forces(
        PRESS, CRANK, COUPLER, ROCKER, at, motion(PRESS, CRANK, COUPLER, ROCKER, at, by, w1, e1), e1, *(0.0,) * 6
    ).moment
    assert found == pytest.approx(inertia * e1 + 0.5 * w1 * w1 * slope, abs=1e-10 * (abs(e1) + w1 * w1 + 1.0))


@given(angle, st.floats(-500.0, 500.0), st.floats(-500.0, 500.0))
@settings(deadline=None)  # the first call compiles
def test_massless_linkage_passes_the_power_of_the_load(f, q_x, q_y):
    nothing = Link(0.0, 0.0, 0.1, 0.0)
    at = position(PRESS, f)
    by = coefficients(at)
    still = motion(PRESS, nothing, nothing, nothing, at, by, 1.0, 0.0)
    p_x, p_y = at.a_x + 0.5 * at.u_x, at.a_y + 0.5 * at.u_y
    v_x, v_y = -at.a_y - by.g2 * 0.5 * at.u_y, at.a_x + by.g2 * 0.5 * at.u_x
    moment = pin_forces(PRESS, nothing, nothing, nothing, at, still, 0.0, 0.0, 0.0, q_x, q_y, p_x, p_y).moment
    assert moment == pytest.approx(-(q_x * v_x + q_y * v_y), abs=1e-9)


@given(angle)
@settings(deadline=None)  # the first call compiles
def test_pin_reactions_balance_the_frame(f):
    at = position(BREAKER, f)
    by = coefficients(at)
    moved = motion(BREAKER, CRANK, COUPLER, ROCKER, at, by, 60.0, 10.0)
    found = pin_forces(BREAKER, CRANK, COUPLER, ROCKER, at, moved, 10.0, 0.0, -9.81, *(0.0,) * 4)
    links = ((CRANK, moved.s1_ax, moved.s1_ay), (COUPLER, moved.s2_ax, moved.s2_ay), (ROCKER, moved.s3_ax, moved.s3_ay))
    assert found.o_x + found.c_x == pytest.approx(sum(k.mass_kg * a for k, a, _ in links), abs=1e-8)
    assert found.o_y + found.c_y == pytest.approx(sum(k.mass_kg * (a + 9.81) for k, _, a in links), abs=1e-8)


@pytest.mark.parametrize(
    ("bar", "words"),
    [
        (FourBar(0.3, 0.2, 0.1, 0.2, 0.0, OPEN), r"crank \+ ground <= coupler \+ rocker fails: 0.5 > 0.3"),
        (FourBar(0.03, 0.4, 0.1, 0.2, 0.0, OPEN), r">= \|coupler - rocker\| fails: 0.17 < 0.3"),
    ],
)
def test_linkage_that_cannot_turn_is_refused_with_its_numbers(bar, words):
    failing = failing_inequality(bar, crank_rocker=True)
    assert failing is not None
    assert re.search(words, failing)


def test_double_crank_is_no_crank_rocker():
    drag_link = FourBar(0.5, 0.4, 0.5, 0.1, 0.0, OPEN)
    assert failing_inequality(drag_link) is None
    assert "crank <= every other link" in (failing_inequality(drag_link, crank_rocker=True) or "")


LENGTHS = st.floats(0.01, 1.0)


@given(LENGTHS, LENGTHS, LENGTHS, LENGTHS)
@settings(deadline=None)
def test_a_crank_rocker_is_what_grashof_calls_one_and_nothing_else(crank, coupler, rocker, ground):
    """Grashof 1883: the crank is the shortest link, and shortest + longest <= the sum of the other two."""
    bar = FourBar(crank, coupler, rocker, ground, 0.0, OPEN)
    shortest, second, third, longest = sorted((crank, coupler, rocker, ground))
    slack = second + third - shortest - longest
    assume(abs(slack) > 1e-12)  # on the border rounding decides
    refused = failing_inequality(bar, crank_rocker=True)
    assert (refused is None) == (crank == shortest and slack > 0.0)


def test_a_crank_pin_that_meets_the_pivot_is_refused():
    """Equal crank and ground, equal coupler and rocker: there the rods may lie anywhere."""
    bar = FourBar(0.05, 0.3, 0.3, 0.05, 0.0, OPEN)
    assert "must not meet" in failing_inequality(bar)


@pytest.mark.slow
@given(bars)
@settings(max_examples=60, deadline=None)
def test_no_position_of_a_turn_has_a_smaller_transmission_angle_and_one_has_this(bar):
    """It is met where the crank lies in line with the frame; turned so that the frame lies along x, at 0 or pi."""
    ground = math.hypot(turning(bar).pivot_x_m, bar.pivot_y_m)
    level = bar._replace(pivot_x_m=ground, pivot_y_m=0.0)
    assume(failing_inequality(level) is None)
    smallest = smallest_transmission_angle(bar)
    assume(smallest > 0.01)
    around = [acute_angles(position(level, 0.02 * i))[1] for i in range(315)]
    assert min(around) >= smallest - 1e-9
    in_line = [acute_angles(position(level, f))[1] for f in (0.0, math.pi)]
    assert min(in_line) == pytest.approx(smallest, abs=1e-9)


@given(st.floats(0.01, 0.2), st.floats(0.3, 1.0), st.floats(0.3, 0.7), angle)
@settings(deadline=None)
def test_a_linkage_stretched_or_folded_at_one_position_is_assembled_there(crank, ground, share, turned):
    """The rods lie in line on the far side: the square of B's distance from AC is 0, or less by rounding."""
    coupler = share * (crank + ground)
    bar = FourBar(crank, coupler, crank + ground - coupler, ground * math.cos(turned), ground * math.sin(turned), OPEN)
    assert closure_error(bar, position(bar, turned + math.pi)) <= 1e-12


def test_a_linkage_at_its_limit_turns():
    """Parallelogram-like lengths that are exact numbers: crank + ground = coupler + rocker."""
    for crank_rocker in (False, True):
        assert failing_inequality(FourBar(0.25, 0.5, 0.25, 0.5, 0.0, OPEN), crank_rocker) is None


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_how_near_crank_pin_and_pivot_may_come_is_a_share_of_the_lengths(scale):
    def bar(ground_miss, rocker_miss):
        rocker = 0.3 * (1.0 + rocker_miss)
        return FourBar(0.05 * scale, 0.3 * scale, rocker * scale, 0.05 * (1.0 + ground_miss) * scale, 0.0, OPEN)

    assert "must not meet" in (failing_inequality(bar(4e-10, 0.0)) or "")
    assert "must not meet" in (failing_inequality(bar(1e-9, 1e-11)) or "")
    assert failing_inequality(bar(1e-8, 0.0)) is None
    assert failing_inequality(bar(1e-7, 5e-9)) is None
