# SPDX-License-Identifier: Apache-2.0
"""At the edges of its ranges the impact mass is finite and balanced; what lies beyond is refused by its key."""

from __future__ import annotations

import pytest
from draws.outcomes import RAN, end_of_run

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.parameters.load import machine_parameters

MOST_STEPS = 500

EDGES = [
    {"restitution": 0.999999, "initial_position_m": -1e-12},
    {"restitution": 1e-6, "initial_position_m": 0.0},
    {"mass_kg": 1e-9, "phase1_force_n": 1e9, "phase2_force_n": -1e9},
    {"mass_kg": 1e7, "phase1_force_n": 1e-300, "phase2_force_n": 1e9, "initial_position_m": -1e-12},
    {"phase1_force_n": 0.0, "phase2_force_n": 0.0, "initial_velocity_m_per_s": 0.0},
    {"phase1_force_n": 0.0, "phase2_force_n": 0.0, "initial_position_m": 0.0, "initial_velocity_m_per_s": 1e4},
    {"period_s": 1e6, "phase1_duration_s": 1e-4, "initial_velocity_m_per_s": -1e4},
    {"chatter_cutoff": 1e-300, "restitution": 0.99999, "initial_position_m": -1e-9},
    {"stop_position_m": 1e4, "initial_position_m": -1e4, "contact_stiffness_n_per_m": 1e-9},
    {"supply.initial_fraction": 0.0, "initial_position_m": 0.0},
]


MANY_CYCLES = pytest.param(
    {"period_s": 1e-5, "phase1_duration_s": 9.9e-6, "restitution": 0.995, "initial_position_m": -1e-12},
    marks=pytest.mark.slow,
)


@pytest.mark.parametrize(
    "overrides", [*EDGES, MANY_CYCLES], ids=lambda overrides: ",".join(f"{k}={v}" for k, v in overrides.items())
)
def test_the_edges_of_the_ranges_are_finite_and_balanced(overrides):
    parameters = machine_parameters("impact_mass", overrides=overrides)
    end, told, _ = end_of_run("impact_mass", parameters, (1.0,), MOST_STEPS)
    assert end == RAN, told


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"restitution": 0.9999999}, "restitution"),
        ({"restitution": 1e-7}, "restitution"),
        ({"period_s": 1e6, "phase1_duration_s": 1e-9}, "phase1_duration_s"),
        ({"mass_kg": 1e-10}, "mass_kg"),
        ({"phase1_force_n": 2e9}, "phase1_force_n"),
        ({"contact_stiffness_n_per_m": 0.0}, "contact_stiffness_n_per_m"),
        ({"period_s": 1e-6, "phase1_duration_s": 5e-7}, "coupling.step_s <= 100 period_s"),
    ],
)
def test_what_lies_outside_a_range_is_refused_by_its_key(overrides, words):
    with pytest.raises(ConfigurationError, match=words) as told:
        machine_parameters("impact_mass", overrides=overrides)
    assert "\n" not in str(told.value)
