# SPDX-License-Identifier: Apache-2.0
"""Coulomb and viscous friction: it takes energy, and never drives."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parameter_bounds import has_range, live_names

from mech_twin.parts.friction_and_gear import Friction, sliding_torque

torques = st.floats(0.0, 1e4)
speeds = st.floats(-1e3, 1e3)


@settings(deadline=None)
@given(torques, torques, speeds)
def test_sliding_friction_takes_energy(coulomb, viscous, speed):
    torque = sliding_torque(coulomb, viscous, speed, math.copysign(1.0, speed))
    assert torque * speed == pytest.approx(-coulomb * abs(speed) - viscous * speed * speed, rel=1e-12)
    assert torque * speed <= 0.0


def test_a_flywheel_slows_at_the_constant_rate_of_coulomb_friction():
    """I w' = -c from w0: rest after I w0/c, by steps of any integrator that is exact for a constant torque."""
    inertia, coulomb, w, h = 2.0, 3.0, 6.0, 0.5
    for _ in range(8):
        w += h * sliding_torque(coulomb, 0.0, w, 1.0) / inertia
    assert w == pytest.approx(0.0, abs=1e-12)


def test_friction_never_drives_and_is_absent_unless_given():
    assert (Friction().coulomb_nm, Friction().viscous_nms_per_rad) == (0.0, 0.0)
    for key in ("coulomb_nm", "viscous_nms_per_rad"):
        assert has_range(Friction, {}, key, 0.0, 1e9)
    assert live_names(Friction) == {"coulomb_nm", "viscous_nms_per_rad"}
