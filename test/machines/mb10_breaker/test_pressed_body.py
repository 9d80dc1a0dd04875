# SPDX-License-Identifier: Apache-2.0
"""The free swing against a high-order integrator, and the laws of the linear cycle map."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machines.mb10_breaker.pressed_body_cases import (
    OMEGA,
    body_at,
    cycle_integrated,
    integrated,
    parameters,
    rate_at,
    swing,
)
from machines.mb10_breaker.published_swing import (
    cycle_constants,
    load_constants,
    next_amplitudes,
    published_fixed_point,
    published_growth,
)
from pydantic import ValidationError

from mech_twin.machines.mb10_breaker.pressed_body.flight import SwingStretch, highest, motion
from mech_twin.machines.mb10_breaker.pressed_body.free_swing import (
    amplitudes,
    amplitudes_of_cycle,
    cycle_map,
    growth_per_cycle,
    largest_angle,
    pressing_force,
    resonance_rate,
    start_state,
    swing_regime,
)

FORMS = [
    {"form": "shifted"},
    {"form": "printed", "amplitude_nm": -60.0},
    {"form": "printed", "amplitude_nm": 60.0, "onset_fraction": 0.83},
    {"form": "shifted", "onset_fraction": 0.75},
]


@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("ratio", [0.05, 1.37, 4.999999, 5.0, 10.4])
def test_swing_equals_high_order_integrator(ratio, damping, form):
    body = body_at(ratio, damping_ratio=damping, **form)
    angle, rate = 0.003, 0.4
    z = amplitudes(body, angle, rate)
    for time in (0.31 * body.onset, body.onset):
        assert swing(body, z, time) == pytest.approx(
            tuple(integrated(body, angle, rate, 0.0, time).y[:, -1]), abs=1e-10, rel=1e-10
        )
    assert swing(body, z, body.period) == pytest.approx(cycle_integrated(body, angle, rate), abs=1e-10, rel=1e-10)


@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("damping", [0.0, 0.2])
@pytest.mark.parametrize("ratio", [0.3, 1.37, 3.3, 7.2, 5.0])
def test_integration_constants_equal_high_order_integrator(ratio, damping, form):
    body = body_at(ratio, damping_ratio=damping, **form)
    angle, rate = 0.0, 0.0
    z = amplitudes(body, angle, rate)
    assert z.imag == body.rest_angle
    assert z.real == 0.0 or damping > 0.0
    for cycle in range(3):
        constants = cycle_constants(body, z)
        middle = 0.5 * (body.onset + body.period)
        found = _second_phase(body, constants, middle)
        at_onset = integrated(body, angle, rate, 0.0, body.onset).y[:, -1]
        expected = integrated(body, *at_onset, body.onset, middle).y[0, -1]
        assert found == pytest.approx(expected, abs=1e-10)
        angle, rate = cycle_integrated(body, angle, rate)
        z = next_amplitudes(body, constants)
        assert abs(z - amplitudes(body, angle, rate)) < 1e-10
        assert abs(z - amplitudes_of_cycle(body, cycle + 1)) < 1e-10


def _second_phase(body, constants, time):
    """phi2 as it stands in the paper, damped or not."""
    ring = body.k * math.sqrt(1.0 - body.damping**2)
    fade = math.exp(-body.damping * body.k * time)
    free = constants.b1 * math.sin(ring * time) + constants.b2 * math.cos(ring * time)
    load = constants.c1 * math.sin(body.mu * time) + constants.c2 * math.cos(body.mu * time)
    return fade * free + load * (time - body.onset if constants.secular else 1.0) - body.rest_angle


def test_recurrences_are_the_derived_ones_letter_by_letter():
    body = body_at(1.37, form="printed", amplitude_nm=-60.0)
    k, mu, t1, period = body.k, body.mu, body.onset, body.period
    z = complex(0.01, -0.02)
    c1 = -60.0 / (body.inertia * (k**2 - mu**2))
    b1 = z.real - c1 * (math.sin(mu * t1) * math.sin(k * t1) + mu / k * math.cos(mu * t1) * math.cos(k * t1))
    b2 = z.imag - c1 * (math.sin(mu * t1) * math.cos(k * t1) - mu / k * math.cos(mu * t1) * math.sin(k * t1))
    a1 = b1 * math.cos(k * period) - b2 * math.sin(k * period) + mu / k * c1 * math.cos(mu * period)
    a2 = b1 * math.sin(k * period) + b2 * math.cos(k * period) + c1 * math.sin(mu * period)
    constants = cycle_constants(body, z)
    assert (constants.c1, constants.c2) == pytest.approx((c1, 0.0), abs=1e-15)
    assert (constants.b1, constants.b2) == pytest.approx((b1, b2), abs=1e-14)
    assert abs(next_amplitudes(body, constants) - complex(a1, a2)) < 1e-14


def test_damped_load_constants_satisfy_the_equation_of_motion():
    body = body_at(3.3, damping_ratio=0.3, form="printed", amplitude_nm=-60.0)
    c1, c2 = load_constants(body)
    stiff, drag = body.k**2 - body.mu**2, 2.0 * body.damping * body.k * body.mu
    assert stiff * c1 - drag * c2 == pytest.approx(-60.0 / body.inertia, rel=1e-12)
    assert stiff * c2 + drag * c1 == pytest.approx(0.0, abs=1e-10)


def test_shifted_form_is_the_printed_one_with_negative_amplitude_at_nine_tenths():
    shifted, printed = body_at(1.37), body_at(1.37, form="printed", amplitude_nm=-60.0)
    assert abs(cycle_map(shifted).gain - cycle_map(printed).gain) < 1e-15


@pytest.mark.parametrize("ratio", [0.3, 0.7, 1.37, 3.3, 7.2, 10.4])
def test_fixed_point_repeats_under_high_order_integrator(ratio):
    body = body_at(ratio)
    closed, size = published_fixed_point(body)
    assert abs(closed - cycle_map(body).fixed_point) < 1e-12
    assert cycle_integrated(body, *start_state(body, closed)) == pytest.approx(start_state(body, closed), abs=1e-10)
    free = size * math.cos(body.k * (0.02 - 0.5 * body.onset)) - body.rest_angle
    assert swing(body, closed, 0.02)[0] == pytest.approx(free, abs=1e-12)


@pytest.mark.parametrize("changed", [{"onset_fraction": 0.8}, {"damping_ratio": 0.1}])
def test_closed_form_of_fixed_point_is_refused_where_it_does_not_hold(changed):
    body = body_at(1.37, **changed)
    with pytest.raises(ValueError, match="solve the cycle map"):
        published_fixed_point(body)
    fixed = start_state(body, cycle_map(body).fixed_point)
    assert cycle_integrated(body, *fixed) == pytest.approx(fixed, abs=1e-10)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5, 6, 9])
def test_resonance_grows_by_the_closed_form_each_cycle(order):
    body = body_at(order)
    assert body.rate == pytest.approx(resonance_rate(body, order), rel=1e-12)
    assert growth_per_cycle(body) == pytest.approx(published_growth(body), rel=1e-10)
    grown = amplitudes_of_cycle(body, 7) - amplitudes_of_cycle(body, 6)
    assert abs(grown) == pytest.approx(growth_per_cycle(body), rel=1e-10)
    assert swing_regime(body).kind == "grows"
    with pytest.raises(ValueError, match="no fixed point"):
        _ = cycle_map(body).fixed_point


@pytest.mark.parametrize("ratio", [0.3, 1.37, 8.3])
def test_largest_angle_is_that_of_a_dense_scan_load_phase_included(ratio):
    body = body_at(ratio)
    z = amplitudes_of_cycle(body, 3)
    at, top = largest_angle(body, z)
    scan = max(swing(body, z, body.period * i / 5000)[0] for i in range(5001))
    assert swing(body, z, at)[0] == pytest.approx(top, abs=1e-13)
    assert scan <= top + 1e-15
    assert top - scan < 1e-5 * abs(top + body.rest_angle)


def test_largest_force_of_a_stiff_spring_lies_in_the_load_phase():
    body = body_at(8.3, preload=0.0)
    at, top = largest_angle(body, amplitudes(body, 0.0, 0.0))
    assert body.onset < at < body.period
    assert pressing_force(body, top) == pytest.approx(body.rate * (body.arm * top + body.deflection))


def test_undamped_motion_from_rest_beats_and_stays_within_its_bound():
    body = body_at(1.37)
    regime = swing_regime(body)
    assert regime.kind == "beat"
    tops = [largest_angle(body, amplitudes_of_cycle(body, cycle))[1] for cycle in range(400)]
    assert max(tops) <= regime.largest_angle_rad + 1e-12
    assert max(tops) > regime.largest_angle_rad - 1e-3 * (regime.largest_angle_rad + body.rest_angle)


def test_damped_motion_settles_to_the_fixed_point():
    body = body_at(1.37, damping_ratio=0.1)
    assert swing_regime(body).kind == "periodic"
    assert abs(amplitudes_of_cycle(body, 60) - cycle_map(body).fixed_point) < 1e-12


@given(
    ratio=st.floats(0.02, 11.0),
    angle=st.floats(0.0, 0.05),
    rate=st.floats(-2.0, 2.0),
    duration=st.floats(1e-9, 0.1),
)
@settings(max_examples=60, deadline=None)
def test_unloaded_undamped_swing_keeps_its_energy(ratio, angle, rate, duration):
    body = body_at(ratio)
    stretch = SwingStretch(angle, rate, 0.0, 0.0)
    later = motion(body, stretch, duration)
    energy = [v**2 + (body.k * (x + body.rest_angle)) ** 2 for x, v in ((angle, rate), later)]
    assert energy[1] == pytest.approx(energy[0], rel=1e-12)
    top = highest(body, stretch, duration)[1]
    assert top <= math.sqrt(energy[0]) / body.k - body.rest_angle + 1e-12


def test_series_and_closed_form_meet():
    body = body_at(2.2, damping_ratio=0.1)
    stretch = SwingStretch(0.001, 0.3, 60.0, 0.4)
    seam = 0.25 / body.mu
    below, above = motion(body, stretch, seam * (1.0 - 1e-12)), motion(body, stretch, seam * (1.0 + 1e-12))
    assert below == pytest.approx(above, rel=1e-11)


def test_frequency_ratio_that_does_not_fill_the_cycle_is_refused():
    with pytest.raises(ValidationError, match=r"frequency_ratio must be .* = 2\.5"):
        parameters(onset_fraction=0.8, frequency_ratio=5.0)
    assert body_at(1.0, onset_fraction=0.8).mu == pytest.approx(2.5 * OMEGA)
    assert rate_at(1.0) == pytest.approx(34543.6, abs=0.1)
