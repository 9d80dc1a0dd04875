# SPDX-License-Identifier: Apache-2.0
"""Motor of the roller former: power from the mean moment, and whether a motor carries and starts the load."""

import pytest
from roller_former_cases import parameters_for

from mech_twin.machines.roller_former.drive_choice import (
    motor_selection,
    motor_verdict,
    power_required_w,
    speed_under_mean_load,
    standstill_margin,
)
from mech_twin.parameters.load import MOTOR_TABLE, configuration_file, motor_table

TABLE = motor_table(configuration_file(MOTOR_TABLE))


def test_power_is_mean_moment_times_rated_speed_over_efficiency():
    assert power_required_w(parameters_for(2)) == pytest.approx(2.0 * 453.404 * 102.1018 / 9.8 / 0.9, rel=1e-5)


def test_the_published_motor_suits_but_does_not_start_the_load():
    verdict = motor_verdict(parameters_for(2))
    assert verdict.rated_enough
    assert verdict.runs
    assert verdict.starts_as_configured
    assert not verdict.starts_under_load
    assert verdict.starts_under_load_with_catalogue_torque
    assert verdict.kloss_standstill_nm == pytest.approx(39.85, abs=5e-3)
    assert standstill_margin(parameters_for(2)) < 0.3


def test_it_does_not_run_the_printed_loads():
    assert not motor_verdict(parameters_for(2, {"parameter_set": "printed"})).runs


def test_the_selection_names_the_smallest_motor_that_suits():
    verdicts = motor_selection(parameters_for(2), TABLE)
    assert [verdict.rated_power_w for verdict in verdicts] == sorted(verdict.rated_power_w for verdict in verdicts)
    assert next(verdict for verdict in verdicts if verdict.rated_enough).name == "4A160S6U3"
    assert verdicts[0].text == "4A80B4U3: too weak, 15.3 kW are needed"


def test_the_steady_speed_is_near_that_of_the_mean_moment():
    verdict = motor_verdict(parameters_for(4))
    assert verdict.steady_speed_rad_per_s == pytest.approx(speed_under_mean_load(parameters_for(4)) / 9.8, rel=5e-3)
