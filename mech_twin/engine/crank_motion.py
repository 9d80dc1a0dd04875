# SPDX-License-Identifier: Apache-2.0
r"""Equation of motion of a crank-driven linkage with one degree of freedom, as declared to the event loop.

::

    motor --[ gear i, eta ]--> shaft inertia J --> crank: angle f, speed w, friction c, v --> I_pr(f), M_pr(f)

    (I_pr + J) w' + w^2/2 dI_pr/df = M_pr + mean of the gear - v w + lam
    M(t, w) = the motor's curve at i w, from the torque it reported at t_n (`torque_in_step`)

One law acts at the crank: loss of the gear, Coulomb friction, and a load that only resists.  Its bounds are the sums of
theirs.  A prescribed speed is a crank of known acceleration, whose drive takes what the mechanism needs.
"""

import math
from typing import Any, NamedTuple

from mech_twin.engine.compiled_steps import fill_event
from mech_twin.engine.crank_state import (
    LARGE_ANGLE,
    TURN,
    Crank,
    ShaftDrive,
    count_torque_energy,
    mechanism_drive_moment,
    mechanism_load_speed,
    mechanism_load_work,
    mechanism_reduced,
)
from mech_twin.engine.hybrid import laws
from mech_twin.engine.hybrid.laws import HIGH, HOLD, LOW, Array, Equations, Indices
from mech_twin.engine.hybrid.loop import Room
from mech_twin.engine.hybrid.motion import settle_regimes
from mech_twin.engine.hybrid.type_erasure import Declared
from mech_twin.engine.sample_vectors import EVENT_WIDTH, SIDES
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel
from mech_twin.parts.friction_and_gear import gear_split
from mech_twin.parts.induction_motor import torque_in_step

TOLERANCE = 1e-12  # of a step: angle in rad, speed and works over their size
HELD_SHARE = 0.01  # of the energy held and moved: the tolerance of work stays above its rounding
ROUNDING = 4e-15  # relative, of an angle
KINDS = ("started", "stopped", "stalled", "reversed")  # then those of the boundaries
STARTED, STOPPED, STALLED, REVERSED = range(4)
CRANK_CONTACT, LOAD_CONTACT = 0, 1
ANGLE, SPEED, DRIVE_WORK, GEAR_LOSS, FRICTION_LOSS = range(5)  # the state that is integrated; the angle within a turn
STATE_SIZE = 5
TURNED, LOAD_WORK, STALLED_1, TURNED_BACK, AIM, BOUNDARY = range(6)  # stored values: whole angle, work of load, ...
BEGIN_ROOM = STATE_SIZE + 6  # of the numbers a step computes in
CRANK_LAW, MECHANISM_REGIME = 0, 1


@laws.of_size(1, 1)
class TurningCrank(NamedTuple):
    """A crank within a coupling step: its drive, or prescribed acceleration ``e`` (rad/s2); command; stored values."""

    model: Any
    drive: ShaftDrive
    e: float
    command: float
    kept: Array


@embedded_kernel
def sign_of(value: float) -> float:
    """Return the sign of a number, 0 of 0."""
    return 0.0 if value == 0.0 else math.copysign(1.0, value)


@embedded_kernel
def turning_sense(regime: int) -> float:
    """Return the sense of rotation (+1, -1, 0 at rest) of a regime of the crank's law."""
    return 1.0 if regime == LOW else -1.0 if regime == HIGH else 0.0


@embedded_kernel
def resisting_row(crank: Crank, regime: int) -> int:
    """Return the row of the purely resisting load of a regime, -1 where there is none."""
    for i in range(len(crank.resisting)):
        if crank.resisting[i, 0] == regime:
            return i
    return -1


@embedded_kernel
def load_torque(mechanism: Any, f: float, regime: int) -> float:
    """Return the torque (N m) that holds the mechanism at rest."""
    return float(count_torque_energy(mechanism, f, 0.0, 0.0, regime)[1])


