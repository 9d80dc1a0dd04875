# SPDX-License-Identifier: Apache-2.0
"""A blow through a contact of finite stiffness: against an integrator, the closed forms, and the rigid blow."""

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from mech_twin.parts.contact import contact_pulse, damping_ratio, damping_ratio_without_pull

mass = st.floats(1e-3, 1e3)
stiffness = st.floats(1e3, 1e12)
damping = st.floats(0.0, 3.0)
speed = st.floats(1e-3, 50.0)
fading = st.floats(-0.2, 5.0)  # of v w


def integrated(m, k, zeta, v, a):
    """DOP853 until the force ends: peak force, duration, impulse, parting speed; None if it never does.

    The force of an approach that grows tends to what keeps the growth up, which damping can hold above zero for ever.
    """
    c = 2.0 * zeta * math.sqrt(k * m)
    span, scale = math.sqrt(m / k), v * math.sqrt(k * m)

    def force(state):
        return k * state[0] + c * state[1]

    def slope(_, state):
        return [state[1], -force(state) / m - a, force(state)]

    def ended(time, state):
        return force(state) / scale if time > 1e-9 * span else 1.0

    def topped(_, state):
        return k * state[1] - c * (force(state) / m + a)

    ended.terminal, ended.direction, topped.direction = True, -1.0, -1.0
    step = 0.02 * span / (1.0 + 2.0 * zeta + abs(a) * span / v)
    done = solve_ivp(
        slope,
        (0.0, 20.0 * span * (1.0 + 2.0 * zeta)),
        [0.0, v, 0.0],
        method="DOP853",
        rtol=1e-12,
        atol=[1e-13 * v * span, 1e-13 * v, 1e-13 * m * v],
        max_step=step,
        events=(ended, topped),
    )
    if done.status == 0:
        return None
    peaks = [force(state) for state in done.y_events[1]] if len(done.t_events[1]) else []
    return max([c * v, *peaks]), done.t[-1], done.y[2, -1], -done.y[1, -1]


@pytest.mark.slow
@given(m=mass, k=stiffness, zeta=damping, v=speed, share=fading)
@example(m=1.0, k=1e3, zeta=1.0, v=1.0, share=-0.125)
@settings(max_examples=40, deadline=None)
def test_the_pulse_equals_an_independent_integration(m, k, zeta, v, share):
    a = share * v * math.sqrt(k / m)
    found, expected = contact_pulse(m, k, zeta, v, a), integrated(m, k, zeta, v, a)
    if expected is None:
        assert a < 0.0
        assert found.duration_s == found.impulse_ns == math.inf
        return
    assert found.peak_force_n == pytest.approx(expected[0], rel=1e-8)
    assert found.duration_s == pytest.approx(expected[1], rel=1e-8)
    assert found.impulse_ns == pytest.approx(expected[2], rel=1e-8)
    assert found.parting_speed_m_per_s == pytest.approx(expected[3], rel=1e-6, abs=1e-9 * v)


@given(m=mass, k=stiffness, v=speed)
@settings(max_examples=40, deadline=None)
def test_without_damping_it_is_half_a_sine(m, k, v):
    found = contact_pulse(m, k, 0.0, v)
    assert found.peak_force_n == pytest.approx(v * math.sqrt(k * m), rel=1e-12)
    assert found.duration_s == pytest.approx(math.pi * math.sqrt(m / k), rel=1e-12)
    assert found.impulse_ns == pytest.approx(2.0 * m * v, rel=1e-12)
    assert found.parting_speed_m_per_s == pytest.approx(v, rel=1e-12)


@given(zeta=st.floats(0.0, 0.499))
@settings(max_examples=40, deadline=None)
def test_the_damped_pulse_has_its_closed_form(zeta):
    """Force ends at w_d t = pi - 2 asin zeta and is largest at pi/2 - 3 asin zeta."""
    root, turn = math.sqrt(1.0 - zeta * zeta), math.asin(zeta)
    found = contact_pulse(1.0, 1.0, zeta, 1.0)
    assert found.duration_s == pytest.approx((math.pi - 2.0 * turn) / root, rel=1e-12)
    assert found.peak_force_n == pytest.approx(math.exp(-zeta / root * (0.5 * math.pi - 3.0 * turn)), rel=1e-10)
    assert found.parting_speed_m_per_s == pytest.approx(math.exp(-zeta / root * (math.pi - 2.0 * turn)), rel=1e-11)


