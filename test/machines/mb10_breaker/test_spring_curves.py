# SPDX-License-Identifier: Apache-2.0
"""The owner's question: how hard to press."""

import math
from itertools import pairwise

import pytest
from machines.mb10_breaker.pressed_body_cases import parameters, rate_at, walked_cycle

from mech_twin.machines.mb10_breaker.pressed_body.free_swing import swing_regime
from mech_twin.machines.mb10_breaker.pressed_body.metrics import preload_range, with_preload
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.sizing import seating, with_rest_force
from mech_twin.parameters.load import machine_parameters


def swing_curve(rates, deflection=0.0):
    return [swing_regime(pressed_body(*parameters(rate, deflection))) for rate in rates]


RATES = [rate_at(ratio) for ratio in (0.1, 0.3, 0.7, 1.0, 1.5, 2.5)]


def test_without_preload_amplitude_falls_and_force_rises_between_resonances():
    points = swing_curve(RATES)
    assert [math.isinf(point.amplitude_rad) for point in points] == [False, False, False, True, False, False]
    assert [point.kind for point in points] == ["beat", "beat", "beat", "grows", "beat", "beat"]
    soft = points[0]
    # a soft spring: the mean pressing moment balances the mean of the load, 2 H/(mu T) ... P = 2 |H|/(pi l) (T - t1)/T
    assert soft.periodic_force_n == pytest.approx(2.0 * 60.0 / math.pi * 0.1 / 0.2, rel=0.03)


def test_preload_shifts_the_rest_and_adds_its_force_without_a_collar():
    bare, pressed = (swing_curve(RATES[:2], a) for a in (0.0, 0.01))
    for one, other in zip(bare, pressed, strict=True):
        assert other.amplitude_rad == pytest.approx(one.amplitude_rad)
        assert other.periodic_force_n == pytest.approx(one.periodic_force_n)
        assert other.periodic_angle_rad == pytest.approx(one.periodic_angle_rad - 0.01 / 0.2)


def test_more_preload_trades_gap_and_return_speed_for_force():
    rate = rate_at(0.3)
    unit = 60.0 / (rate * 0.2)
    half_sine = {"excitation.kind": "approximated", "body.inertia_kg_m2": 0.35, "body.spring_rate_n_per_m": rate}
    half_sine = machine_parameters("mb10_breaker", None, half_sine)
    points = [seating(with_rest_force(half_sine, p * unit * rate), 4.0) for p in (0.1, 0.2, 0.4, 0.6, 0.8, 1.0)]
    assert [point.flight_share < 1.0 for point in points] == [False, True, True, True, True, True]
    for weaker, stronger in pairwise(points[1:]):
        assert stronger.gap_at_blow_m < weaker.gap_at_blow_m
        assert stronger.return_speed_m_per_s < weaker.return_speed_m_per_s
        assert stronger.largest_force_n > weaker.largest_force_n


def test_rational_range_is_bounded_by_settling_and_by_the_load():
    for rate in RATES[:2]:
        body = pressed_body(*parameters(rate))
        found = preload_range(body, body.k)
        assert 0.0 < found.settled < found.returned < 1.0
        assert walked_cycle(with_preload(body, found.settled), 20).settled_s == pytest.approx(0.09, abs=1e-9)
        assert walked_cycle(with_preload(body, found.returned), 20).gap_at_blow_m < 1e-9
        assert with_preload(body, 1.0).deflection == pytest.approx(60.0 / (rate * 0.2))
