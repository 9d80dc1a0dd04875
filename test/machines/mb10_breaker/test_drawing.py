# SPDX-License-Identifier: Apache-2.0
"""The drawing keeps the lengths of the links, the tool's line and the body's turn."""

import math

import pytest

from mech_twin.machines.mb10_breaker.drawing import drawing
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parameters.load import machine

TWIN = machine("mb10_breaker")
LINKAGE = TWIN.parameters.linkage


def drawn(crank_rad, phi):
    start = TWIN.linkage.start()
    names = list(start.joints)
    b = breaker(TWIN.parameters)
    turned = machine("mb10_breaker", overrides={"linkage.initial_crank_deg": math.degrees(crank_rad)}).linkage.start()
    place = list(turned.position)
    place[names.index("body")] = phi
    sample = turned._replace(position=tuple(place))
    return {shape.name: shape for shape in drawing(b, LINKAGE.striker_angle_deg)(sample, None)}


@pytest.mark.parametrize("crank_rad", [0.2, 2.0, 4.0])
@pytest.mark.parametrize("phi", [0.0, 0.05])
def test_links_have_their_lengths_wherever_the_body_is(crank_rad, phi):
    shapes = drawn(crank_rad, phi)
    assert math.dist(*shapes["crank"].points_m) == pytest.approx(LINKAGE.crank_m, abs=1e-12)
    assert math.dist(*shapes["coupler"].points_m) == pytest.approx(LINKAGE.coupler_m, abs=1e-12)
    pin, bearing, tip = shapes["rocker"].points_m
    assert math.dist(pin, bearing) == pytest.approx(LINKAGE.rocker_m, abs=1e-12)
    assert math.dist(bearing, tip) == pytest.approx(LINKAGE.striker_arm_m, abs=1e-12)
    assert math.hypot(*bearing) == pytest.approx(LINKAGE.ground_m, abs=1e-12)


def test_a_lifted_body_is_turned_clockwise_and_the_tool_stays():
    rest, lifted = drawn(1.0, 0.0), drawn(1.0, 0.05)
    angle = [math.atan2(*reversed(shapes["rocker"].points_m[1])) for shapes in (rest, lifted)]
    assert angle[1] - angle[0] == pytest.approx(-0.05, abs=1e-12)
    assert rest["tool"] == lifted["tool"]


def test_the_tool_lies_on_a_line_at_its_radius_from_the_crank_axis():
    (x, y), (far_x, far_y) = drawn(1.0, 0.0)["tool"].points_m
    length = math.hypot(far_x - x, far_y - y)
    across = (x * (far_y - y) - y * (far_x - x)) / length
    assert abs(across) == pytest.approx(TWIN.parameters.body.tool_radius_m, abs=1e-12)
