# SPDX-License-Identifier: Apache-2.0
"""Closed-form metrics of a cycle: what one of them says of another, and what a run shows of them."""

import math

import pytest

from mech_twin.machines.mb10_breaker.metrics import position_metrics, static_metrics
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parameters.load import machine, machine_parameters

PARAMETERS = machine_parameters("mb10_breaker")
B = breaker(PARAMETERS)
REPORT = static_metrics(PARAMETERS, B)


def test_the_striker_speed_is_the_slope_of_its_travel():
    q, step = math.radians(REPORT["striking_angle_deg"]), 1e-6
    ahead, behind = (position_metrics(PARAMETERS, B, q + side)["striker_travel_m"] for side in (step, -step))
    u = REPORT["rated_crank_speed_rad_per_s"]
    assert (ahead - behind) / (2.0 * step) * u == pytest.approx(REPORT["striker_speed_m_per_s"], rel=1e-8)


def test_at_the_extreme_the_striker_has_gone_its_overtravel_and_stands():
    found = position_metrics(PARAMETERS, B, math.radians(REPORT["striking_extreme_deg"]))
    assert found["striker_travel_m"] == pytest.approx(PARAMETERS.tool.overtravel_m, abs=1e-12)
    assert found["striker_speed_m_per_s"] == pytest.approx(0.0, abs=1e-10)


def test_the_blow_s_energy_is_that_of_its_impulse_and_less_than_with_the_body_held():
    mass = PARAMETERS.tool.mass_kg
    assert REPORT["blow_energy_j"] == pytest.approx(REPORT["blow_impulse_ns"] ** 2 / (2.0 * mass), rel=1e-12)
    assert REPORT["blow_energy_j"] < REPORT["blow_energy_body_held_j"]


def test_the_body_leaves_with_the_impulse_it_gets():
    inertia = PARAMETERS.body.inertia_kg_m2
    assert REPORT["blow_impulse_on_body_nms"] == pytest.approx(inertia * REPORT["body_leaves_at_rad_per_s"], rel=1e-9)


@pytest.mark.parametrize("degrees", [0.0, 77.0, 200.0, 325.0])
def test_a_position_has_one_drive_torque_by_two_routes(degrees):
    found = position_metrics(PARAMETERS, B, math.radians(degrees))
    assert found["drive_torque_nm"] == pytest.approx(
        PARAMETERS.gear.ratio * PARAMETERS.gear.efficiency * found["motor_torque_nm"], rel=1e-9
    )
    assert abs(found["drive_torque_routes_nm"]) <= 1e-10 * PARAMETERS.linkage.crank_inertia_kg_m2 * 4500.0


def test_a_contact_stiffness_adds_the_force_of_a_blow():
    assert not any(name.startswith("contact_") for name in REPORT)
    soft, stiff = (
        machine("mb10_breaker", overrides={"tool.contact_stiffness_n_per_m": value}).report() for value in (5e7, 2e8)
    )
    assert stiff["contact_peak_force_n"] == pytest.approx(2.0 * soft["contact_peak_force_n"], rel=0.05)
    assert stiff["contact_time_s"] == pytest.approx(0.5 * soft["contact_time_s"], rel=0.1)