@laws.declares(laws.evaluate, TurningCrank)
def evaluate_crank(motion: TurningCrank, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill inertia, moment and the bounds of the one law at the crank."""
    crank, drive, f, w = motion.model.crank, motion.drive, y[ANGLE], y[SPEED]
    at.directions[0, 0] = 1.0
    if crank.drive.prescribed:
        at.mass[0, 0], at.force[0], at.low[0], at.high[0] = 1.0, motion.e, 0.0, 0.0
        return
    regime = regimes[MECHANISM_REGIME]
    inertia, slope, moment = mechanism_reduced(motion.model.mechanism, f, regime)
    grip = gear_split(drive.ratio, drive.efficiency, torque_in_step(drive.motor, t, drive.ratio * w))
    limit = grip.friction_nm + drive.coulomb_nm
    at.low[0], at.high[0] = -limit, limit
    row = resisting_row(crank, regime)
    if row >= 0:
        bare = mechanism_reduced(motion.model.mechanism, f, int(crank.resisting[row, 2]))[2]
        if crank.resisting[row, 1] > 0.0:
            at.low[0] += moment - bare
        else:
            at.high[0] += moment - bare
        moment = bare
    at.mass[0, 0] = inertia + drive.shaft_inertia_kg_m2
    at.force[0] = grip.mean_nm + moment - 0.5 * w * w * slope - drive.viscous_nms_per_rad * w


@laws.declares(laws.accumulate, TurningCrank)
def accumulate_work(motion: TurningCrank, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    """Fill the power on the mechanism, and the power lost in the gear and by friction (W).

    At a prescribed speed the power is that of the moment from the pin forces.  The load's work is in closed form and
    the energy from the reduced inertia, so the energy balance compares three routes.
    """
    drive, w, sense = motion.drive, y[SPEED], turning_sense(regimes[CRANK_LAW])
    lost = (drive.coulomb_nm * sense + drive.viscous_nms_per_rad * w) * w
    out[FRICTION_LOSS], out[GEAR_LOSS] = lost, 0.0
    if motion.model.crank.drive.prescribed:
        regime = regimes[MECHANISM_REGIME]
        out[DRIVE_WORK] = mechanism_drive_moment(motion.model.mechanism, y[ANGLE], w, motion.e, regime) * w + lost
        return
    torque = torque_in_step(drive.motor, t, drive.ratio * w)
    grip = gear_split(drive.ratio, drive.efficiency, torque)
    given = grip.mean_nm - sense * grip.friction_nm
    out[DRIVE_WORK] = (given - drive.shaft_inertia_kg_m2 * at.acceleration[0]) * w
    out[GEAR_LOSS] = drive.ratio * torque * w - given * w


@laws.declares(laws.fill_signals, TurningCrank)
def signal_boundary(
    motion: TurningCrank, t: float, y: Array, regimes: Indices, at: Equations, values: Array, rates: Array
) -> None:
    """Fill the angle left to the next boundary of the load (rad) and its rate."""
    sense = turning_sense(regimes[CRANK_LAW])
    values[2] = math.inf
    if motion.kept[BOUNDARY] >= 0.0 and sense != 0.0:
        values[2], rates[2] = sense * (motion.kept[AIM] - y[ANGLE]), -sense * y[SPEED]


@laws.declares(laws.begin_piece, TurningCrank)
def find_boundary(motion: TurningCrank, t: float, y: Array, regimes: Indices) -> None:
    """Store the next boundary in the sense of rotation, and its angle (rad) counted as ``y[ANGLE]`` is.

    One behind by no more than rounding is next: passed, it would have changed the regime.
    """
    boundaries, kept, sense = motion.model.crank.boundaries, motion.kept, turning_sense(regimes[CRANK_LAW])
    best, aim = -1, math.copysign(math.inf, sense)
    for i in range(len(boundaries)):
        angle, sign = boundaries[i, 0], boundaries[i, 1]
        if boundaries[i, 2] != regimes[MECHANISM_REGIME] or sign != sense:
            continue
        if math.isnan(angle):
            angle = kept[TURNED_BACK]
        else:
            behind = sign * (kept[TURNED] - angle) - ROUNDING * (TURN + abs(kept[TURNED]))
            angle += sign * TURN * (math.floor(behind / TURN) + 1.0)
        if best < 0 or sign * (angle - aim) < 0.0:
            best, aim = i, angle
    kept[BOUNDARY], kept[AIM] = best, aim - (kept[TURNED] - y[ANGLE])


@laws.declares(laws.end_piece, TurningCrank)
def book_load(motion: TurningCrank, t: float, before: Array, y: Array, regimes: Indices) -> None:
    """Add the load's closed-form work (J), correct the drive's for rounding of a large angle, and store the angle."""
    mechanism, regime, past = motion.model.mechanism, regimes[MECHANISM_REGIME], motion.kept[TURNED]
    now = past + (y[ANGLE] - before[ANGLE])
    if abs(now) >= LARGE_ANGLE:
        torque = count_torque_energy(mechanism, y[ANGLE], y[SPEED], 0.0, regime)[1]
        y[DRIVE_WORK] += torque * ((now - past) - (y[ANGLE] - before[ANGLE]))
    motion.kept[LOAD_WORK] += mechanism_load_work(mechanism, past, now, regime)
    motion.kept[TURNED] = now


@borrowing_kernel
def log_crank(
    motion: TurningCrank, time_s: float, kind: int, contact: int, speeds: tuple[float, float, float],
    torques: tuple[float, float], log: Array, count: int
) -> int:  # fmt: skip
    """Log an event with the speeds of contact (m/s) and crank (rad/s), and the crank torque before and after (N m)."""
    (contact_speed, w, sense), turned = speeds, motion.kept[TURNED]
    turns = math.floor((turned - motion.model.crank.start_rad) / TURN * (1.0 if sense >= 0.0 else -1.0))
    fill_event(log, count, time_s, kind, contact, contact_speed, contact_speed, 0.0, max(0.0, float(turns)))
    log[count, SIDES] = 1.0
    for side in range(2):
        log[count, EVENT_WIDTH + 3 * side], log[count, EVENT_WIDTH + 3 * side + 1] = turned, w
        log[count, EVENT_WIDTH + 3 * side + 2] = torques[side]
    return count + 1


@laws.declares(laws.pass_signal, TurningCrank)
def pass_boundary(
    motion: TurningCrank, which: int, t: float, y: Array, regimes: Indices, log: Array, count: int
) -> int:
    """Change the regime of the load at its boundary, and log the event with the speed of the loaded point (m/s)."""
    crank, mechanism, kept, w = motion.model.crank, motion.model.mechanism, motion.kept, y[SPEED]
    row, before = int(kept[BOUNDARY]), regimes[MECHANISM_REGIME]
    after, kind = int(crank.boundaries[row, 3]), int(crank.boundaries[row, 4])
    kept[TURNED], y[ANGLE] = kept[TURNED] + (kept[AIM] - y[ANGLE]), kept[AIM]
    f = kept[TURNED]
    speed = mechanism_load_speed(mechanism, f, w)
    torques = (
        count_torque_energy(mechanism, f, w, 0.0, before)[1],
        count_torque_energy(mechanism, f, w, 0.0, after)[1],
    )
    regimes[MECHANISM_REGIME] = after
    sense = turning_sense(regimes[CRANK_LAW])
    return log_crank(motion, t + motion.drive.start_s, kind, LOAD_CONTACT, (speed, w, sense), torques, log, count)


@laws.declares(laws.change_regimes, TurningCrank)
def change_sense(
    motion: TurningCrank, t: float, y: Array, past: Indices, regimes: Indices, at: Equations, log: Array, count: int
) -> int:
    """Log that the crank stops, starts, reverses or stalls; remove a purely resisting load where it reverses."""
    crank, kept = motion.model.crank, motion.kept
    before, sense = turning_sense(past[CRANK_LAW]), turning_sense(regimes[CRANK_LAW])
    y[SPEED] = 0.0
    row = resisting_row(crank, regimes[MECHANISM_REGIME])
    load = regimes[MECHANISM_REGIME]
    if row >= 0 and sense != 0.0 and sense != crank.resisting[row, 1]:
        regimes[MECHANISM_REGIME], kept[TURNED_BACK] = int(crank.resisting[row, 2]), kept[TURNED]
    if crank.drive.prescribed:
        return count
    if sense != 0.0:
        kept[STALLED_1] = 0.0
    if sense == before:
        return count
    kind = STARTED if before == 0.0 else STOPPED if sense == 0.0 else REVERSED
    if before * motion.command > 0.0:
        kind, kept[STALLED_1] = STALLED, 1.0 if sense == 0.0 else 0.0
    torque = torque_in_step(motion.drive.motor, t, 0.0)
    smooth = gear_split(motion.drive.ratio, motion.drive.efficiency, torque).friction_nm + crank.friction.coulomb_nm
    if kind != STALLED and smooth == 0.0:
        return count
    held = load_torque(motion.model.mechanism, y[ANGLE], load)
    return log_crank(
        motion, t + motion.drive.start_s, kind, CRANK_CONTACT, (0.0, 0.0, before), (held, held), log, count
    )


@borrowing_kernel
def note_stall(motion: TurningCrank, system: Declared, y: Array, regimes: Indices, room: Room, log: Array) -> int:
    """Log a stall once: the crank stays at rest under a constant supply that is on."""
    if motion.model.crank.drive.prescribed or regimes[CRANK_LAW] != HOLD or motion.kept[STALLED_1] != 0.0:
        return 0
    if motion.command == 0.0 or motion.drive.motor.command_per_s != 0.0:
        return 0
    room.candidates[0] = 1
    settle_regimes(system, 0.0, y, regimes, room.candidates, room.at)
    if regimes[CRANK_LAW] != HOLD:
        regimes[CRANK_LAW] = HOLD
        return 0
    motion.kept[STALLED_1] = 1.0
    held = load_torque(motion.model.mechanism, y[ANGLE], regimes[MECHANISM_REGIME])
    return log_crank(motion, motion.drive.start_s, STALLED, CRANK_CONTACT, (0.0, 0.0, 0.0), (held, held), log, 0)


@embedded_kernel
def turned_over(y: Array, load_work: float) -> float:
    """Return the largest of drive, load and friction work (J), at least 1: the scale of the energy balance."""
    return float(max(1.0, abs(y[DRIVE_WORK]), abs(load_work), y[FRICTION_LOSS]))


@borrowing_kernel
def fill_tolerance(model: Any, y: Array, e: float, regime: int, load_work: float, out: Array) -> None:
    """Fill the error tolerances of a step; those of works scale with the work done, or the energy held and moved."""
    friction, w, h = model.crank.friction, y[SPEED], model.crank.step_s
    _, torque, energy = count_torque_energy(model.mechanism, y[ANGLE], w, e, regime)
    resisting = friction.coulomb_nm + friction.viscous_nms_per_rad * abs(w)
    moved = (abs(torque) + resisting) * (abs(w) + abs(e) * h) * h
    size = TOLERANCE * max(turned_over(y, load_work), HELD_SHARE * float(abs(energy) + moved))
    out[ANGLE], out[SPEED] = TOLERANCE, TOLERANCE * (1.0 + abs(w))
    out[DRIVE_WORK] = out[GEAR_LOSS] = out[FRICTION_LOSS] = size


@borrowing_kernel
def held_shares(motion: TurningCrank, y: Array, regimes: Indices, at: Equations) -> tuple[float, float]:
    """Return static bearing friction (N m) and share of the load that acts at rest; the load acts first.

    At a prescribed speed friction carries the load up to its limit, and the drive the rest.
    """
    crank, mechanism, regime = motion.model.crank, motion.model.mechanism, regimes[MECHANISM_REGIME]
    coulomb = crank.friction.coulomb_nm
    if crank.drive.prescribed:
        return min(max(load_torque(mechanism, y[ANGLE], regime), -coulomb), coulomb), 1.0
    held, share, limit, row = at.multiplier[0], 1.0, at.high[0], resisting_row(crank, regime)
    if row >= 0:
        limit = min(at.high[0], -at.low[0])
        load = (at.low[0] + at.high[0]) if crank.resisting[row, 1] != 0.0 else 0.0
        share = 0.0 if load == 0.0 else min(max(held / load, 0.0), 1.0)
        held -= share * load
    return held * (coulomb / limit if limit > 0.0 else 0.0), share
