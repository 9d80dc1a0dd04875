# SPDX-License-Identifier: Apache-2.0
"""The breaker's body under the half sine: one chain of events, whatever the step, however it is continued."""

import pytest
from machines.mb10_breaker.pressed_body_cases import parameters, rate_at, swing, walked_cycle

from mech_twin.machines.mb10_breaker.half_sine_body import half_sine_body
from mech_twin.machines.mb10_breaker.pressed_body.free_swing import amplitudes_of_cycle
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.roles import BodyRole
from mech_twin.samples import ForceSample, Named


def forces(step, step_s):
    return ForceSample(step, step * step_s, (), (), Named(), 0.0, Named())


def run(role, step_s, duration_s, first=0):
    sample = role.start(forces(first, step_s))
    samples = [sample]
    for step in range(first + 1, first + round(duration_s / step_s) + 1):
        sample = role.follow(sample, forces(step, step_s))
        samples.append(sample)
    return samples


def role_of(step_s, rate=3108.9, deflection=0.03, **changed) -> BodyRole:
    return half_sine_body(*parameters(rate, deflection, **changed), step_s)


def events_of(samples):
    return [event for sample in samples for event in sample.events]


@pytest.mark.parametrize("changed", [{}, {"deflection": 0.012}, {"damping_ratio": 0.1}, {"restitution": 0.8}], ids=str)
def test_coupling_step_does_not_touch_the_motion(changed):
    coarse, fine = run(role_of(1e-3, **changed), 1e-3, 1.0), run(role_of(2.5e-4, **changed), 2.5e-4, 1.0)
    found, expected = events_of(coarse), events_of(fine)
    assert len(found) == len(expected) >= 20
    for one, other in zip(found, expected, strict=True):
        assert (one.kind, one.contact, one.period) == (other.kind, other.contact, other.period)
        assert one.time_s == pytest.approx(other.time_s, abs=1e-12)
        assert one.pre_velocity_m_per_s == pytest.approx(other.pre_velocity_m_per_s, abs=1e-12)
        assert one.impulse_ns == pytest.approx(other.impulse_ns, abs=1e-12)
    for one, other in zip(coarse, fine[::4], strict=True):
        assert one.position[0] == pytest.approx(other.position[0], abs=1e-13)
        assert one.velocity[0] == pytest.approx(other.velocity[0], abs=1e-12)


def test_events_lie_in_the_step_that_reports_them_and_in_order():
    samples = run(role_of(1e-3), 1e-3, 1.0)
    times = [event.time_s for event in events_of(samples)]
    assert times == sorted(times)
    for sample in samples:
        assert all(sample.time_s - 1e-3 - 1e-12 < event.time_s <= sample.time_s + 1e-12 for event in sample.events)
    kinds = {event.kind for event in events_of(samples)}
    assert kinds == {"lift_off", "touchdown", "settled", "blow"}


def test_residuals_stay_within_their_limits():
    role = role_of(1e-3)
    for sample in run(role, 1e-3, 2.0):
        for name, value in sample.residuals.as_dict().items():
            assert abs(value) <= role.residual_limits[name]


def test_run_goes_on_from_its_last_sample_in_another_role():
    whole = run(role_of(1e-3), 1e-3, 0.5)
    sample = whole[207]
    again = role_of(1e-3)
    for step in range(208, 501):
        sample = again.follow(sample, forces(step, 1e-3))
        assert sample == whole[step]


def test_reset_keeps_time_and_moves_the_origin_of_the_cycle():
    early, late = run(role_of(1e-3), 1e-3, 0.4), run(role_of(1e-3), 1e-3, 0.4, first=37)
    assert late[0].time_s == 37e-3
    for one, other in zip(events_of(early), events_of(late), strict=True):
        assert other.time_s - one.time_s == pytest.approx(37e-3, abs=1e-12)
        assert other.period == one.period


def test_live_change_takes_effect_from_the_last_sample_on():
    samples = run(role_of(1e-3), 1e-3, 0.35)
    turned = samples[-1]
    harder = role_of(1e-3, deflection=0.09)
    sample = turned
    seen = []
    for step in range(351, 1200):
        sample = harder.follow(sample, forces(step, 1e-3))
        seen.append(sample)
    expected = walked_cycle(pressed_body(*parameters(3108.9, 0.09)), 20)
    fastest = max(-event.pre_velocity_m_per_s for s in seen[-120:] for event in s.events if event.kind == "touchdown")
    assert fastest == pytest.approx(expected.return_speed_m_per_s, rel=1e-9)
    assert seen[0].pressing_force_n == pytest.approx(3108.9 * (0.2 * seen[0].position[0] + 0.09))


def test_change_in_flight_keeps_angle_and_rate():
    samples = run(role_of(1e-3, deflection=0.02), 1e-3, 0.11)
    before = samples[-1]
    assert before.regime == 1
    stiffer = half_sine_body(*parameters(3108.9 * 1.5, 0.02), 1e-3)
    after = stiffer.follow(before, forces(111, 1e-3))
    acceleration = (after.velocity[0] - before.velocity[0]) / 1e-3
    middle = 0.5 * (before.position[0] + after.position[0])
    assert acceleration == pytest.approx(-3108.9 * 1.5 * (0.2 * middle + 0.02) * 0.2 / 0.35, rel=1e-3)
    assert after.position[0] == pytest.approx(before.position[0] + 1e-3 * before.velocity[0], abs=2e-4)


def test_without_collar_it_is_the_published_swing():
    rate = rate_at(1.37)
    samples = run(role_of(1e-3, rate=rate, contact="none"), 1e-3, 0.6)
    body = pressed_body(*parameters(rate, 0.03, contact="none"))
    for step in (50, 95, 155, 399, 597):
        cycle, local = divmod(step, 100)
        expected = swing(body, amplitudes_of_cycle(body, cycle), local * 1e-3)
        assert samples[step].position[0] == pytest.approx(expected[0], abs=1e-11)
        assert samples[step].velocity[0] == pytest.approx(expected[1], abs=1e-9)
    assert {event.kind for event in events_of(samples)} == {"blow"}


def test_blow_impulse_lifts_a_body_pressed_harder_than_the_load():
    samples = run(role_of(1e-3, deflection=0.2, blow_impulse_nms=0.05), 1e-3, 0.3)
    kinds = [event.kind for event in events_of(samples)]
    assert kinds[:3] == ["blow", "lift_off", "touchdown"]
    blow = events_of(samples)[0]
    assert blow.impulse_ns == pytest.approx(0.05 / 0.25)
    assert blow.post_velocity_m_per_s == pytest.approx(0.25 * 0.05 / 0.35)
