# SPDX-License-Identifier: Apache-2.0
"""First estimates from events: exact on exact events, and missed and false ones are named, not averaged."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.bounces import restitution_from_flights

restitutions = st.floats(0.3, 0.97)


def bounces(restitution: float, count: int, first_s: float = 0.6) -> Array:
    return np.cumsum([0.1, *(first_s * restitution ** np.arange(count))])


@pytest.mark.slow
@given(restitutions, st.integers(3, 20), st.floats(1e-3, 10.0))
def test_flights_give_the_restitution_whatever_their_scale(restitution: float, count: int, first_s: float) -> None:
    found = restitution_from_flights(bounces(restitution, count, first_s))
    assert found.value == pytest.approx(restitution, rel=1e-9)
    assert (found.missed, found.false, found.used) == ((), (), count + 1)


@pytest.mark.slow
@given(st.floats(0.7, 0.95), st.integers(2, 9), st.integers(0, 1000))
def test_a_missed_impact_is_named(restitution: float, lost: int, seed: int) -> None:
    times = bounces(restitution, 12) * (1.0 + 1e-4 * np.random.default_rng(seed).uniform(-1.0, 1.0, 13))
    found = restitution_from_flights(np.delete(times, lost))
    assert found.missed == (lost,)
    assert found.false == ()
    assert found.value == pytest.approx(restitution, rel=0.02)


@pytest.mark.slow
@given(st.floats(0.7, 0.95), st.integers(2, 9), st.floats(0.1, 0.9), st.integers(0, 1000))
def test_a_false_impact_is_named(restitution: float, place: int, share: float, seed: int) -> None:
    times = bounces(restitution, 12) * (1.0 + 1e-4 * np.random.default_rng(seed).uniform(-1.0, 1.0, 13))
    extra = times[place] + share * (times[place + 1] - times[place])
    found = restitution_from_flights(np.insert(times, place + 1, extra))
    assert found.false == (place + 1,)
    assert found.missed == ()
    assert found.value == pytest.approx(restitution, rel=0.02)


@pytest.mark.parametrize("times", [[0.0, 1.0], [0.0, 2.0, 1.0]])
def test_too_few_or_unordered_events_are_refused(times: list[float]) -> None:
    with pytest.raises(ValueError, match="expected at least three"):
        restitution_from_flights(np.array(times))
