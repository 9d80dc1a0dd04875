# SPDX-License-Identifier: Apache-2.0
"""Duty of a motor over a time: work, torque, and heat in its rotor, relative to its rating.

The heat in an induction motor's rotor is the air-gap power that does not leave by the shaft, M (f w_0 - w): torque
times slip speed.  At rated load it is M_n s_n w_0.  This is the rotor loss alone.  Copper and iron losses of the stator
and the magnetising current, which heat an idle motor too, are not known from rating and speeds.
If the RMS torque is below the rated one, the load's share of the heat is too, for a duty cycle short against the
thermal time constant.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.parts.induction_motor import MotorConstants


class MotorState(NamedTuple):
    """Torque (N m), speed and slip speed (rad/s) of the rotor at an instant."""

    torque_nm: float
    speed_rad_per_s: float
    slip_rad_per_s: float


class MotorDuty(NamedTuple):
    """Integrals over a time: of torque, its square, shaft power and rotor loss."""

    time_s: float = 0.0
    torque_nms: float = 0.0
    torque_square_n2m2s: float = 0.0
    work_j: float = 0.0
    rotor_loss_j: float = 0.0


def _product(a0: float, a1: float, b0: float, b1: float) -> float:
    """Return the mean over a span of the product of two quantities that are linear in it."""
    return (2.0 * (a0 * b0 + a1 * b1) + a0 * b1 + a1 * b0) / 6.0


def shaft_work_j(begin: MotorState, end: MotorState, span_s: float) -> float:
    """Return the shaft work (J) over a span in which torque and speed are linear."""
    mean = _product(begin.torque_nm, end.torque_nm, begin.speed_rad_per_s, end.speed_rad_per_s)
    return mean * span_s


def duty_after(
    duty: MotorDuty, begin: MotorState, end: MotorState, span_s: float, missed_work_j: float = 0.0
) -> MotorDuty:
    """Return the duty a span later.

    Parameters
    ----------
    duty : MotorDuty
        The duty up to the span.
    begin, end : MotorState
        Ends of the span; torque, speed and slip are taken as linear between them.
    span_s : float
        Length (s).
    missed_work_j : float
        Work (J) besides that of linear torque and speed; it is spread evenly over the angle turned.  RMS torque and
        heat are those of linear torque and speed.
    """
    turned = 0.5 * (begin.speed_rad_per_s + end.speed_rad_per_s) * span_s
    first, last = begin.torque_nm, end.torque_nm
    missed_impulse = missed_work_j / turned * span_s if abs(turned) > 1e-9 else 0.0
    return MotorDuty(
        duty.time_s + span_s,
        duty.torque_nms + 0.5 * (first + last) * span_s + missed_impulse,
        duty.torque_square_n2m2s + _product(first, last, first, last) * span_s,
        duty.work_j + shaft_work_j(begin, end, span_s) + missed_work_j,
        duty.rotor_loss_j + _product(first, last, begin.slip_rad_per_s, end.slip_rad_per_s) * span_s,
    )


def duty_metrics(duty: MotorDuty, motor: MotorConstants) -> dict[str, float]:
    """Return means and RMS values of a duty, also relative to the motor's rating; empty for a duty of no time."""
    if duty.time_s <= 0.0:
        return {}
    rms = math.sqrt(duty.torque_square_n2m2s / duty.time_s)
    loss = duty.rotor_loss_j / duty.time_s
    rated_loss = motor.rated_torque_nm * motor.rated_slip * motor.synchronous_speed_rad_per_s
    return {
        "motor_torque_nm": duty.torque_nms / duty.time_s,
        "motor_power_w": duty.work_j / duty.time_s,
        "motor_rms_torque_nm": rms,
        "motor_rms_torque_over_rated": rms / motor.rated_torque_nm,
        "motor_rotor_loss_w": loss,
        "motor_rotor_loss_over_rated": loss / rated_loss,
    }
