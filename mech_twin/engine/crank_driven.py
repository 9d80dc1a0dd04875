# SPDX-License-Identifier: Apache-2.0
"""A coupling step of a crank behind a motor: the cuts are found on the integrated motion; it sticks, and sets off."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mech_twin.engine.compiled_steps import log_event
from mech_twin.engine.crank_motion import (
    AT_ANGLE,
    AT_REST,
    NOT_INTEGRATED,
    SPAN_ENDED,
    STATE_SIZE,
    TOO_MANY_STEPS,
    ShaftDrive,
    ShaftState,
    fill_shaft,
    shaft_state,
    turn_crank,
)
from mech_twin.engine.crank_piece import (
    CRANK_CONTACT,
    MOST_PIECES,
    REVERSED,
    STALLED,
    STARTED,
    STOPPED,
    TOLERANCE,
    TOO_LONG,
    TOO_MANY,
    UNSTEADY,
    apply_boundary,
    load_torque,
    log_sides,
    next_boundary,
    period_of,
    rounding_work,
    turn_back,
    work_scale,
)
from mech_twin.engine.crank_state import (
    mechanism_load_work,
    turning,
    within_a_turn,
)
from mech_twin.engine.crank_systems import DrivenMechanism
from mech_twin.engine.sample_vectors import (
    Array,
)
from mech_twin.kernel import kernel
from mech_twin.parts.friction import released
from mech_twin.parts.gear import GearTorque, gear_split

if TYPE_CHECKING:
    from mech_twin.engine.crank_step import TurnedCrank


@kernel
def grip_at_rest(drive: ShaftDrive, t: float) -> GearTorque:
    """Return what the gear passes on to a crank at rest at a time of the step (s)."""
    torque = drive.torque_nm - drive.speed_slope * drive.ratio * drive.speed + drive.time_slope * t
    torque = min(max(torque, -drive.torque_limit_nm), drive.torque_limit_nm)
    return gear_split(drive.ratio, drive.efficiency, torque)


@kernel
def driving_torque(model: TurnedCrank, s: Any, mean: float, limit: float) -> tuple[float, float]:
    """Return the torque (N m) that would turn a crank at rest, and the share of the load that acts on it.

    A load that only resists takes of itself what holds the crank, from nothing to the whole.
    """
    regime, mechanism = int(s.regime), model.mechanism
    whole = load_torque(mechanism, s.angle_rad, regime)
    for i in range(len(model.crank.resisting)):
        if model.crank.resisting[i, 0] != regime:
            continue
        bare = load_torque(mechanism, s.angle_rad, int(model.crank.resisting[i, 2]))
        if model.crank.resisting[i, 1] * (mean - whole) > limit:
            return mean - whole, 1.0
        share = 0.0 if whole == bare else min(max((mean - bare) / (whole - bare), 0.0), 1.0)
        return mean - bare - share * (whole - bare), share
    return mean - whole, 1.0


@kernel
def rest(model: TurnedCrank, s: Any, drive: ShaftDrive, t: float) -> tuple[float, float, float]:
    """Return the sense in which a crank without speed starts (0: it sticks), the bearing's torque (N m), the share."""
    grip, coulomb = grip_at_rest(drive, t), model.crank.friction.coulomb_nm
    limit = grip.friction_nm + coulomb
    driving, load_share = driving_torque(model, s, grip.mean_nm, limit)
    sense = released(limit, driving)
    if sense != 0.0:
        return sense, 0.0, 1.0
    return sense, -driving * (coulomb / limit if limit > 0.0 else 0.0), load_share


@kernel
def set_off(
    model: TurnedCrank, s: Any, time_s: float, drive: ShaftDrive, t: float, command: float, log: Array, count: int
) -> tuple[Array, int]:
    """Give a crank without speed the sense in which it goes on, 0 where it sticks, and log that."""
    crank, past, regime, stalled = model.crank, s.turning_sense, int(s.regime), s.stalled
    sense, _, share = rest(model, s, drive, t)
    s.turning_sense, s.acceleration_rad_per_s2, s.load_share = sense, 0.0, share
    if sense != 0.0:
        s.stalled = 0.0
        turn_back(crank, s)
    held_for_good = sense == 0.0 and past == 0.0 and command != 0.0 and drive.time_slope == 0.0
    if sense == past and (not held_for_good or stalled != 0.0):
        return log, count
    kind = STARTED if past == 0.0 else STOPPED if sense == 0.0 else REVERSED
    if held_for_good or past * command > 0.0:
        kind, s.stalled = STALLED, 1.0 if sense == 0.0 else 0.0
    smooth = grip_at_rest(drive, t).friction_nm + crank.friction.coulomb_nm == 0.0
    if kind != STALLED and smooth:
        return log, count
    torque = load_torque(model.mechanism, s.angle_rad, regime)
    log = log_event(log, count, time_s, kind, CRANK_CONTACT, 0.0, 0.0, 0.0, period_of(crank, s.angle_rad, past))
    log_sides(log, count, s.angle_rad, 0.0, torque, torque)
    return log, count + 1


