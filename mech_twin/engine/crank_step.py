# SPDX-License-Identifier: Apache-2.0
"""One coupling step of a linkage with one freedom, as kernels over any mechanism of `crank_state`.

Between two boundaries of the crank angle the regime is constant, and between two instants of rest the sense of turning
is, so a step is cut there and each piece is smooth.  With a prescribed speed the crank angle is a parabola in time and
the cuts are roots of it; with a motor they are found on the integrated motion.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.compiled_steps import linkage_step, step_of
from mech_twin.engine.crank_driven import drive_on
from mech_twin.engine.crank_led import holding_torque, lead
from mech_twin.engine.crank_piece import (
    NO_TORQUE,
    POINT,
    sign_of,
    turned_over,
)
from mech_twin.engine.crank_state import (
    MEMORY_SIZE,
    Crank,
    Memory,
    fill_memory,
    mechanism_state,
    memory_of,
    shaft_drive,
    under_load_share,
)
from mech_twin.engine.sample_vectors import (
    COMMAND,
    LINKAGE_JOINTS,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    REGIME,
    Array,
)
from mech_twin.kernel import kernel


class TurnedCrank(NamedTuple):
    """A crank linkage: its constants, and those of its mechanism."""

    crank: Crank
    mechanism: Any


@kernel
def fill_row(
    model: TurnedCrank, point: Any, command: float, held: float, initial_j: float, booked_j: float, out: Array
) -> bool:
    """Fill a linkage row with a state, an array of one `CrankPoint`; return whether the crank torque is finite.

    Parameters
    ----------
    held : float
        Friction torque at rest (N m).
    initial_j, booked_j : float
        Energy at the start of the run (nan: this is the start), and what changed parameters have brought since.
    """
    crank, s = model.crank, point[0]
    regime, mechanism = int(s.regime), under_load_share(model.mechanism, s.load_share)
    f, w, e = s.angle_rad, s.speed_rad_per_s, s.acceleration_rad_per_s2
    positions, velocities, torque, energy, closure = mechanism_state(mechanism, f, w, e, regime)
    friction = held
    if s.turning_sense != 0.0:
        friction = -crank.friction.coulomb_nm * s.turning_sense - crank.friction.viscous_nms_per_rad * w
    initial = energy if math.isnan(initial_j) else initial_j
    miss = energy - initial - s.drive_work_j - s.load_work_j + s.friction_loss_j - booked_j
    scale = max(turned_over(s), abs(initial), abs(energy), abs(booked_j), crank.energy_scale_j)
    out[REGIME], out[COMMAND] = regime, command
    at = LINKAGE_JOINTS
    for i in range(len(positions)):
        out[at], out[at + 1], out[at + 2] = positions[i], velocities[i], 0.0
        at += 3
    out[LINKAGE_JOINTS + 2] = torque - friction
    memory = Memory(
        e, friction, s.turning_sense, s.stalled, s.load_share, s.turned_back_rad, s.drive_work_j, s.gear_loss_j,
        s.friction_loss_j, s.load_work_j, booked_j, energy, initial,
    )  # fmt: skip
    fill_memory(memory, out, len(positions))
    at += MEMORY_SIZE
    out[at], out[at + 1] = closure, miss / scale
    return math.isfinite(torque)


@kernel
def start_row(model: TurnedCrank, f: float, w: float, command: float, regime: int, out: Array) -> bool:
    """Fill the row of a crank at its first angle and speed (rad, rad/s); return whether its torque is finite."""
    point = np.zeros(1, dtype=POINT)
    s = point[0]
    s.angle_rad, s.speed_rad_per_s, s.turning_sense, s.regime, s.load_share = f, w, sign_of(w), regime, 1.0
    held = holding_torque(model, s) if w == 0.0 else 0.0
    return fill_row(model, point, command, held, math.nan, 0.0, out)


@kernel
def guided_row(model: TurnedCrank, f: float, w: float, e: float, command: float, regime: int, out: Array) -> bool:
    """Fill the row of a crank in a given motion (rad, rad/s, rad/s2); return whether its torque is finite."""
    point = np.zeros(1, dtype=POINT)
    s = point[0]
    s.angle_rad, s.speed_rad_per_s, s.acceleration_rad_per_s2 = f, w, e
    s.turning_sense, s.regime, s.load_share = sign_of(w), regime, 1.0
    return fill_row(model, point, command, 0.0, math.nan, 0.0, out)


@step_of(linkage_step, TurnedCrank)
def crank_step(
    model: TurnedCrank, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill in the linkage one step later, its changes of regime and instants of rest located inside the step."""
    crank, point = model.crank, np.empty(1, dtype=POINT)
    s = point[0]
    f, w, regime = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], int(linkage[REGIME])
    positions, _, _, energy, _ = mechanism_state(model.mechanism, f, w, 0.0, regime)
    past = memory_of(linkage, len(positions))
    adjusted = energy - past.energy_j
    s.angle_rad, s.speed_rad_per_s, s.acceleration_rad_per_s2 = f, w, past.crank_acceleration_rad_per_s2
    s.turning_sense, s.regime = past.turning_sense, regime
    s.drive_work_j, s.gear_loss_j, s.friction_loss_j = past.drive_work_j, past.gear_loss_j, past.friction_loss_j
    s.load_work_j, s.stalled = past.load_work_j, past.stalled_1
    s.load_share, s.turned_back_rad = 1.0, past.turned_back_rad
    command, speed, torque = motor[MOTOR_COMMAND], motor[MOTOR_JOINTS + 1], motor[MOTOR_JOINTS + 2]
    start_s = step * crank.step_s
    if crank.drive.prescribed:
        log, count, held = lead(model, s, start_s, speed, log)
    else:
        drive = shaft_drive(crank, w, linkage[COMMAND], speed, torque, command)
        log, count, held = drive_on(model, s, start_s, drive, command, log)
    finite = fill_row(model, point, command, held, past.initial_energy_j, past.adjustment_work_j + adjusted, out)
    return log, count if finite or count < 0 else NO_TORQUE
