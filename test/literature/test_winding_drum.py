# SPDX-License-Identifier: Apache-2.0
"""The fragment on the winding drum, formulas (23)-(25): what it says of the three components."""

from math import cos, pi, sin

import numpy as np
import pytest

from mech_twin.parameters.load import machine


def test_terms_are_those_of_the_formula():
    drum = machine("winding_drum")
    R, e, L, theta, a, H, density = 0.3, 0.004, 0.0006 / (2.0 * pi), 5.0, 0.4, 1.2, 450.0
    J0 = 0.5 + 0.5 * pi * density * H * (R**4 - 0.08**4)
    for phi in (0.0, 0.7, 2.0, 4.0):
        rho = R + e * cos(phi)
        got = drum.analyse(phi)
        assert got["acceleration_torque_nm"] == pytest.approx(J0 * a / rho, rel=1e-12)
        assert got["radius_torque_nm"] == pytest.approx(J0 * theta**2 * L / (rho**2 * R), rel=1e-12)
        assert got["eccentric_torque_nm"] == pytest.approx(J0 * theta**2 * e * sin(phi) / rho**3, rel=1e-12)
        assert got["mass_torque_nm"] == pytest.approx(-pi * H * density * theta**2 * L * R**2 / rho, rel=1e-12)


def test_third_component_is_nearly_harmonic_and_changes_sign_twice_a_turn():
    drum = machine("winding_drum")
    turn = [drum.analyse(2.0 * pi * i / 720) for i in range(720)]
    eccentric = np.array([at["eccentric_torque_nm"] for at in turn])
    lines = np.abs(np.fft.rfft(eccentric)) / 360.0
    assert lines[2:].max() < 0.03 * lines[1]
    report = drum.report()
    assert report["eccentric_torque_sign_changes_per_turn"] == 2.0
    assert report["ideal_terms_sign_changes_per_turn"] == 0.0


def test_ideal_package_has_no_third_component():
    ideal = machine("winding_drum", overrides={"eccentricity_m": 0.0})
    for phi in (0.0, 1.0, 2.0):
        at = ideal.analyse(phi)
        assert at["eccentric_torque_nm"] == 0.0
        assert at["dynamic_torque_nm"] == at["ideal_torque_nm"]
