# SPDX-License-Identifier: Apache-2.0
"""The longest coupling step of a breaker: every residual holds at it, and a longer one is refused in one line."""

import math

import numpy as np
import pytest
from machines.mb10_breaker.test_reference import drawn

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.errors import MotionError
from mech_twin.machines.drives import MOST_STIFFNESS
from mech_twin.machines.mb10_breaker.parameters import LONGEST_TURN_RAD, shaft_time_s
from mech_twin.machines.mb10_breaker.pressed_body import flight
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.step import FAILURES
from mech_twin.parameters.load import machine, machine_parameters

LIGHT = {"linkage.crank_inertia_kg_m2": 0.003}
STIFF = {
    "linkage.crank_inertia_kg_m2": 1e-9,
    "motor.rotor_inertia_kg_m2": 2e-7,
    "linkage.coupler_mass_kg": 1e-3,
    "linkage.rocker_mass_kg": 1e-3,
    "linkage.rocker_inertia_kg_m2": 1e-4,
    "linkage.coupler_inertia_kg_m2": 1e-4,
    "tool.wall_force_n": 100.0,
}
SHORT_S = 2e-5


def longest_s(overrides):
    """Return the longest step, by the numbers of the motor's name plate (Kloss) and of crank and rotor."""
    p = machine_parameters("mb10_breaker", overrides={**overrides, "coupling.step_s": SHORT_S})
    synchronous = p.motor.synchronous_speed_rpm * math.pi / 30.0
    turning = LONGEST_TURN_RAD * p.gear.ratio / synchronous
    return min(turning, MOST_STIFFNESS * shaft_time_s(p))


def broken(overrides, duration_s=1.5):
    """Return the residuals beyond their limits in a run."""
    twin = machine("mb10_breaker", overrides=overrides)
    parts, worst = (twin.linkage, twin.forces, twin.body), {}
    limits = {name: limit for role in parts for name, limit in role.residual_limits.items()}
    for frame in frames(twin, duration_s):
        for sample in (frame.linkage, frame.forces, frame.body):
            for name, value in zip(sample.residuals.names, sample.residuals.values, strict=True):
                worst[name] = max(worst.get(name, 0.0), abs(value))
    return {name: value for name, value in worst.items() if not value <= limits[name]}


@pytest.mark.parametrize(
    "overrides",
    [
        {},
        LIGHT,
        {**LIGHT, "drive_mount": "body"},
        {**LIGHT, "excitation.kind": "approximated"},
        {"gear.ratio": 2.0},
        STIFF,
    ],
    ids=["configured", "light crank", "on the body", "held", "fast", "stiff"],
)
def test_residuals_hold_at_the_longest_step(overrides):
    longest = longest_s(overrides)
    assert broken({**overrides, "coupling.step_s": 0.9999 * longest}) == {}
    with pytest.raises(ConfigurationError, match=r"coupling.step_s = .* s must be at most .* s: ") as refused:
        machine("mb10_breaker", overrides={**overrides, "coupling.step_s": 1.0001 * longest})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("seed", range(8))
def test_residuals_of_random_machines_hold_at_the_longest_step(seed):
    overrides = drawn(seed)
    assert broken({**overrides, "coupling.step_s": 0.9999 * longest_s(overrides)}, 0.8) == {}


@pytest.mark.parametrize("inertia", [0.001, 0.01, 0.1])
@pytest.mark.parametrize("mount", ["frame", "body"])
def test_residuals_of_a_light_body_hold_at_the_longest_step(inertia, mount):
    overrides = {"body.inertia_kg_m2": inertia, "drive_mount": mount}
    assert broken({**overrides, "coupling.step_s": 0.9999 * longest_s(overrides)}, 0.8) == {}


def test_step_that_fails_ends_in_one_line():
    linkage = machine("mb10_breaker").linkage
    for number in range(len(FAILURES)):
        told = str(linkage.failure(-1 - number, 0.5, np.empty((0, 0))))
        assert told.endswith("shorten coupling.step_s, in the step from 0.5 s")
        assert "\n" not in told


def test_endless_search_ends_in_one_line(monkeypatch):
    p = machine_parameters("mb10_breaker")
    body = pressed_body(p.body, p.excitation)
    monkeypatch.setattr(flight, "LONGEST_SEARCH", 0)
    search = getattr(flight.first_root, "py_func", flight.first_root)
    with pytest.raises(MotionError, match=r"lower body.spring_rate_n_per_m"):
        search(body, flight.SwingStretch(0.01, 0.0, 0.0, 0.0), 0, 0.0, 1.0)
