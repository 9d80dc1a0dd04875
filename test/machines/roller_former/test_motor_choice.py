# SPDX-License-Identifier: Apache-2.0
"""Motor of the roller former: power from the mean moment, and whether a motor carries and starts the load."""

import numpy as np
import pytest
from roller_former_cases import parameters_for
from scipy.optimize import brentq

from mech_twin.machines.roller_former.cart_statics import load_moments
from mech_twin.machines.roller_former.metrics import moment_metrics
from mech_twin.machines.roller_former.parameters import former_of
from mech_twin.machines.roller_former.sizing import (
    motor_selection,
    motor_verdict,
    power_required_w,
)
from mech_twin.machines.roller_former.steady import steady_turn
from mech_twin.parameters.load import MOTOR_TABLE, table
from mech_twin.parts.induction_motor import motor_torque

TABLE = table(MOTOR_TABLE)


def test_power_is_mean_moment_times_rated_speed_over_efficiency():
    assert power_required_w(parameters_for(2)) == pytest.approx(2.0 * 453.404 * 102.1018 / 9.8 / 0.9, rel=1e-5)


def test_the_motor_gives_what_the_friction_of_the_shaft_takes_too():
    rubbed = parameters_for(2, {"friction.coulomb_nm": 100.0, "friction.viscous_nms_per_rad": 10.0})
    turn = steady_turn(former_of(rubbed))
    crank_w = 0.9 * power_required_w(rubbed) * turn.mean_speed_rad_per_s / rubbed.rated_crank_speed_rad_per_s
    assert turn.works.motor_work_j / turn.turn_time_s == pytest.approx(crank_w, rel=5e-3)
    assert not motor_verdict(rubbed).rated_enough


def test_the_published_motor_suits_but_does_not_start_the_load():
    verdict = motor_verdict(parameters_for(2))
    assert verdict.rated_enough
    assert verdict.runs
    assert verdict.starts_as_configured
    assert not verdict.starts_under_load
    assert verdict.starts_under_load_with_catalogue_torque
    assert verdict.kloss_standstill_nm == pytest.approx(39.85, abs=5e-3)
    former = former_of(parameters_for(2))
    largest_nm = np.max(load_moments(former.bank, np.linspace(0.0, 2.0 * np.pi, 720), 1.0))
    assert verdict.kloss_standstill_nm * former.ratio * former.efficiency < 0.3 * largest_nm


def test_it_does_not_run_the_printed_loads():
    assert not motor_verdict(parameters_for(2, {"parameter_set": "printed"})).runs


def test_the_selection_names_the_smallest_motor_that_suits():
    verdicts = motor_selection(parameters_for(2), TABLE)
    assert [verdict.rated_power_w for verdict in verdicts] == sorted(verdict.rated_power_w for verdict in verdicts)
    assert next(verdict for verdict in verdicts if verdict.rated_enough).name == "4A160S6U3"
    assert verdicts[0].text == "4A80B4U3: too weak, 15.3 kW are needed"


def test_the_steady_speed_is_near_that_of_the_mean_moment():
    verdict, former = motor_verdict(parameters_for(4)), former_of(parameters_for(4))
    mean_nm = moment_metrics(former)["moment_mean_nm"] / (former.ratio * former.efficiency)
    synchronous = former.motor.synchronous_speed_rad_per_s
    working = ((1.0 - former.motor.breakdown_slip) * synchronous, synchronous)
    expected = brentq(lambda speed: motor_torque(former.motor, speed, 1.0) - mean_nm, *working) / former.ratio
    assert verdict.steady_speed_rad_per_s == pytest.approx(expected, rel=5e-3)
