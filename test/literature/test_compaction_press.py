# SPDX-License-Identifier: Apache-2.0
"""Asfandiyarov et al. 2019: what the paper claims, and the numbers of the assumed press behind it."""

from math import cos, degrees, pi, radians

import numpy as np
import pytest

from mech_twin.machines.compaction_press.cycle import POSITIONS, gains, press_cycle
from mech_twin.machines.compaction_press.metrics import conditions
from mech_twin.machines.compaction_press.parameters import press_constants
from mech_twin.machines.compaction_press.sizing import flywheel_run
from mech_twin.parameters.load import machine
from mech_twin.parts.four_bar import acute_angles, closure_error, coefficients, position


@pytest.fixture(scope="module")
def press():
    return machine("compaction_press")


@pytest.fixture(scope="module")
def report(press):
    return press.report()


def test_stroke_and_work(report):
    assert report["stroke_m"] == pytest.approx(0.060217832, abs=1e-9)
    assert report["top_deg"] == pytest.approx(93.33089, abs=1e-5)
    assert report["bottom_deg"] == pytest.approx(270.0, abs=1e-9)
    assert report["work_per_cycle_j"] == pytest.approx(150.544579, abs=1e-6)


def test_angles(report):
    assert report["gamma_max_deg"] == pytest.approx(13.85186, rel=1e-5)
    assert report["gamma_max_deg"] < 20.0
    assert report["transmission_angle_min_deg"] == pytest.approx(71.47, abs=5e-3)
    assert report["transmission_angle_max_deg"] == pytest.approx(97.23, abs=5e-3)
    assert report["crank_rocker_1"] == 1.0


def test_bottom_of_the_stroke_is_flat_and_square(press):
    at = press.analyse(radians(270.0))
    assert at["gamma_deg"] == pytest.approx(0.0, abs=1e-9)
    assert at["alpha_deg"] == pytest.approx(90.0, abs=1e-9)
    assert at["beta_deg"] == pytest.approx(90.0, abs=1e-9)


def test_moments_and_powers(report):
    assert report["drive_torque_mean_nm"] == pytest.approx(23.9599, rel=1e-5)
    assert report["drive_torque_peak_nm"] == pytest.approx(197.5977, rel=1e-5)
    assert report["drive_torque_min_nm"] == pytest.approx(-54.5294, rel=1e-5)
    assert report["power_mean_w"] == pytest.approx(752.7, abs=0.05)
    assert report["power_peak_w"] == pytest.approx(6208.0, abs=0.5)


def test_flywheel_variants(report):
    assert report["flywheel_inertia_kg_m2"] == pytest.approx(2.963918, rel=1e-6)
    # tangents to 36000 points of the diagram against extremes of the continuous curve
    assert report["flywheel_inertia_wittenbauer_kg_m2"] == pytest.approx(report["flywheel_inertia_kg_m2"], rel=1e-8)
    assert report["flywheel_inertia_textbook_kg_m2"] == pytest.approx(2.963325, rel=1e-6)
    assert report["flywheel_inertia_mertsalov_kg_m2"] == pytest.approx(3.085584, rel=1e-6)
    assert report["flywheel_inertia_12_positions_kg_m2"] == pytest.approx(2.9035, abs=5e-5)
    assert report["non_uniformity_without_flywheel"] == pytest.approx(1.505, abs=5e-4)


def test_time_run_with_the_flywheel_shows_the_asked_non_uniformity(press, report):
    run = flywheel_run(press.parameters, report["flywheel_inertia_kg_m2"])
    assert run.non_uniformity == pytest.approx(0.05, rel=1e-3)
    assert 0.5 * (run.speed_min_rad_per_s + run.speed_max_rad_per_s) == pytest.approx(10.0 * pi, rel=1e-5)
    assert abs(run.drift) < 1e-6
    # a flywheel for the textbook's formula shows the difference it should
    assert flywheel_run(press.parameters, 3.085584).non_uniformity < 0.0495


def test_gains_at_225_degrees(press):
    at = press.analyse(radians(225.0))
    assert at["k1_k2"] == pytest.approx(2.9143, abs=5e-5)
    assert at["gain_exact_normal"] == pytest.approx(2.6001, abs=5e-5)
    assert at["gain_exact_vertical"] == pytest.approx(2.4656, abs=5e-5)


def test_two_fold_gain_over_the_working_quarter(report):
    assert report["paper_gain_min_in_quarter"] >= 2.0
    assert report["vertical_gain_two_share_of_quarter"] == pytest.approx(0.733, abs=5e-4)
    assert report["vertical_gain_min_in_quarter"] == pytest.approx(1.9273, abs=5e-5)
    assert report["normal_gain_two_share_of_quarter"] == pytest.approx(0.910, abs=5e-4)
    assert report["normal_gain_min_in_quarter"] == pytest.approx(1.9891, abs=5e-5)


def test_normal_gain_is_the_formula_of_the_page(press):
    constants = press.linkage.mechanism
    r, R, share = 0.06, 0.3, 0.5
    for f in np.linspace(0.05, 6.2, 40):
        at = position(constants.bar, f)
        by = coefficients(at)
        alpha, beta, _ = acute_angles(at)
        normal = np.array([-at.u_y, at.u_x])
        a_side = np.sign(normal @ (-at.a_y, at.a_x))
        b_side = np.sign(normal @ (-at.v_y * by.g3, at.v_x * by.g3))
        ratio = share * cos(alpha) + (1.0 - share) * R * abs(by.g3) / r * cos(beta) * a_side * b_side
        assert 1.0 / gains(constants, f)[2] == pytest.approx(abs(ratio), abs=1e-12)


def test_conditions_of_the_paper_with_margins(press):
    gamma, alpha, flywheel = conditions(press.parameters)
    assert gamma.margin == pytest.approx(20.0 - 13.85186, abs=2e-4)
    assert gamma.holds
    assert alpha.value == pytest.approx(90.0, abs=1e-9)
    assert alpha.holds
    assert not flywheel.holds
    assert flywheel.margin == pytest.approx(-2.963918, rel=1e-6)


def test_loop_closes_on_every_position(press):
    bar = press.linkage.mechanism.bar
    assert max(closure_error(bar, position(bar, 2.0 * pi * i / 3600)) for i in range(3600)) < 1e-12


def test_mean_torque_is_the_work_of_the_layer_over_a_turn(press):
    constants, stroke = press_constants(press.parameters)
    cycle = press_cycle(constants, stroke, 10.0 * pi, POSITIONS, kinks=False)
    assert cycle.drive_torque_nm.mean() == pytest.approx(150.544579 / (2.0 * pi), rel=1e-6)
    assert degrees(stroke.contact) > degrees(stroke.top)