@given(e=st.floats(1e-3, 1.0))
@settings(max_examples=40, deadline=None)
def test_damping_without_pull_gives_the_restitution_and_the_textbook_s_a_little_more(e):
    kept = contact_pulse(1.0, 1.0, damping_ratio_without_pull(e), 1.0)
    assert kept.parting_speed_m_per_s == pytest.approx(e, rel=1e-9)
    assert contact_pulse(1.0, 1.0, damping_ratio(e), 1.0).parting_speed_m_per_s >= e * (1.0 - 1e-12)


@given(e=st.floats(0.01, 1.0), v=st.floats(0.1, 50.0), a=st.floats(0.0, 100.0))
@settings(max_examples=40, deadline=None)
def test_a_stiff_contact_is_the_rigid_blow(e, v, a):
    m = 10.0 * 96.0 / (10.0 + 96.0)
    pulse = contact_pulse(m, 1e18, damping_ratio_without_pull(e), v, a)
    assert pulse.impulse_ns == pytest.approx(m * (1.0 + e) * v, rel=1e-3)


def test_a_plastic_contact_is_critically_damped_in_the_textbook_s_terms():
    assert damping_ratio(0.0) == 1.0
    assert damping_ratio(1.0) == 0.0
    near, at = contact_pulse(1.0, 1.0, 1.0 - 1e-9, 1.0, 0.3), contact_pulse(1.0, 1.0, 1.0, 1.0, 0.3)
    beyond = contact_pulse(1.0, 1.0, 1.0 + 1e-9, 1.0, 0.3)
    assert near == pytest.approx(at, rel=1e-7)
    assert beyond == pytest.approx(at, rel=1e-7)
    assert contact_pulse(1.0, 1.0, 1.0, 1.0).duration_s == pytest.approx(2.0, rel=1e-12)


def test_an_approach_that_never_fades_has_no_end():
    assert contact_pulse(1.0, 1.0, 0.5, 1e-3, -1.0).duration_s == math.inf


@given(e=st.floats(1e-6, 1.0))
def test_the_textbook_s_damping_loses_its_share_in_half_a_swing(e):
    zeta = damping_ratio(e)
    assert math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta * zeta)) == pytest.approx(e, rel=1e-11)


@pytest.mark.parametrize("e", [-0.1, -1e-12])
def test_no_restitution_below_zero_is_softer_than_a_plastic_contact(e):
    assert damping_ratio(e) == 1.0


@pytest.mark.parametrize("miss", [s * 10.0**-n for n in range(7, 16) for s in (1.0, -1.0)])
def test_next_to_critical_damping_the_closed_form_holds_to_the_last_digits(miss):
    """Force ends at tan(w_d t/2) = w_d/zeta, with tanh above critical damping."""
    zeta = 1.0 + miss
    root = math.sqrt(abs(1.0 - zeta) * (1.0 + zeta))
    end = 2.0 * (math.atan2(root, zeta) if zeta < 1.0 else math.atanh(root / zeta)) / root
    found = contact_pulse(1.0, 1.0, zeta, 1.0)
    assert found.duration_s == pytest.approx(end, rel=1e-12)
    assert found.parting_speed_m_per_s == pytest.approx(math.exp(-zeta * end), rel=1e-12)


@given(m=mass, k=stiffness, v=speed, share=st.floats(-20.0, 20.0))
@settings(max_examples=60, deadline=None)
@example(m=1.0, k=1e3, v=1.0, share=-20.0)
@example(m=1.0, k=1e3, v=1.0, share=20.0)
def test_without_damping_bodies_part_as_fast_as_they_met_however_the_approach_is_driven(m, k, v, share):
    """No energy is lost; tan(w t/2) = v w/a, which a fast growing approach meets for an instant only."""
    a = share * v * math.sqrt(k / m)
    found = contact_pulse(m, k, 0.0, v, a)
    end = 2.0 * math.atan2(1.0, share) * math.sqrt(m / k)
    assert found.duration_s == pytest.approx(end, rel=1e-10)
    assert found.parting_speed_m_per_s == pytest.approx(v, rel=1e-8)
    assert found.impulse_ns == pytest.approx(m * (2.0 * v - a * end), rel=1e-8, abs=1e-8 * m * v)
