# SPDX-License-Identifier: Apache-2.0
"""First estimates from events: exact on exact events, and missed and false ones are named, not averaged."""

from __future__ import annotations

import numpy as np
import pytest
from catalogue import built
from hypothesis import assume, given
from hypothesis import strategies as st

from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_events
from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.bounces import (
    period_from_times,
    restitution_from_flights,
    restitution_from_speeds,
)

restitutions = st.floats(0.3, 0.97)


def bounces(restitution: float, count: int, first_s: float = 0.6) -> Array:
    return np.cumsum([0.1, *(first_s * restitution ** np.arange(count))])


@given(restitutions, st.integers(3, 20), st.floats(1e-3, 10.0))
def test_flights_give_the_restitution_whatever_their_scale(restitution: float, count: int, first_s: float) -> None:
    found = restitution_from_flights(bounces(restitution, count, first_s))
    assert found.value == pytest.approx(restitution, rel=1e-9)
    assert (found.missed, found.false, found.used) == ((), (), count + 1)


@given(st.floats(0.7, 0.95), st.integers(2, 9), st.integers(0, 1000))
def test_a_missed_impact_is_named(restitution: float, lost: int, seed: int) -> None:
    times = bounces(restitution, 12) * (1.0 + 1e-4 * np.random.default_rng(seed).uniform(-1.0, 1.0, 13))
    found = restitution_from_flights(np.delete(times, lost))
    assert found.missed == (lost,)
    assert found.false == ()
    assert found.value == pytest.approx(restitution, rel=0.02)


@given(st.floats(0.7, 0.95), st.integers(2, 9), st.floats(0.1, 0.9), st.integers(0, 1000))
def test_a_false_impact_is_named(restitution: float, place: int, share: float, seed: int) -> None:
    times = bounces(restitution, 12) * (1.0 + 1e-4 * np.random.default_rng(seed).uniform(-1.0, 1.0, 13))
    extra = times[place] + share * (times[place + 1] - times[place])
    found = restitution_from_flights(np.insert(times, place + 1, extra))
    assert found.false == (place + 1,)
    assert found.missed == ()
    assert found.value == pytest.approx(restitution, rel=0.02)


@given(restitutions, st.lists(st.floats(0.1, 10.0), min_size=4, max_size=30), st.integers(0, 3))
def test_speeds_give_the_restitution_and_a_foreign_one_is_named(
    restitution: float, speeds: list[float], odd: int
) -> None:
    pre = np.array(speeds)
    post = -restitution * pre
    post[odd] *= 0.5
    found = restitution_from_speeds(pre, post)
    assert found.value == pytest.approx(restitution, rel=1e-12)
    assert found.false == (odd,)


@given(st.floats(0.01, 5.0), st.integers(6, 40), st.floats(-100.0, 100.0), st.integers(2, 4), st.floats(0.3, 0.7))
def test_the_period_is_found_over_missed_and_false_events(
    period: float, count: int, start: float, place: int, share: float
) -> None:
    times = start + period * np.arange(count)
    assert period_from_times(times).value == pytest.approx(period, rel=1e-9)
    lost = period_from_times(np.delete(times, place))
    assert (lost.missed, lost.value) == ((place,), pytest.approx(period, rel=1e-9))
    assume(count > 8)
    extra = period_from_times(np.insert(times, place + 1, times[place] + share * period))
    assert (extra.false, extra.value) == ((place + 1,), pytest.approx(period, rel=1e-9))


def test_the_twins_own_impacts_give_its_own_restitution() -> None:
    machine = built("impact_mass")
    events = [event for frame in frames(machine, 3.0) for event in frame_events(frame) if event.kind == "impact"]
    pre, post = (np.array([getattr(event, f"{side}_velocity_m_per_s") for event in events]) for side in ("pre", "post"))
    found = restitution_from_speeds(pre, post)
    assert found.used == len(events) > 20
    stated = machine.parameters.restitution  # type: ignore[attr-defined]
    assert found.value == pytest.approx(stated, rel=1e-9)


@pytest.mark.parametrize("times", [[0.0, 1.0], [0.0, 2.0, 1.0]])
def test_too_few_or_unordered_events_are_refused(times: list[float]) -> None:
    for estimate in (restitution_from_flights, period_from_times):
        with pytest.raises(ValueError, match="expected at least three"):
            estimate(np.array(times))


def test_impacts_without_a_speed_are_refused() -> None:
    with pytest.raises(ValueError, match="speed before"):
        restitution_from_speeds(np.zeros(3), np.ones(3))
