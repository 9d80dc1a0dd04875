# SPDX-License-Identifier: Apache-2.0
"""The longest coupling step of a breaker: every residual holds at it, and a longer one is refused in one line."""

import math

import numpy as np
import pytest
from machines.mb10_breaker.test_reference import drawn

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.errors import MotionError
from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.constants import breaker, coupling_limits, longest_step_s
from mech_twin.machines.mb10_breaker.parameters import LONGEST_TURN_RAD, shaft_time_s
from mech_twin.machines.mb10_breaker.pressed_body import flight
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.step import FAILURES
from mech_twin.parameters.load import machine, machine_parameters

LIGHT = {"linkage.crank_inertia_kg_m2": 0.003}
SHORT_S = 1e-4


def longest_s(overrides):
    """Return the longest step, by the numbers of the motor's name plate (Kloss) and of crank and rotor."""
    p = machine_parameters("mb10_breaker", overrides={**overrides, "coupling.step_s": SHORT_S})
    synchronous = p.motor.synchronous_speed_rpm * math.pi / 30.0
    turning = LONGEST_TURN_RAD * p.gear.ratio / synchronous
    return min(turning, 0.5 * shaft_time_s(p))


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
    [{}, LIGHT, {**LIGHT, "drive_mount": "body"}, {**LIGHT, "excitation.kind": "approximated"}, {"gear.ratio": 2.0}],
    ids=["configured", "light crank", "on the body", "held", "fast"],
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


LIGHT_BODIES = [0.001, 0.01, 0.1]


def light(inertia, share, **more):
    """Return a breaker with a light body at a share of the longest step it allows (s)."""
    overrides = {"body.inertia_kg_m2": inertia, **more}
    p = machine_parameters("mb10_breaker", overrides={**overrides, "coupling.step_s": SHORT_S})
    return overrides, share * longest_step_s(breaker(p), p.synchronous_crank_rad_per_s)


@pytest.mark.parametrize("inertia", LIGHT_BODIES)
@pytest.mark.parametrize("mount", ["frame", "body"])
def test_residuals_of_a_light_body_hold_at_its_longest_step(inertia, mount):
    overrides, step_s = light(inertia, 0.9999, drive_mount=mount)
    assert broken({**overrides, "coupling.step_s": min(step_s, longest_s(overrides))}, 0.8) == {}


def test_step_too_long_for_a_light_body_is_refused_in_one_line():
    overrides, step_s = light(0.01, 1.0001)
    with pytest.raises(ConfigurationError, match=r"at most .* s with body.inertia_kg_m2 0.01: ") as refused:
        machine("mb10_breaker", overrides={**overrides, "coupling.step_s": step_s})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("inertia", [6.0, *LIGHT_BODIES])
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_line_of_the_moment_costs_the_body_s_rate_what_its_curvature_says(inertia, share):
    """M2 h^3/(12 J) within a factor of 3 for bodies from 1 g m2 to 6 kg m2, over the last tenth of a second."""
    overrides, step_s = light(inertia, share)
    step_s = min(step_s, 0.9 * longest_s(overrides))
    p = machine_parameters("mb10_breaker", overrides={**overrides, "coupling.step_s": step_s})
    missed = coupling_limits(breaker(p), p.synchronous_crank_rad_per_s, step_s).missed_rad_per_s
    run = [f.body for f in frames(build(p), 0.8) if f.linkage.time_s > 0.5]
    found = max(abs(sample.residuals["rate_difference_rad_per_s"]) for sample in run)
    assert missed / 3.0 <= found <= 3.0 * missed


def largest_root(share):
    """Return the largest |z| of w_n = z^n under the extrapolated torque, the step a share of the shaft's time."""
    return np.abs(np.roots([1.0, 2.0 * share - 1.0, -1.5 * share, 0.5 * share])).max()


def test_extrapolated_torque_is_stable_to_half_the_shaft_s_time():
    assert largest_root(0.499) < 1.0 < largest_root(0.501)


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
