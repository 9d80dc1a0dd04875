# SPDX-License-Identifier: Apache-2.0
"""The breaker's linkage as rows of numbers: their layout, and kernels of a coupling step and of the motor."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.compiled_steps import linkage_step, motor_step, step_of
from mech_twin.engine.hybrid.laws import Indices
from mech_twin.engine.records import record_at
from mech_twin.engine.sample_vectors import (
    BODY_JOINTS,
    COMMAND,
    LINKAGE_JOINTS,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    REGIME,
    Array,
)
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.drives import KlossMotor, fill_motor
from mech_twin.machines.mb10_breaker.dynamics import HELD, REST, Breaker, spring_moment
from mech_twin.machines.mb10_breaker.motion import rotor_speed
from mech_twin.machines.mb10_breaker.state import MEMORY, STATES, BreakerMemory, named
from mech_twin.machines.mb10_breaker.step import Total, advance_step, breaker_room, take_body, total_of
from mech_twin.parts.four_bar import closure_error, coefficients, link_angles, position
from mech_twin.parts.induction_motor import MotorConstants, motor_in_step

JOINTS = ("crank", "coupler", "rocker", "body")
LEAST_RATE_RAD_PER_S = 1e-4  # momentum is balanced over that of parts so fast: 1e-9 of it is what a step may miss
# places in a row
CRANK_AT, COUPLER_AT, ROCKER_AT, BODY_AT = range(LINKAGE_JOINTS, LINKAGE_JOINTS + 12, 3)
MEMORY_AT = LINKAGE_JOINTS + 12
RESIDUALS_AT = MEMORY_AT + len(BreakerMemory._fields)


class GearedMotor(NamedTuple):
    """Constants of the motor role: the drive; 1 where its housing turns with the body."""

    drive: KlossMotor
    frame_drive: float


class LedBreaker(NamedTuple):
    """Constants of the linkage role: breaker, the motor's curve, and coupling step (s)."""

    breaker: Breaker
    curve: MotorConstants
    step_s: float


@step_of(motor_step, GearedMotor)
def geared_motor(model: GearedMotor, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` with the motor at the gear output's angle and speed relative to it: q - phi on the frame, else q."""
    carried = model.frame_drive
    turned = 2.0 * math.pi * linkage[MEMORY_AT] + linkage[CRANK_AT]
    angle = turned - carried * linkage[BODY_AT]
    fill_motor(
        model.drive, linkage[COMMAND], angle, linkage[CRANK_AT + 1] - carried * linkage[BODY_AT + 1], target, out
    )


@borrowing_kernel
def memory_of(row: Array) -> Any:
    """Return the memory of a linkage row as a record that shares its numbers."""
    return record_at(row, MEMORY_AT, MEMORY)


@kernel
def fill_row(
    b: Breaker, y: Array, regime: int, total: Total, drive: float, command: float, defect_j: float, step_s: float,
    out: Array,
) -> None:  # fmt: skip
    """Fill a linkage row whose memory is in place: joints, regime, command and residuals.

    Parameters
    ----------
    y : (10,) array
        As `state.BreakerState` names it.
    total : Total
        Energy and momentum in this state.
    drive : float
        Torque on the crank at the end of the step (N m).
    defect_j : float
        Jump of energy (J) at the start of the step by an externally simulated body.
    step_s : float
        Coupling step (s).  The momentum error is scaled by at least the springs' angular impulse in a step: the
        impulses of spring and collar are summed with its rounding.
    """
    memory, state = memory_of(out), named(y)
    q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    at = position(b.bar, q)
    by = coefficients(at)
    coupler, rocker = link_angles(at)
    out[REGIME], out[COMMAND] = regime, command
    out[CRANK_AT], out[CRANK_AT + 1], out[CRANK_AT + 2] = q, u, drive
    out[COUPLER_AT], out[COUPLER_AT + 1], out[COUPLER_AT + 2] = coupler, by.g2 * u, 0.0
    out[ROCKER_AT], out[ROCKER_AT + 1], out[ROCKER_AT + 2] = rocker, by.g3 * u, 0.0
    out[BODY_AT], out[BODY_AT + 1], out[BODY_AT + 2] = phi, p, -spring_moment(b, phi)
    turned = b.body_inertia_kg_m2 + b.crank.inertia_kg_m2 + abs(b.rotor_12_kg_m2)
    missed = turned * LEAST_RATE_RAD_PER_S
    held = max(total.size_j, 1.0)
    turning = max(abs(total.momentum_nms), abs(spring_moment(b, phi)) * step_s, missed, 1.0)
    out[RESIDUALS_AT] = closure_error(b.bar, at)
    out[RESIDUALS_AT + 1] = abs(memory.energy_error_j) / held
    out[RESIDUALS_AT + 2] = 0.0 if b.held else abs(memory.momentum_error_nms) / turning
    out[RESIDUALS_AT + 3] = abs(defect_j) / held


@kernel
def start_row(b: Breaker, crank_rad: float, command: float, out: Array) -> None:
    """Fill the row of the machine at rest, the body on its collar."""
    y = np.zeros(STATES)
    named(y).crank_rad = crank_rad
    total = total_of(b, named(y))
    out[MEMORY_AT:RESIDUALS_AT] = 0.0
    memory = memory_of(out)
    memory.energy_j = total.energy_j
    fill_row(b, y, HELD if b.held else REST, total, 0.0, command, 0.0, 0.0, out)


@borrowing_kernel
def try_step(
    model: LedBreaker, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, numbers: Array,
    marks: Indices,
) -> int:  # fmt: skip
    """Fill ``out`` with the linkage one step later; return the number of events, negative for a failure."""
    b, y, regime = model.breaker, numbers[:STATES], int(linkage[REGIME])
    for i in range(len(out)):
        out[i] = linkage[i]
    state, memory = named(y), memory_of(out)
    state.crank_rad, state.crank_rad_per_s = linkage[CRANK_AT], linkage[CRANK_AT + 1]
    state.body_rad, state.body_rad_per_s = linkage[BODY_AT], linkage[BODY_AT + 1]
    state.tool_m, state.tool_m_per_s = memory.tool_travel_m, memory.tool_speed_m_per_s
    total = total_of(b, state)
    memory.parameter_work_j += total.energy_j - memory.energy_j
    defect = memory.coupling_defect_j
    if len(body) > 0:
        rests = int(body[REGIME]) == REST
        regime, total = take_body(b, y, memory, regime, total, body[BODY_JOINTS], body[BODY_JOINTS + 1], rests)
    command = motor[MOTOR_COMMAND]
    rotor = rotor_speed(b, state.crank_rad_per_s, state.body_rad_per_s)
    turning = motor_in_step(model.curve, linkage[COMMAND], rotor, motor[MOTOR_JOINTS + 2], command, model.step_s)
    regime, count, torque, total = advance_step(
        b, turning, y, out[MEMORY_AT:RESIDUALS_AT], regime, total, step * model.step_s, model.step_s, log,
        numbers[STATES:], marks,
    )  # fmt: skip
    if count >= 0:
        fill_row(b, y, regime, total, torque, command, memory.coupling_defect_j - defect, model.step_s, out)
    return count


@step_of(linkage_step, LedBreaker)
def breaker_step(
    model: LedBreaker, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill ``out`` with the linkage one step later; angle and rate of the body are taken from its own row."""
    size, places = breaker_room()
    numbers, marks = np.zeros(STATES + size), np.zeros(places, dtype=np.int64)
    return log, try_step(model, step, linkage, motor, body, out, log, numbers, marks)
