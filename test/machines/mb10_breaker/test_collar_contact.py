# SPDX-License-Identifier: Apache-2.0
"""Events on the one-sided collar: against an independent integrator, closed forms, and what must always hold."""

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from machines.mb10_breaker.pressed_body_cases import body_at, contact_integrated, walked_cycle

from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import (
    BLOW,
    CAUSES,
    CONTACT,
    ONSET,
    SETTLED,
    SETTLING,
    TAIL_CUT,
    TOUCHDOWN,
    next_piece,
    planned_piece,
    resting_piece,
    series_limit,
    state_at,
)
from mech_twin.machines.mb10_breaker.pressed_body.flight import SwingStretch, touchdown


def chain(body, cycles):
    """Pieces and happenings of a run from rest."""
    piece, found = resting_piece(body, 0), []
    while piece.cycle < cycles:
        after, ending = next_piece(body, piece)
        found.append((piece, ending))
        piece = after
    return found


def events(body, cycles):
    """(kind, time, approach speed) of a run from rest, as the independent integrator gives them."""
    return [
        (CAUSES[ending.cause], piece.cycle * body.period + piece.end, max(-ending.pre, 0.0))
        for piece, ending in chain(body, cycles)
        if ending.cause != ONSET
    ]


@pytest.mark.parametrize(
    ("ratio", "preload", "changed"),
    [
        (0.3, 0.5, {}),
        (0.3, 0.2, {}),
        (1.0, 0.05, {}),
        (0.3, 0.93, {}),  # returns, and settles, within the load phase
        pytest.param(4.7, 0.3, {"restitution": 0.7}, marks=pytest.mark.slow),
        pytest.param(9.0, 0.4, {"restitution": 0.2}, marks=pytest.mark.slow),  # lifts twice in a load phase
        (2.0, 0.3, {"damping_ratio": 0.15}),
        (0.3, 0.4, {"onset_fraction": 0.6}),
    ],
)
def test_events_equal_an_independent_integrator(ratio, preload, changed):
    body = body_at(ratio, preload, **changed)
    expected, found = contact_integrated(body, 3), events(body, 3)
    assert [kind for kind, _, _ in found] == [kind for kind, _, _ in expected]
    for (_, time, speed), (_, expected_time, expected_speed) in zip(found, expected, strict=True):
        assert time == pytest.approx(expected_time, abs=1e-8)
        if speed > 0.0 and expected_speed > 0.0:
            assert speed == pytest.approx(expected_speed, abs=1e-8)


@pytest.mark.parametrize("preload", [0.0, 0.2, 0.5, 0.999])
def test_lift_off_is_where_the_moment_balances_the_preload(preload):
    body = body_at(0.3, preload)
    found = next(time for kind, time, _ in events(body, 1) if kind == "lift_off")
    assert found == pytest.approx(body.onset + math.asin(preload) / body.mu, abs=1e-14)


@pytest.mark.parametrize("preload", [1.0 + 1e-12, 1.0, 2.0])
def test_body_never_lifts_at_preload_ratio_one_and_above(preload):
    assert {kind for kind, _, _ in events(body_at(0.3, preload + 1e-12), 3)} == {"blow"}


@given(ratio=st.floats(0.02, 11.0), preload=st.floats(0.01, 3.0), speed=st.floats(1e-9, 5.0))
@settings(max_examples=80, deadline=None)
def test_unloaded_bounce_has_its_closed_form(ratio, preload, speed):
    body = body_at(ratio, preload)
    duration, approach = touchdown(body, SwingStretch(0.0, speed, 0.0, 0.0), math.inf)
    assert duration == pytest.approx(2.0 / body.k * math.atan(speed / (body.k * body.rest_angle)), rel=1e-13)
    assert approach == pytest.approx(speed, rel=1e-14)


@given(ratio=st.floats(0.02, 11.0), speed=st.floats(1e-6, 5.0), preload=st.floats(0.01, 0.9))
@settings(max_examples=60, deadline=None)
def test_search_finds_what_the_closed_form_gives(ratio, speed, preload):
    body = body_at(ratio, preload)
    # a load of next to nothing sends the same bounce through the search
    searched = touchdown(body, SwingStretch(0.0, speed, 1e-300, 0.0), 1.0)
    closed = touchdown(body, SwingStretch(0.0, speed, 0.0, 0.0), 1.0)
    assert searched[0] == pytest.approx(closed[0], rel=1e-10)
    assert searched[1] == pytest.approx(closed[1], rel=1e-9)


@pytest.mark.slow
@given(ratio=st.floats(0.05, 3.0), preload=st.floats(0.1, 2.0), restitution=st.floats(0.0, 0.95))
@settings(max_examples=60, deadline=None)
def test_chatter_limit_of_small_bounces_is_the_geometric_series(ratio, preload, restitution):
    body = body_at(ratio, preload, restitution=restitution)
    speed = 1e-6 * body.k * body.rest_angle
    limit, moment = series_limit(body, SwingStretch(0.0, speed, 0.0, 0.0), speed, math.inf)
    pressing = body.k**2 * body.rest_angle
    assert limit == pytest.approx(2.0 * speed / (pressing * (1.0 - restitution)), rel=1e-9)
    assert moment == pytest.approx(body.inertia * speed * (1.0 + restitution) / (1.0 - restitution), rel=1e-9)


def test_chatter_limit_is_the_sum_of_the_bounces():
    body = body_at(0.3, 0.5)
    speed = 0.7
    direct = sum(2.0 / body.k * math.atan(speed * 0.4**n / (body.k * body.rest_angle)) for n in range(80))
    assert series_limit(body, SwingStretch(0.0, speed, 0.0, 0.0), speed, 1.0)[0] == pytest.approx(direct, rel=1e-12)