@kernel
def release_time(model: TurnedCrank, s: Any, drive: ShaftDrive, t: float, left: float) -> float:
    """Return how long a crank at rest goes on sticking (s), at most ``left``.

    The motor's torque is a straight line in time, and so is, on either side of 0, what the gear passes on: the
    margin |T| - c - friction of the gear grows with one sign of slope, so its root is bracketed by the ends.
    """
    if rest(model, s, drive, t + left)[0] == 0.0:
        return left
    low, high = 0.0, left
    while high - low > 1e-15 * model.crank.step_s:
        middle = 0.5 * (low + high)
        if rest(model, s, drive, t + middle)[0] == 0.0:
            low = middle
        else:
            high = middle
    return high


@kernel
def turn(model: TurnedCrank, s: Any, drive: ShaftDrive, t: float, left: float, aim: float) -> tuple[float, int]:
    """Carry the state on by one smooth piece; return its duration (s) and what ended it."""
    if s.turning_sense == 0.0:
        s.acceleration_rad_per_s2 = 0.0
        span = release_time(model, s, drive, t, left)
        return span, SPAN_ENDED if span == left else AT_REST
    y, tolerance, size = np.empty(STATE_SIZE), np.empty(STATE_SIZE), TOLERANCE * work_scale(model, s, left)
    before, near, regime = s.angle_rad, within_a_turn(s.angle_rad), int(s.regime)
    fill_shaft(y, ShaftState(near, s.speed_rad_per_s, s.drive_work_j, s.gear_loss_j, s.friction_loss_j))
    fill_shaft(tolerance, ShaftState(TOLERANCE * 1.0, TOLERANCE * (1.0 + abs(s.speed_rad_per_s)), size, size, size))
    system = DrivenMechanism(model.mechanism, turning(drive, s.turning_sense), regime)
    span, what, e = turn_crank(system, t, y, left, s.turning_sense, aim - (before - near), tolerance)
    if what in (NOT_INTEGRATED, TOO_MANY_STEPS):
        return span, what
    if what == AT_REST and s.speed_rad_per_s == 0.0 and span == 0.0:  # on the edge of sticking, within rounding
        s.turning_sense, s.acceleration_rad_per_s2 = 0.0, 0.0
        return left, SPAN_ENDED
    after = shaft_state(y)
    f, w, work = after.angle_rad, after.speed_rad_per_s, after.drive_work_j
    if near != before:
        f = aim if what == AT_ANGLE else before + (after.angle_rad - near)
        work += rounding_work(model, f, w, e, regime, (f - before) - (after.angle_rad - near))
    s.load_work_j = s.load_work_j + mechanism_load_work(model.mechanism, before, f, regime)
    s.angle_rad, s.speed_rad_per_s, s.acceleration_rad_per_s2 = f, w, e
    s.drive_work_j, s.gear_loss_j, s.friction_loss_j = work, after.gear_loss_j, after.friction_loss_j
    return span, what


@kernel
def drive_on(
    model: TurnedCrank, s: Any, start_s: float, drive: ShaftDrive, command: float, log: Array
) -> tuple[Array, int, float]:
    """Carry the state through a step behind a motor; return events, and the friction torque (N m) at rest."""
    crank, count, done = model.crank, 0, 0.0
    for _ in range(MOST_PIECES):
        if s.speed_rad_per_s == 0.0:
            log, count = set_off(model, s, start_s + done, drive, done, command, log, count)
        boundary, aim = next_boundary(crank, s)
        span, what = turn(model, s, drive, done, crank.step_s - done, aim)
        if what in (NOT_INTEGRATED, TOO_MANY_STEPS):
            return log, UNSTEADY if what == NOT_INTEGRATED else TOO_LONG, 0.0
        done += span
        if what == SPAN_ENDED:
            held = 0.0
            if s.turning_sense == 0.0:
                sense, held, share = rest(model, s, drive, done)
                s.turning_sense, s.acceleration_rad_per_s2, s.load_share = sense, 0.0, share
            return log, count, held
        if what == AT_ANGLE and boundary >= 0:
            log, count = apply_boundary(model, s, boundary, start_s + done, log, count)
    return log, TOO_MANY, 0.0
