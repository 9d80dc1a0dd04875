# SPDX-License-Identifier: Apache-2.0
"""The two-level force: its mean, its phases, and how it reaches the mass."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parameter_bounds import accepts, live_names

from mech_twin.engine.run import frames
from mech_twin.machines.impact_mass.dynamics import impact_system, mean_acceleration
from mech_twin.machines.impact_mass.parameters import GeneratorParameters
from mech_twin.parameters.load import machine

levels = st.floats(-1e6, 1e6)


@settings(deadline=None)
@given(st.floats(1e-3, 10.0), st.floats(0.01, 0.99), levels, levels)
def test_the_mean_level_is_the_impulse_of_a_period_over_the_period(period, share, level1, level2):
    t1 = share * period
    parts = 1000  # the level at the middle of each of so many slices
    impulse = sum((level1 if (i + 0.5) * period / parts < t1 else level2) * period / parts for i in range(parts))
    slack = abs(level1 - level2) / parts + 1e-9 * (abs(level1) + abs(level2)) + 1e-300
    assert mean_acceleration(impact_system((period, t1), (level1, level2), 0.5, 0.0)) == pytest.approx(
        impulse / period, abs=slack
    )


@settings(deadline=None)
@given(st.floats(1e-3, 10.0), st.floats(0.01, 0.99), levels)
def test_equal_levels_are_their_own_mean(period, share, level):
    assert mean_acceleration(impact_system((period, share * period), (level, level), 0.5, 0.0)) == pytest.approx(
        level, rel=1e-12, abs=1e-12
    )


@pytest.mark.parametrize("t1", [0.0, 0.05, 0.06, -0.01])
def test_a_first_phase_outside_the_period_is_refused_with_its_numbers(t1):
    with pytest.raises(ValueError, match=rf"0 < phase1_duration_s < period_s .*{t1!r}.*0\.05"):
        GeneratorParameters(period_s=0.05, phase1_duration_s=t1, phase1_force_n=1.0, phase2_force_n=0.0)


def test_the_generator_shows_the_level_of_its_phase_and_a_change_belongs_to_the_phase_that_ends():
    run = list(frames(machine("impact_mass", overrides={"coupling.step_s": 0.003}), 0.294))
    for frame in run[1:]:
        now, level1, level2 = frame.motor.effort
        assert (level1, level2) == (1000.0, -500.0)
        tau = frame.linkage.time_s % 0.05
        if min(abs(tau - 0.035), tau, 0.05 - tau) > 1e-9:
            assert now == (level1 if tau < 0.035 else level2)
    changes = [e.time_s for f in run for e in f.linkage.events if e.kind == "phase"]
    expected = [n * 0.05 + t for n in range(6) for t in (0.035, 0.05)][:11]
    assert changes == pytest.approx(expected, rel=1e-12)


def test_the_command_multiplies_both_levels():
    twin = machine("impact_mass", overrides={"supply.rate_per_s": 1e6})
    run = list(frames(twin, 0.1, lambda step: 0.25))
    assert {frame.motor.effort[1:] for frame in run[1:]} == {(250.0, -125.0)}


def test_the_levels_alone_may_change_while_the_force_is_generated():
    assert live_names(GeneratorParameters) == {"phase1_force_n", "phase2_force_n"}


def test_a_period_is_longer_than_zero():
    valid = {"period_s": 0.05, "phase1_duration_s": 1e-10, "phase1_force_n": 1.0, "phase2_force_n": 0.0}
    assert accepts(GeneratorParameters, valid, "period_s", 1e-9)
    assert not accepts(GeneratorParameters, valid, "period_s", 0.0)
