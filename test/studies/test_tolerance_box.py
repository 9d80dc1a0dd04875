# SPDX-License-Identifier: Apache-2.0
"""The box of tolerances: its inside, neighbouring corners, and a configuration scaled and validated."""

import pytest
from pydantic import ValidationError

from mech_twin.capabilities.variation import inner_points, neighbours, scaled
from mech_twin.parameters.load import machine_parameters

KEYS = ("body.restitution", "tool.mass_kg", "body.inertia_kg_m2")


def test_points_of_a_box_are_within_and_repeat_by_their_seed():
    inner = list(inner_points(KEYS, 0.05, 50))
    assert inner == list(inner_points(KEYS, 0.05, 50))
    assert all(abs(factor - 1.0) <= 0.05 for point in inner for factor in point.values())
    assert inner != list(inner_points(KEYS, 0.05, 50, seed=2))


def test_neighbours_of_a_corner_differ_in_one_number():
    corner = dict.fromkeys(KEYS, 1.05)
    found = list(neighbours(corner, 0.05))
    assert [sum(point[key] != corner[key] for key in KEYS) for point in found] == [1, 1, 1]


def test_scaled_numbers_are_validated():
    parameters = machine_parameters("mb10_breaker")
    found = scaled(parameters, {"tool.mass_kg": 1.05})
    assert found.tool.mass_kg == pytest.approx(10.5)
    assert found.body == parameters.body
    with pytest.raises(ValidationError, match="less than or equal to 0"):
        scaled(parameters, {"body.restitution": 2.6})
