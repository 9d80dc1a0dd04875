# SPDX-License-Identifier: Apache-2.0
"""Lastochkin et al. 2024: masses, peaks and what the print allows."""

from math import cos, inf, pi, sin

import numpy as np
import pytest

from mech_twin.machines.vibration_crank.metrics import (
    benefit_against_speed,
    compromise_rod,
    lanchester_metrics,
    polar_diagram,
)
from mech_twin.parameters.load import machine

HARMONIC = {"rod_m": inf}


def test_masses_of_the_print():
    printed = machine("vibration_crank").report()
    assert printed["reciprocating_mass_kg"] == pytest.approx(126.75, abs=1e-9)
    assert printed["rotating_mass_kg"] == 7.55
    assert printed["rotating_mass_from_parts_kg"] == pytest.approx(8.55, abs=1e-9)
    assert printed["counterweight_mass_derived_kg"] == pytest.approx(51.066, abs=1e-9)
    assert printed["counterweight_volume_m3"] == pytest.approx(51.11 / 7850.0, rel=1e-9)


def test_masses_of_the_parts():
    tree = {"masses.rotating_kg": None, "counterweight.mass_kg": None}
    parts = machine("vibration_crank", overrides=tree).report()
    assert parts["counterweight_mass_kg"] == pytest.approx(51.786, abs=1e-9)
    assert parts["counterweight_volume_m3"] == pytest.approx(0.006597, abs=5e-7)


def test_peaks_with_an_infinite_rod():
    report = machine("vibration_crank", overrides=HARMONIC).report()
    assert report["drive_torque_peak_without_counterweight_nm"] == pytest.approx(371.796, abs=5e-4)
    assert report["drive_torque_peak_nm"] == pytest.approx(305.034, abs=5e-4)
    # M = C cos th - S sin 2 th: the positions of its extremes solve a quadratic in sin th
    r, w, g = 0.126, 5.0 * pi, 9.80665
    S = 0.5 * 126.75 * r * r * w * w
    for C, name in (
        (g * r * (126.75 + 7.55), "drive_torque_peak_without_counterweight_nm"),
        (g * r * (126.75 + 7.55 - 51.11 * 0.175 / r), "drive_torque_peak_nm"),
    ):
        # dM = -C s - 2 S (1 - 2 s^2) = 0
        roots = np.roots([4.0 * S, -C, -2.0 * S])
        exact = max(
            abs(sign * np.sqrt(1 - s * s) * (C - 2.0 * S * s)) for s in roots if abs(s) <= 1 for sign in (1, -1)
        )
        assert report[name] == pytest.approx(exact, rel=1e-9)


def test_published_peaks_exceed_what_a_counterweight_can_change():
    for overrides in ({}, HARMONIC):
        report = machine("vibration_crank", overrides=overrides).report()
        assert report["peak_difference_bound_nm"] == pytest.approx(51.11 * 9.80665 * 0.175, rel=1e-9)
        assert report["peak_difference_bound_nm"] == pytest.approx(87.71, abs=5e-3)
        assert report["peak_difference_published_nm"] == pytest.approx(103.873, abs=1e-9)
        assert report["published_peaks_possible_1"] == 0.0
        assert report["peak_difference_nm"] <= report["peak_difference_bound_nm"]
    drop = 1.0 - 331.931 / 435.804
    assert drop == pytest.approx(0.23835, abs=5e-6)


def test_best_compromise_of_the_two_peaks():
    rod, without, with_it, error = compromise_rod(machine("vibration_crank").parameters)
    assert rod == pytest.approx(0.295295, abs=5e-7)
    assert without == pytest.approx(425.878, abs=5e-4)
    assert with_it == pytest.approx(339.491, abs=5e-4)
    assert error > 0.02


def test_benefit_falls_with_speed():
    harmonic = benefit_against_speed(machine("vibration_crank", overrides=HARMONIC).linkage.mechanism, (60.0, 300.0))
    assert harmonic[60.0] == pytest.approx(-0.437, abs=5e-4)
    assert harmonic[300.0] == pytest.approx(-0.057, abs=5e-4)
    finite = benefit_against_speed(machine("vibration_crank").linkage.mechanism, (300.0,))
    assert finite[300.0] == pytest.approx(0.045, abs=5e-4)


def test_residual_force_of_half_balance_is_a_circle_against_the_crank():
    parameters = machine("vibration_crank", overrides=HARMONIC).parameters
    r, w, m_s = 0.126, 5.0 * pi, 126.75
    for kappa, (x, y, _) in polar_diagram(parameters).items():
        angles = np.arange(360) * pi / 180.0
        assert x == pytest.approx(-kappa * m_s * r * w * w * np.cos(angles), abs=1e-9 * m_s * r * w * w)
        assert y == pytest.approx((1.0 - kappa) * m_s * r * w * w * np.sin(angles), abs=1e-9 * m_s * r * w * w)
    half = polar_diagram(parameters)[0.5]
    assert np.ptp(np.hypot(half[0], half[1])) < 1e-9 * m_s * r * w * w


def test_lanchester_masses_cancel_first_and_second_harmonic():
    mechanism = machine("vibration_crank").linkage.mechanism
    figures = lanchester_metrics(mechanism, 5.0 * pi)
    first = 126.75 * 0.126 * (5.0 * pi) ** 2
    assert figures["counter_rotating_force_n"] == pytest.approx(0.5 * first, rel=2e-3)
    lam = 0.25  # series of the slider: second harmonic lambda + lambda^3/4 + 15 lambda^5/128
    assert figures["second_harmonic_force_n"] == pytest.approx(first * (lam + lam**3 / 4 + 15 * lam**5 / 128), rel=1e-4)
    assert figures["shaking_force_max_after_pair_n"] < 0.1 * figures["shaking_force_max_after_counter_mass_n"]
    rest = figures["fourth_harmonic_force_n"] + figures["sixth_harmonic_force_n"] + figures["forward_rotating_force_n"]
    # what stays is harmonics 4, 6, ... and the print's rounding of the counterweight; they need not peak together
    assert 0.9 * rest < figures["shaking_force_max_after_pair_n"] < 1.001 * rest


def test_moment_of_the_page_for_a_finite_rod():
    crank = machine("vibration_crank", overrides={"offset_m": 0.03, "working_force_n": 200.0})
    r, L, e, w, g, m_s = 0.126, 0.504, 0.03, 5.0 * pi, 9.80665, 126.75
    for th in np.linspace(0.1, 6.2, 17):
        q, root = r * cos(th) - e, np.sqrt(L**2 - (r * cos(th) - e) ** 2)
        y1 = r * cos(th) + q * r * sin(th) / root
        y2 = -r * sin(th) + (q * r * cos(th) - r**2 * sin(th) ** 2) / root - (q * r * sin(th)) ** 2 / root**3
        M = m_s * (w**2 * y1 * y2 + g * y1) + (7.55 * r - 51.11 * 0.175) * g * cos(th) + 200.0 * y1
        assert crank.analyse(th)["drive_torque_nm"] == pytest.approx(M, abs=1e-9 * 300.0)
