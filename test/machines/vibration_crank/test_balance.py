# SPDX-License-Identifier: Apache-2.0
"""Balance of the vibration crank: the force on the frame by momentum, a boom's load by its arm."""

from __future__ import annotations

import pytest
from crank_drives import BOOM

from mech_twin.machines.vibration_crank.slider_crank import follower, pin_forces
from mech_twin.parameters.load import machine


def momentum_point(s, th):
    """Return the sum of mass times place (kg m) of crank pin, counterweight and follower, from places alone."""
    from math import cos, sin

    at = follower(s, th)
    turning = s.rotating_mass * s.crank_m - s.counter_mass * s.counter_m
    x, y = turning * cos(th), turning * sin(th)
    for mass, arm in ((s.joint_mass, 1.0), (s.load_mass, s.load_ratio)):
        if s.kind == 2:
            x += mass * (s.pivot_x_m + arm * (at.x - s.pivot_x_m))
            y += mass * (s.pivot_y_m + arm * (at.y - s.pivot_y_m))
        else:
            x, y = x + mass * at.x, y + mass * at.y
    return x, y


@pytest.mark.parametrize("overrides", [{}, {"offset_m": 0.03, "slider": "below"}, BOOM], ids=["above", "below", "boom"])
def test_the_force_on_the_frame_is_the_rate_of_momentum(overrides):
    """Second differences of the places of all masses, sixth order; nothing of the pin forces enters."""
    s = machine("vibration_crank", overrides=overrides).linkage.mechanism
    h, weights = 0.02, (2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0)
    w = 12.0
    for th in (0.3, 1.7, 4.4):
        points = [momentum_point(s, th + i * h) for i in range(-3, 4)]
        expected = [
            -w * w * sum(c * p[k] for c, p in zip(weights, points, strict=True)) / (180.0 * h * h) for k in (0, 1)
        ]
        found = pin_forces(s, th, w, 0.0)
        assert (found.frame_x, found.frame_y) == pytest.approx(expected, rel=1e-6, abs=1e-3)


def test_a_load_beyond_the_joint_is_balanced_with_its_arm():
    """Its inertia force at the rod's joint has its arm kb: m_p = (m_r + kappa (m_j + kb m_t)) r/r_p."""
    crank = machine("vibration_crank", overrides={**BOOM, "counterweight.mass_kg": None})
    expected = (7.55 + 0.5 * (16.7 + 1.55 + 8.0 + 1.3 * 100.5)) * 0.126 / 0.175
    assert crank.report()["counterweight_mass_kg"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"rod_m": 0.12601}, "degree off the square"),
        (
            {**BOOM, "rod_m": 1.12, "boom.pivot_x_m": -2.19395, "boom.pivot_y_m": 0.0},
            "transmission angle of rod_m and boom.length_m",
        ),
        ({f"masses.{name}_kg": 0.0 for name in ("tree", "stand", "boom", "rod", "extra")}, "reciprocating mass"),
    ],
)
def test_a_crank_that_cannot_be_computed_is_refused_in_one_line(overrides, words):
    from mech_twin.declarations.configuration_tree import ConfigurationError

    with pytest.raises(ConfigurationError, match=words) as refused:
        machine("vibration_crank", overrides=overrides)
    assert "\n" not in str(refused.value)
