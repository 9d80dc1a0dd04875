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
    AT_REGIME,
    DRIVE_WORK,
    FRICTION_LOSS,
    GEAR_LOSS,
    IS_STALLED,
    LOAD_WORK,
    M_ACCELERATION,
    M_ADJUSTMENT,
    M_DRIVE_WORK,
    M_ENERGY,
    M_FRICTION,
    M_FRICTION_LOSS,
    M_GEAR_LOSS,
    M_INITIAL,
    M_LOAD_WORK,
    M_MARK,
    M_SENSE,
    M_SHARE,
    M_STALLED,
    MARK,
    MEMORY_SIZE,
    NO_TORQUE,
    SENSE,
    SHARE,
    STATES,
    E,
    F,
    W,
    sign_of,
    turned_over,
)
from mech_twin.engine.crank_state import (
    Crank,
    mechanism_state,
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
    model: TurnedCrank, s: Array, command: float, held: float, initial_j: float, booked_j: float, out: Array
) -> bool:
    """Fill a linkage row with a state; return whether the crank torque is finite.

    Parameters
    ----------
    held : float
        Friction torque at rest (N m).
    initial_j, booked_j : float
        Energy at the start of the run (nan: this is the start), and what changed parameters have brought since.
    """
    crank, regime = model.crank, int(s[AT_REGIME])
    mechanism = under_load_share(model.mechanism, s[SHARE])
    positions, velocities, torque, energy, closure = mechanism_state(mechanism, s[F], s[W], s[E], regime)
    friction = held
    if s[SENSE] != 0.0:
        friction = -crank.friction.coulomb_nm * s[SENSE] - crank.friction.viscous_nms_per_rad * s[W]
    initial = energy if math.isnan(initial_j) else initial_j
    miss = energy - initial - s[DRIVE_WORK] - s[LOAD_WORK] + s[FRICTION_LOSS] - booked_j
    scale = max(turned_over(s), abs(initial), abs(energy), abs(booked_j), crank.energy_scale_j)
    out[REGIME], out[COMMAND] = regime, command
    at = LINKAGE_JOINTS
    for i in range(len(positions)):
        out[at], out[at + 1], out[at + 2] = positions[i], velocities[i], 0.0
        at += 3
    out[LINKAGE_JOINTS + 2] = torque - friction
    out[at + M_ACCELERATION], out[at + M_FRICTION], out[at + M_SENSE] = s[E], friction, s[SENSE]
    out[at + M_STALLED], out[at + M_SHARE], out[at + M_MARK] = s[IS_STALLED], s[SHARE], s[MARK]
    out[at + M_DRIVE_WORK], out[at + M_GEAR_LOSS] = s[DRIVE_WORK], s[GEAR_LOSS]
    out[at + M_FRICTION_LOSS], out[at + M_LOAD_WORK] = s[FRICTION_LOSS], s[LOAD_WORK]
    out[at + M_ADJUSTMENT], out[at + M_ENERGY], out[at + M_INITIAL] = booked_j, energy, initial
    out[at + MEMORY_SIZE], out[at + MEMORY_SIZE + 1] = closure, miss / scale
    return math.isfinite(torque)


@kernel
def start_row(model: TurnedCrank, f: float, w: float, command: float, regime: int, out: Array) -> bool:
    """Fill the row of a crank at its first angle and speed (rad, rad/s); return whether its torque is finite."""
    s = np.zeros(STATES)
    s[F], s[W], s[SENSE], s[AT_REGIME], s[SHARE] = f, w, sign_of(w), regime, 1.0
    held = holding_torque(model, s) if w == 0.0 else 0.0
    return fill_row(model, s, command, held, math.nan, 0.0, out)


@kernel
def guided_row(model: TurnedCrank, f: float, w: float, e: float, command: float, regime: int, out: Array) -> bool:
    """Fill the row of a crank in a given motion (rad, rad/s, rad/s2); return whether its torque is finite."""
    s = np.zeros(STATES)
    s[F], s[W], s[E], s[SENSE], s[AT_REGIME], s[SHARE] = f, w, e, sign_of(w), regime, 1.0
    return fill_row(model, s, command, 0.0, math.nan, 0.0, out)


@step_of(linkage_step, TurnedCrank)
def crank_step(
    model: TurnedCrank, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill in the linkage one step later, its changes of regime and instants of rest located inside the step."""
    crank, s = model.crank, np.empty(STATES)
    f, w, regime = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], int(linkage[REGIME])
    positions, _, _, energy, _ = mechanism_state(model.mechanism, f, w, 0.0, regime)
    past = linkage[LINKAGE_JOINTS + 3 * len(positions) :]
    adjusted = energy - past[M_ENERGY]
    s[F], s[W], s[E], s[SENSE], s[AT_REGIME] = f, w, past[M_ACCELERATION], past[M_SENSE], regime
    s[DRIVE_WORK], s[GEAR_LOSS], s[FRICTION_LOSS] = past[M_DRIVE_WORK], past[M_GEAR_LOSS], past[M_FRICTION_LOSS]
    s[LOAD_WORK], s[IS_STALLED], s[SHARE], s[MARK] = past[M_LOAD_WORK], past[M_STALLED], 1.0, past[M_MARK]
    command, speed, torque = motor[MOTOR_COMMAND], motor[MOTOR_JOINTS + 1], motor[MOTOR_JOINTS + 2]
    start_s = step * crank.step_s
    if crank.drive.prescribed:
        log, count, held = lead(model, s, start_s, speed, log)
    else:
        drive = shaft_drive(crank, w, linkage[COMMAND], speed, torque, command)
        log, count, held = drive_on(model, s, start_s, drive, command, log)
    finite = fill_row(model, s, command, held, past[M_INITIAL], past[M_ADJUSTMENT] + adjusted, out)
    return log, count if finite or count < 0 else NO_TORQUE
