# SPDX-License-Identifier: Apache-2.0
"""Coulomb and viscous friction: it takes energy, sticks within its limit and lets go just above it."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parameter_bounds import has_range, live_names

from mech_twin.parts.friction_and_gear import Friction, release_margin, released, sliding_torque

torques = st.floats(0.0, 1e4)
speeds = st.floats(-1e3, 1e3)


@settings(deadline=None)
@given(torques, torques, speeds)
def test_sliding_friction_takes_energy(coulomb, viscous, speed):
    torque = sliding_torque(coulomb, viscous, speed, math.copysign(1.0, speed))
    assert torque * speed == pytest.approx(-coulomb * abs(speed) - viscous * speed * speed, rel=1e-12)
    assert torque * speed <= 0.0


@settings(deadline=None)
@given(torques, st.floats(-2e4, 2e4))
def test_a_joint_at_rest_sticks_within_the_coulomb_torque_and_starts_towards_the_load(coulomb, driving):
    sense = released(coulomb, driving)
    if abs(driving) <= coulomb:
        assert sense == 0.0
        assert release_margin(coulomb, driving) >= 0.0
    else:
        assert sense == math.copysign(1.0, driving)
        assert (driving + sliding_torque(coulomb, 0.0, 0.0, sense)) * sense > 0.0


def test_a_flywheel_slows_at_the_constant_rate_of_coulomb_friction():
    """I w' = -c from w0: rest after I w0/c, by steps of any integrator that is exact for a constant torque."""
    inertia, coulomb, w, h = 2.0, 3.0, 6.0, 0.5
    for _ in range(8):
        w += h * sliding_torque(coulomb, 0.0, w, 1.0) / inertia
    assert w == pytest.approx(0.0, abs=1e-12)
    assert released(coulomb, 0.0) == 0.0


def test_friction_never_drives_and_is_absent_unless_given():
    assert (Friction().coulomb_nm, Friction().viscous_nms_per_rad) == (0.0, 0.0)
    for key in ("coulomb_nm", "viscous_nms_per_rad"):
        assert has_range(Friction, {}, key, 0.0, 1e9)
    assert live_names(Friction) == {"coulomb_nm", "viscous_nms_per_rad"}