def test_without_preload_every_bounce_lasts_half_a_period_and_the_body_never_settles():
    body = body_at(7.3, 0.0)
    found = chain(body, 4)
    assert not any(ending.cause == SETTLED for _, ending in found)
    for piece, ending in found:
        if ending.cause == TOUCHDOWN and piece.angle == 0.0 and piece.loaded == 0 and piece.rate > 0.0:
            assert piece.end - piece.start == pytest.approx(math.pi / body.k, rel=1e-10)


@given(
    ratio=st.floats(0.05, 11.0),
    preload=st.floats(0.0, 1.1),
    restitution=st.floats(0.0, 0.85),
    damping=st.sampled_from([0.0, 0.0, 0.1]),
    impulse=st.sampled_from([0.0, 0.0, 0.02]),
    onset=st.floats(0.5, 0.95),
    form=st.sampled_from(["shifted", "printed"]),
)
@example(0.5, 0.0, 2.39e-182, 0.0, 0.0, 0.5, "shifted")  # thrown back by next to nothing, just before the load ends
@example(0.5, 0.0, 1e-11, 0.0, 0.0, 0.5, "shifted")
@example(6.0, 0.0, 0.03125, 0.0, 0.0, 0.75, "shifted")  # all but at rest when the load begins
@settings(max_examples=120, deadline=None)
def test_whatever_the_body_its_chain_is_ordered_and_stays_off_the_collar(
    ratio, preload, restitution, damping, impulse, onset, form
):
    body = body_at(
        ratio,
        preload,
        restitution=restitution,
        damping_ratio=damping,
        blow_impulse_nms=impulse,
        onset_fraction=onset,
        form=form,
        amplitude_nm=-60.0,
    )
    for piece, ending in chain(body, 5):
        assert 0.0 <= piece.start <= piece.end <= body.period * (1.0 + 1e-12)
        assert ending.impulse >= 0.0
        if ending.cause == TOUCHDOWN:
            assert ending.post == pytest.approx(-restitution * ending.pre, rel=1e-12, abs=1e-9)
        if piece.regime == CONTACT:
            continue
        # state_at clips rounding below the collar; the search must have left nothing else to clip
        for part in range(11):
            angle, _ = state_at(
                body._replace(one_sided=False), piece, piece.start + part / 10 * (piece.end - piece.start)
            )
            assert angle >= -1e-12 * max(1.0, body.rest_angle)


@given(ratio=st.floats(0.05, 11.0), preload=st.floats(0.05, 0.95), restitution=st.floats(0.0, 0.85))
@settings(max_examples=60, deadline=None)
def test_energy_never_grows_in_contact_without_load(ratio, preload, restitution):
    body = body_at(ratio, preload, restitution=restitution)
    energy = math.inf
    for piece, _ in chain(body, 3):
        if piece.loaded == 1 or piece.regime == SETTLING:
            energy = math.inf
            continue
        now = piece.rate**2 + (body.k * (piece.angle + body.rest_angle)) ** 2
        assert now <= energy * (1.0 + 1e-12)
        energy = now


@pytest.mark.slow
def test_momentum_balance_closes_over_a_cycle():
    body = body_at(0.3, 0.4)
    found = [(piece, ending) for piece, ending in chain(body, 3) if piece.cycle == 2]
    impulse = body.radius * sum(ending.impulse for _, ending in found)
    lift = next(piece.end for piece, ending in found if CAUSES[ending.cause] == "lift_off")
    settled = next(piece.end for piece, ending in found if ending.cause == SETTLED)
    steps = 40_000
    spring = 0.0
    for piece, _ in found:
        if piece.regime != CONTACT:
            width = (piece.end - piece.start) / steps
            angles = [state_at(body, piece, piece.start + (n + 0.5) * width)[0] for n in range(steps)]
            spring += width * sum(body.rate * (body.arm * angle + body.deflection) * body.arm for angle in angles)
    pulse = body.amplitude / body.mu * (math.cos(body.mu * (lift - body.onset)) + 1.0)
    assert 0.0 < settled < lift
    assert impulse == pytest.approx(spring - pulse, rel=1e-7)


def test_blow_impulse_throws_a_resting_body_up():
    body = body_at(0.3, 2.0, blow_impulse_nms=0.07)
    found = chain(body, 2)
    blow = next(ending for _, ending in found if ending.cause == BLOW)
    assert blow.post - blow.pre == pytest.approx(body.radius * 0.07 / body.inertia)
    first = next(ending for piece, ending in found if ending.cause == TOUCHDOWN)
    assert -first.pre == pytest.approx(blow.post, rel=1e-12)


def test_tail_of_a_series_settles_at_the_same_time_followed_one_by_one():
    body = body_at(0.3, 0.5)
    found = chain(body, 2)
    start = next(piece for piece, _ in found if piece.regime == SETTLING)
    first = max(-ending.pre for piece, ending in found if ending.cause == TOUCHDOWN)
    assert body.radius * start.rate < TAIL_CUT * first
    middle = 0.5 * (start.start + start.end)
    bounce, _ = touchdown(body, SwingStretch(0.0, start.rate, 0.0, 0.0), 1.0)
    alone = planned_piece(body, 1, start.start, 0.0, start.rate, 1, 0, 0.0)
    assert state_at(body, start, start.start + 0.3 * bounce) == state_at(body, alone, start.start + 0.3 * bounce)
    assert state_at(body, start, middle)[0] >= 0.0


def test_a_damped_body_repeats_its_cycle():
    body = body_at(0.3, 0.3, damping_ratio=0.2)
    early, late = walked_cycle(body, 4), walked_cycle(body, 60)
    assert early.gap_at_blow_m > 0.0
    assert early == pytest.approx(late, rel=1e-9)
