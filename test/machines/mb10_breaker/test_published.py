# SPDX-License-Identifier: Apache-2.0
"""Rows of the comparison: each holds, each compares the twin with a number from elsewhere, and each can fail."""

import pytest

from mech_twin.capabilities.variation import varied
from mech_twin.machines.mb10_breaker import published
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.parameters.load import machine_parameters

PARAMETERS = machine_parameters("mb10_breaker")


def body_rows(parameters):
    changed = published.paper_body(parameters)
    body = pressed_body(changed.body, changed.excitation)
    return [*published.load_rows(body), *published._swing(body), *published._collar(changed, body)]


def test_the_body_s_rows_hold():
    rows = body_rows(PARAMETERS)
    assert len(rows) >= 20
    assert all(row.holds for row in rows)


@pytest.mark.parametrize(
    ("key", "value", "quantity"),
    [
        ("excitation.amplitude_nm", 61.0, "largest pressing force, N"),
        ("body.restitution", 0.42, "least p, settled before t1"),
        ("body.tool_radius_m", 0.26, "return speed, m/s"),
        ("excitation.blow_rate_hz", 10.1, "spring rate, kN/m"),
    ],
)
def test_a_row_fails_where_the_machine_is_another(key, value, quantity):
    failed = {row.quantity for row in body_rows(varied(PARAMETERS, {key: value})) if not row.holds}
    assert quantity in failed


@pytest.mark.slow
def test_published_values_are_numbers_of_their_own():
    """A change of the configuration changes what is computed, never what is published."""
    other = varied(PARAMETERS, {"motor.starting_torque_ratio": 1.9, "excitation.amplitude_nm": 55.0})
    for row, changed in zip(
        (*body_rows(PARAMETERS), *published._motor(PARAMETERS)),
        (*body_rows(other), *published._motor(other)),
        strict=True,
    ):
        assert row.published == changed.published
