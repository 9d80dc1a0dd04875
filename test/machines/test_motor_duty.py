# SPDX-License-Identifier: Apache-2.0
"""Duty of a motor: integrals of linear courses are exact, and rated load is a share of one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.machines.crank_run import MotorDuty, MotorState, duty_after, duty_metrics
from mech_twin.parts.induction_motor import KLOSS, MotorConstants, motor_torque

MOTOR = MotorConstants(157.0796, 148.7021, 10.087, 0.053333, 22.19, 0.2218, 20.17, KLOSS)
number = st.floats(-50.0, 50.0)


@given(number, number, st.floats(0.0, 200.0), st.floats(0.0, 200.0), st.floats(1e-4, 1.0))
def test_a_linear_course_is_integrated_exactly(m0, m1, w0, w1, span):
    duty = duty_after(MotorDuty(), MotorState(m0, w0, 157.0 - w0), MotorState(m1, w1, 157.0 - w1), span)
    points, weights = np.polynomial.legendre.leggauss(3)
    share = 0.5 * (points + 1.0)
    torque, speed = m0 + (m1 - m0) * share, w0 + (w1 - w0) * share
    scale = 1e4 * span
    for found, course in (
        (duty.torque_nms, torque),
        (duty.torque_square_n2m2s, torque**2),
        (duty.work_j, torque * speed),
        (duty.rotor_loss_j, torque * (157.0 - speed)),
    ):
        assert found == pytest.approx(0.5 * span * float(weights @ course), abs=1e-12 * scale)


@given(number, number, st.floats(1.0, 200.0), st.floats(0.01, 1.0), st.floats(-5.0, 5.0))
def test_missed_work_is_counted_in_work_and_torque(m0, m1, w, span, missed):
    begin, end = MotorState(m0, w, 1.0), MotorState(m1, w, 1.0)
    plain, full = duty_after(MotorDuty(), begin, end, span), duty_after(MotorDuty(), begin, end, span, missed)
    assert full.work_j - plain.work_j == pytest.approx(missed, abs=1e-9)
    assert (full.torque_nms - plain.torque_nms) * w == pytest.approx(missed, abs=1e-9)
    assert full.torque_square_n2m2s == plain.torque_square_n2m2s


def test_rated_load_heats_as_rated():
    rated = MotorState(
        motor_torque(MOTOR, MOTOR.rated_speed_rad_per_s, 1.0),
        MOTOR.rated_speed_rad_per_s,
        MOTOR.synchronous_speed_rad_per_s - MOTOR.rated_speed_rad_per_s,
    )
    found = duty_metrics(duty_after(MotorDuty(), rated, rated, 3.0), MOTOR)
    assert found["motor_rms_torque_over_rated"] == pytest.approx(1.0, rel=1e-3)
    assert found["motor_rotor_loss_over_rated"] == pytest.approx(1.0, rel=1e-3)
    assert found["motor_power_w"] == pytest.approx(1500.0, rel=1e-3)


def test_no_time_no_means():
    assert duty_metrics(MotorDuty(), MOTOR) == {}
