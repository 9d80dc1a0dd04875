# SPDX-License-Identifier: Apache-2.0
"""Any legal body under the half sine runs: finite, within its residuals, in time; the rest is refused in one line."""

import math

import pytest
from machines.mb10_breaker.half_sine_draws import USUAL, configuration, trouble

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.machines.mb10_breaker.pressed_body.parameters import BodyParameters, ExcitationParameters
from mech_twin.parameters.load import machine_parameters


def usual(**changed):
    values = USUAL | changed
    body = {name: values[name] for name in USUAL if name in BodyParameters.model_fields}
    excitation = {name: values[name] for name in USUAL if name in ExcitationParameters.model_fields}
    return BodyParameters(**body), ExcitationParameters(kind="approximated", **excitation)


@pytest.mark.timeout(120)
def test_random_legal_bodies_run():
    drawn = [found for seed in range(120) if (found := configuration(seed)) is not None]
    assert len(drawn) > 40
    for body, excitation in drawn:
        assert trouble(body, excitation) == [], (body, excitation)


@pytest.mark.parametrize("seed", [151, 212, 274, 350, 415, 463, 524])
def test_bodies_that_once_had_no_end_run(seed):
    """Stiff, damped bodies that follow a slow load: the search's bounds were too wide, or the response overflowed."""
    assert trouble(*configuration(seed)) == []


@pytest.mark.timeout(60)
@pytest.mark.parametrize("inertia", [0.35, 6.0])
def test_a_stiff_spring_hardly_deflected_does_not_hang(inertia):
    body, excitation = usual(inertia_kg_m2=inertia, spring_rate_n_per_m=1e9, preload_deflection_m=1e-7)
    assert trouble(body, excitation, 1.0) == []


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("body.spring_rate_n_per_m", 9.9e9, r"body\.spring_rate_n_per_m must be at most"),
        ("body.restitution", 0.999, r"body\.restitution"),
        ("body.damping_ratio", 0.999, r"body\.damping_ratio"),
        ("excitation.blow_rate_hz", 1e3, r"excitation\.blow_rate_hz"),
        ("excitation.onset_fraction", 0.9999, r"excitation\.onset_fraction"),
        ("body.inertia_kg_m2", 1e-9, r"body\.inertia_kg_m2"),
    ],
)
def test_what_is_beyond_the_range_is_refused_by_name(key, value, words):
    overrides = {"excitation.kind": "approximated", "body.inertia_kg_m2": 0.01, "excitation.frequency_ratio": None}
    with pytest.raises(ConfigurationError, match=words):
        machine_parameters("mb10_breaker", overrides=overrides | {key: value})
    assert math.isfinite(value)
