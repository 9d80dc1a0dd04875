# SPDX-License-Identifier: Apache-2.0
"""Laws of flight, blow and chatter, against exact arithmetic."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from parameter_bounds import has_range, live_names

from mech_twin.machines.impact_mass.impact_stop import (
    StopParameters,
    arrival,
    discriminant,
    exact_product,
    exact_sum,
    flown_gap,
    impacts_kept,
    impacts_within,
    series_delay,
    series_length,
    series_sum,
)

sizes = st.floats(1e-6, 1e6)
signed = st.one_of(sizes, sizes.map(lambda v: -v), st.just(0.0))


def exact_discriminant(gap: float, v: float, a: float) -> Fraction:
    return Fraction(v) ** 2 + 2 * Fraction(a) * Fraction(gap)


@given(signed, signed)
def test_a_product_and_its_error_are_exact(a, b):
    high, low = exact_product(a, b)
    assert Fraction(high) + Fraction(low) == Fraction(a) * Fraction(b)


@given(sizes, signed, signed)
@example(0.15625, 12.5, -500.0)
@example(1.0, math.sqrt(2.0), -1.0)
@example(0.1, math.sqrt(0.2), -1.0)
def test_the_discriminant_has_its_true_sign_and_value(gap, v, a):
    exact = exact_discriminant(gap, v, a)
    ours = discriminant(gap, v, a)
    assert (ours > 0) == (exact > 0)
    assert (ours < 0) == (exact < 0)
    assert abs(Fraction(ours) - exact) <= abs(exact) * Fraction(1, 2**50)


@given(sizes, st.floats(-1e-12, 1e-12), st.floats(0.01, 100.0))
def test_the_sign_is_true_next_to_grazing(gap, nudge, v):
    a = -v * v / (2.0 * gap) * (1.0 + nudge)
    exact = exact_discriminant(gap, v, a)
    ours = discriminant(gap, v, a)
    assert (ours > 0, ours < 0) == (exact > 0, exact < 0)


def test_exact_grazing_is_no_impact():
    assert not arrival(0.15625, 12.5, -500.0).reaches
    assert arrival(0.15625, 12.5, math.nextafter(-500.0, 0.0)).reaches
    assert not arrival(0.15625, 12.5, math.nextafter(-500.0, -math.inf)).reaches


@given(st.floats(1e-9, 1e3), signed, signed)
def test_an_arrival_is_on_the_parabola(gap, v, a):
    flight = arrival(gap, v, a)
    if flight.reaches:
        t = Fraction(flight.duration_s)
        left = Fraction(gap) - t * (Fraction(v) + Fraction(a) * t / 2)
        size = Fraction(gap) + t * (abs(Fraction(v)) + abs(Fraction(a)) * t / 2)
        assert abs(left) <= size * Fraction(1, 10**14)
        assert flight.speed_m_per_s > 0.0
    else:
        assert exact_discriminant(gap, v, a) <= 0 or (v <= 0.0 and a <= 0.0)


def test_leaving_without_a_pull_back_never_arrives():
    assert not arrival(0.0, -1.0, 0.0).reaches
    assert not arrival(0.0, -1.0, -5.0).reaches
    assert not arrival(1.0, 0.0, 0.0).reaches
    assert arrival(0.0, -1.0, 5.0).duration_s == pytest.approx(0.4, rel=1e-15)
    assert arrival(0.5, 2.0, 0.0) == (True, 0.25, 2.0)


@given(st.floats(0.01, 0.95), st.floats(0.01, 50.0), st.floats(0.1, 1e4))
def test_a_series_sums_its_intervals_and_ends_at_its_limit(r, v1, a):
    t, v = 0.0, v1
    for i in range(2, 12):
        t += 2 * r * v / a
        v *= r
        assert series_delay(float(i), v1, a, r) == pytest.approx(t, rel=1e-12)
    assert series_delay(1.0, v1, a, r) == 0.0
    assert series_delay(1e6, v1, a, r) == pytest.approx(series_length(v1, a, r), rel=1e-12)


@given(st.floats(0.05, 0.9), st.integers(1, 20))
def test_the_number_of_impacts_within_a_time_is_that_of_the_series(r, i):
    here, there = series_delay(float(i), 1.0, 1.0, r), series_delay(float(i + 1), 1.0, 1.0, r)
    assert impacts_within(0.5 * (here + there), 1.0, 1.0, r) == i or there - here < 1e-9 * here
    for beyond in (1.0, 1.5, 100.0):
        assert impacts_within(beyond * series_length(1.0, 1.0, r), 1.0, 1.0, r) == math.inf


def test_a_cut_off_equal_to_a_power_keeps_that_impact():
    assert impacts_kept(0.09, 0.3) == 3
    assert impacts_kept(0.027, 0.3) == 4
    assert impacts_kept(0.01, 0.1) == 3
    assert impacts_kept(0.0901, 0.3) == 2
    assert impacts_kept(0.5, 0.3) == 1


@pytest.mark.parametrize("value", [0.0, 1.0, -0.1, 1.5])
def test_restitution_outside_0_and_1_is_refused(value):
    with pytest.raises(ValueError, match="restitution"):
        StopParameters(mass_kg=1.0, stop_position_m=0.0, restitution=value)


def test_mass_and_restitution_may_change_while_it_runs_and_are_within_what_the_series_can_be_summed_for():
    valid = {"mass_kg": 1.0, "stop_position_m": 0.0, "restitution": 0.3}
    assert has_range(StopParameters, valid, "restitution", 1e-6, 0.999999)
    assert has_range(StopParameters, valid, "mass_kg", 1e-9, 1e7)
    assert has_range(StopParameters, valid, "contact_stiffness_n_per_m", 1e-9, 1e13)
    assert has_range(StopParameters, valid, "chatter_cutoff", 0.0, math.nextafter(1.0, 0.0))
    assert live_names(StopParameters) == {"mass_kg", "restitution"}
    assert StopParameters(**valid).chatter_cutoff == 0.0


@given(st.floats(1e-3, 1e3), st.floats(-50.0, 50.0), st.floats(-1e3, 1e3), st.floats(0.0, 10.0))
def test_a_flight_is_the_parabola_up_to_the_stop_and_never_beyond(gap, v, a, t):
    exact = Fraction(gap) - Fraction(v) * Fraction(t) - Fraction(a) * Fraction(t) ** 2 / 2
    size = gap + abs(v) * t + abs(a) * t * t
    assert flown_gap(gap, v, a, t) == pytest.approx(max(float(exact), 0.0), abs=1e-14 * size)


def test_the_gap_of_a_flight_that_ends_beyond_the_stop_by_rounding_is_zero():
    assert flown_gap(1.0, 1.0, 0.0, 1.0000001) == 0.0


@given(st.floats(0.01, 0.95), st.floats(0.01, 50.0), st.integers(1, 12))
def test_the_speeds_before_the_impacts_of_a_series_are_summed(r, v1, n):
    assert series_sum(float(n), v1, r) == pytest.approx(sum(v1 * r**i for i in range(n)), rel=1e-12)


@given(signed, signed)
def test_a_sum_and_its_error_are_exact(a, b):
    high, low = exact_sum(a, b)
    assert high == a + b
    assert Fraction(high) + Fraction(low) == Fraction(a) + Fraction(b)


@given(sizes, sizes)
def test_a_blow_at_no_gap_is_at_once_and_one_after_leaving_comes_with_the_speed_of_leaving(v, a):
    assert arrival(0.0, v, a) == (True, 0.0, v)
    assert arrival(0.0, v, -a) == (True, 0.0, v)
    assert arrival(0.0, -v, a) == (True, pytest.approx(2.0 * v / a, rel=1e-15), v)
    tiny = 1e-200  # its square vanishes
    assert arrival(0.0, tiny, a) == (True, 0.0, tiny)


def test_what_never_arrives_has_no_time_and_no_speed():
    assert arrival(1.0, -1.0, -1.0) == (False, math.inf, 0.0)
    assert arrival(0.15625, 12.5, -500.0) == (False, math.inf, 0.0)
    assert arrival(0.0, 0.0, 5.0) == (False, math.inf, 0.0)
