"""One coupling step of a linkage with one freedom, as kernels over any mechanism of `crank_state`.

Between two boundaries of the crank angle the regime is constant, and between two instants of rest the sense of turning
is, so a step is cut there and each piece is smooth.  With a prescribed speed the crank angle is a parabola in time and
the cuts are roots of it; with a motor they are found on the integrated motion.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.compiled_steps import linkage_step, log_event, step_of
from mech_twin.engine.crank_motion import (
    AT_ANGLE,
    AT_REST,
    LONGEST_TURN_RAD,
    NOT_INTEGRATED,
    SPAN_ENDED,
    STATE_SIZE,
    ShaftDrive,
    integrated_work,
    turn_crank,
)
from mech_twin.engine.crank_state import (
    LARGE_ANGLE,
    TURN,
    Crank,
    driven_system,
    led_system,
    mechanism_load_speed,
    mechanism_load_work,
    mechanism_state,
    shaft_drive,
    turning,
    under_load_share,
    within_a_turn,
)
from mech_twin.engine.sample_vectors import (
    COMMAND,
    EVENT_WIDTH,
    LINKAGE_JOINTS,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    REGIME,
    SIDES,
    Array,
)
from mech_twin.kernel import kernel
from mech_twin.parts.friction import released
from mech_twin.parts.gear import GearTorque, gear_split

MOST_PIECES = 10_000  # of one coupling step
TOLERANCE = 1e-12  # of a step: angle in rad, speed and works over their size
HELD_SHARE = 0.01  # of the energy held and moved: no error of work is asked to be below its rounding
# state within a step: angle, speed, acceleration, sense of turning, works and losses (J), regime, whether a supply that
# is on does not turn the crank, share of the load that acts, angle at which the crank last turned back
F, W, E, SENSE, DRIVE_WORK, GEAR_LOSS, FRICTION_LOSS, LOAD_WORK, AT_REGIME, IS_STALLED, SHARE, MARK = range(12)
STATES = 12
# places in `crank_state.Memory`, from its begin in a row
(
    M_ACCELERATION, M_FRICTION, M_SENSE, M_STALLED, M_SHARE, M_MARK, M_DRIVE_WORK, M_GEAR_LOSS, M_FRICTION_LOSS,
    M_LOAD_WORK, M_ADJUSTMENT, M_ENERGY, M_INITIAL,
) = range(13)  # fmt: skip
MEMORY_SIZE = 13
KINDS = ("started", "stopped", "stalled", "reversed")  # then those of the boundaries
STARTED, STOPPED, STALLED, REVERSED = range(4)
CRANK_CONTACT, LOAD_CONTACT = 0, 1
TOO_MANY, WORK_UNKNOWN, UNSTEADY, NO_TORQUE = -1, -2, -3, -4
FAILURES = (
    f"more than {MOST_PIECES} changes of regime",
    "the drive's work has no integral: the mechanism does not turn through",
    "no integration step is small enough for the crank",
    "the crank torque is not finite",
)


class TurnedCrank(NamedTuple):
    """A crank linkage: its constants, and those of its mechanism."""

    crank: Crank
    mechanism: Any


@kernel
def sign_of(value: float) -> float:
    """Return the sign of a number, 0 of 0."""
    return 0.0 if value == 0.0 else math.copysign(1.0, value)


@kernel
def load_torque(mechanism: Any, f: float, regime: int) -> float:
    """Return the torque (N m) that holds the mechanism at rest."""
    _, _, torque, _, _ = mechanism_state(mechanism, f, 0.0, 0.0, regime)
    return float(torque)


@kernel
def turned_over(s: Array) -> float:
    """Return the work (J) turned over, at least 1."""
    return float(max(1.0, abs(s[DRIVE_WORK]), abs(s[LOAD_WORK]), s[FRICTION_LOSS]))


@kernel
def work_scale(model: TurnedCrank, s: Array, h: float) -> float:
    """Return the size (J) an error of work is measured by: what was turned over, or is held and moved in ``h`` (s)."""
    friction, w, e = model.crank.friction, s[W], s[E]
    _, _, torque, energy, _ = mechanism_state(model.mechanism, s[F], w, e, int(s[AT_REGIME]))
    resisting = friction.coulomb_nm + friction.viscous_nms_per_rad * abs(w)
    moved = (abs(torque) + resisting) * (abs(w) + abs(e) * h) * h
    return max(turned_over(s), HELD_SHARE * float(abs(energy) + moved))


@kernel
def rounding_work(model: TurnedCrank, f: float, w: float, e: float, regime: int, rounded: float) -> float:
    """Return the work (J) on the way ``rounded`` (rad) that a large angle f has more than its step has integrated.

    Equal steps round alike, so it adds up over hours.
    """
    _, _, torque, _, _ = mechanism_state(model.mechanism, f, w, e, regime)
    return float(torque * rounded)


@kernel
def next_boundary(crank: Crank, s: Array) -> tuple[int, float]:
    """Return the next boundary in the sense of turning (-1: none), and its angle in this turn (rad)."""
    best, aim = -1, math.copysign(math.inf, s[SENSE])
    for i in range(len(crank.boundaries)):
        angle, sign = crank.boundaries[i, 0], crank.boundaries[i, 1]
        if crank.boundaries[i, 2] != s[AT_REGIME] or sign != s[SENSE]:
            continue
        if math.isnan(angle):
            angle = s[MARK]
        else:
            turns = math.floor(sign * (s[F] - angle) / TURN) + 1.0
            angle = angle + sign * turns * TURN
        if best < 0 or sign * (angle - aim) < 0.0:
            best, aim = i, angle
    return best, aim


@kernel
def period_of(crank: Crank, f: float, sense: float) -> float:
    """Return the turn of a crank angle, counted from 0 in the sense of turning."""
    return max(0.0, float(math.floor((f - crank.start_rad) / TURN * (1.0 if sense >= 0.0 else -1.0))))


@kernel
def log_sides(log: Array, count: int, f: float, w: float, before_nm: float, after_nm: float) -> None:
    """Write angle, speed and torque of the crank on either side of an event."""
    log[count, SIDES] = 1.0
    for side in range(2):
        log[count, EVENT_WIDTH + 3 * side], log[count, EVENT_WIDTH + 3 * side + 1] = f, w
    log[count, EVENT_WIDTH + 2], log[count, EVENT_WIDTH + 5] = before_nm, after_nm


@kernel
def apply_boundary(
    model: TurnedCrank, s: Array, boundary: int, time_s: float, log: Array, count: int
) -> tuple[Array, int]:
    """Change the regime, and log the event with the speed of the loaded point."""
    crank, mechanism = model.crank, model.mechanism
    before, after = int(s[AT_REGIME]), int(crank.boundaries[boundary, 3])
    speed = mechanism_load_speed(mechanism, s[F], s[W])
    kind, period = int(crank.boundaries[boundary, 4]), period_of(crank, s[F], s[SENSE])
    log = log_event(log, count, time_s, kind, LOAD_CONTACT, speed, speed, 0.0, period)
    torque = mechanism_state(mechanism, s[F], s[W], s[E], before)[2]
    log_sides(log, count, s[F], s[W], torque, mechanism_state(mechanism, s[F], s[W], s[E], after)[2])
    s[AT_REGIME] = after
    return log, count + 1


@kernel
def turn_back(crank: Crank, s: Array) -> None:
    """Take the crank out of a load that only resists where it sets off against its sense."""
    for i in range(len(crank.resisting)):
        if crank.resisting[i, 0] == s[AT_REGIME] and s[SENSE] != 0.0 and s[SENSE] != crank.resisting[i, 1]:
            s[AT_REGIME], s[MARK] = crank.resisting[i, 2], s[F]
            return


# ---- prescribed speed


@kernel
def led_state(model: TurnedCrank, s: Array, h: float, end: float) -> bool:
    """Carry the state on for h (s) to an angle (rad) at constant acceleration; return whether the work is known."""
    friction, w, e = model.crank.friction, s[W], s[E]
    lost = friction.coulomb_nm * abs(end - s[F])
    lost += friction.viscous_nms_per_rad * h * (w * w + w * e * h + e * e * h * h / 3.0)
    work, regime, after = 0.0, int(s[AT_REGIME]), w + e * h
    if h > 0.0:
        system = led_system(model.mechanism, within_a_turn(s[F]), w, e, regime)
        fastest = max(abs(w), abs(after), 1e-9)
        work = integrated_work(system, h, TOLERANCE * work_scale(model, s, h), LONGEST_TURN_RAD / fastest)
    if abs(end) >= LARGE_ANGLE:
        work += rounding_work(model, end, after, e, regime, (end - s[F]) - (w + 0.5 * e * h) * h)
    s[LOAD_WORK] = s[LOAD_WORK] + mechanism_load_work(model.mechanism, s[F], end, regime)
    s[F], s[W] = end, after
    s[DRIVE_WORK] = s[DRIVE_WORK] + work + lost
    s[FRICTION_LOSS] = s[FRICTION_LOSS] + lost
    return math.isfinite(work)


@kernel
def led_piece(s: Array, left: float, aim: float) -> tuple[float, float, int]:
    """Return duration (s), end (rad) and ending of the next smooth piece at constant acceleration."""
    span, what, w, e = left, SPAN_ENDED, s[W], s[E]
    turns_back = -w / e if w * e < 0.0 else math.inf
    if turns_back < left:
        span, what = turns_back, AT_REST
    end = s[F] + (w + 0.5 * e * span) * span
    if s[SENSE] * (end - aim) >= 0.0 and math.isfinite(aim):
        way = aim - s[F]
        root = math.sqrt(max(w * w + 2.0 * e * way, 0.0))
        below = w + s[SENSE] * root
        span, what, end = min(span, 2.0 * way / below if below != 0.0 else 0.0), AT_ANGLE, aim
    return span, end, what


@kernel
def holding_torque(model: TurnedCrank, s: Array) -> float:
    """Return the friction torque (N m) at rest: all it can carry of the load, the drive holds what is left."""
    needed, coulomb = load_torque(model.mechanism, s[F], int(s[AT_REGIME])), model.crank.friction.coulomb_nm
    return min(max(needed, -coulomb), coulomb)


@kernel
def lead(model: TurnedCrank, s: Array, start_s: float, speed: float, log: Array) -> tuple[Array, int, float]:
    """Carry the state through a step to a speed (rad/s); return events, and the friction torque (N m) at rest."""
    crank, count, done = model.crank, 0, 0.0
    e = (speed - s[W]) / crank.step_s
    for _ in range(MOST_PIECES):
        s[E] = e
        s[SENSE] = sign_of(s[W]) if s[W] != 0.0 else sign_of(e)
        boundary, aim = next_boundary(crank, s)
        span, end, what = led_piece(s, crank.step_s - done, aim)
        if not led_state(model, s, span, end):
            return log, WORK_UNKNOWN, 0.0
        done += span
        if what == SPAN_ENDED:
            s[W] = speed
            return log, count, holding_torque(model, s) if s[SENSE] == 0.0 else 0.0
        if what == AT_ANGLE and boundary >= 0:
            log, count = apply_boundary(model, s, boundary, start_s + done, log, count)
        elif what == AT_REST:
            s[W], s[SENSE] = 0.0, sign_of(s[E])
            turn_back(crank, s)
    return log, TOO_MANY, 0.0


# ---- motor


@kernel
def grip_at_rest(drive: ShaftDrive, t: float) -> GearTorque:
    """Return what the gear passes on to a crank at rest at a time of the step (s)."""
    torque = drive.torque_nm - drive.speed_slope * drive.ratio * drive.speed + drive.time_slope * t
    torque = min(max(torque, -drive.torque_limit_nm), drive.torque_limit_nm)
    return gear_split(drive.ratio, drive.efficiency, torque)


@kernel
def driving_torque(model: TurnedCrank, s: Array, mean: float, limit: float) -> tuple[float, float]:
    """Return the torque (N m) that would turn a crank at rest, and the share of the load that acts on it.

    A load that only resists takes of itself what holds the crank, from nothing to the whole.
    """
    regime, mechanism = int(s[AT_REGIME]), model.mechanism
    whole = load_torque(mechanism, s[F], regime)
    for i in range(len(model.crank.resisting)):
        if model.crank.resisting[i, 0] != regime:
            continue
        bare = load_torque(mechanism, s[F], int(model.crank.resisting[i, 2]))
        if model.crank.resisting[i, 1] * (mean - whole) > limit:
            return mean - whole, 1.0
        share = 0.0 if whole == bare else min(max((mean - bare) / (whole - bare), 0.0), 1.0)
        return mean - bare - share * (whole - bare), share
    return mean - whole, 1.0


@kernel
def rest(model: TurnedCrank, s: Array, drive: ShaftDrive, t: float) -> tuple[float, float, float]:
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
    model: TurnedCrank, s: Array, time_s: float, drive: ShaftDrive, t: float, command: float, log: Array, count: int
) -> tuple[Array, int]:
    """Give a crank without speed the sense in which it goes on, 0 where it sticks, and log that."""
    crank, past, regime, stalled = model.crank, s[SENSE], int(s[AT_REGIME]), s[IS_STALLED]
    sense, _, share = rest(model, s, drive, t)
    s[SENSE], s[E], s[SHARE] = sense, 0.0, share
    if sense != 0.0:
        s[IS_STALLED] = 0.0
        turn_back(crank, s)
    held_for_good = sense == 0.0 and past == 0.0 and command != 0.0 and drive.time_slope == 0.0
    if sense == past and (not held_for_good or stalled != 0.0):
        return log, count
    kind = STARTED if past == 0.0 else STOPPED if sense == 0.0 else REVERSED
    if held_for_good or past * command > 0.0:
        kind, s[IS_STALLED] = STALLED, 1.0 if sense == 0.0 else 0.0
    smooth = grip_at_rest(drive, t).friction_nm + crank.friction.coulomb_nm == 0.0
    if kind != STALLED and smooth:
        return log, count
    torque = load_torque(model.mechanism, s[F], regime)
    log = log_event(log, count, time_s, kind, CRANK_CONTACT, 0.0, 0.0, 0.0, period_of(crank, s[F], past))
    log_sides(log, count, s[F], 0.0, torque, torque)
    return log, count + 1


@kernel
def release_time(model: TurnedCrank, s: Array, drive: ShaftDrive, t: float, left: float) -> float:
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
def turn(model: TurnedCrank, s: Array, drive: ShaftDrive, t: float, left: float, aim: float) -> tuple[float, int]:
    """Carry the state on by one smooth piece; return its duration (s) and what ended it."""
    if s[SENSE] == 0.0:
        s[E] = 0.0
        span = release_time(model, s, drive, t, left)
        return span, SPAN_ENDED if span == left else AT_REST
    size, y, tolerance = work_scale(model, s, left), np.empty(STATE_SIZE), np.empty(STATE_SIZE)
    near, regime = within_a_turn(s[F]), int(s[AT_REGIME])
    y[0], y[1], y[2], y[3], y[4] = near, s[W], s[DRIVE_WORK], s[GEAR_LOSS], s[FRICTION_LOSS]
    tolerance[0], tolerance[1] = TOLERANCE * 1.0, TOLERANCE * (1.0 + abs(s[W]))
    tolerance[2:] = TOLERANCE * size
    system = driven_system(model.mechanism, turning(drive, s[SENSE]), regime)
    span, what, e = turn_crank(system, t, y, left, s[SENSE], aim - (s[F] - near), tolerance)
    if what == NOT_INTEGRATED:
        return span, what
    if what == AT_REST and s[W] == 0.0 and span == 0.0:  # on the edge of sticking, within rounding
        s[SENSE], s[E] = 0.0, 0.0
        return left, SPAN_ENDED
    f = y[0]
    if near != s[F]:
        f = aim if what == AT_ANGLE else s[F] + (y[0] - near)
        y[2] += rounding_work(model, f, y[1], e, regime, (f - s[F]) - (y[0] - near))
    s[LOAD_WORK] = s[LOAD_WORK] + mechanism_load_work(model.mechanism, s[F], f, regime)
    s[F], s[W], s[E], s[DRIVE_WORK], s[GEAR_LOSS], s[FRICTION_LOSS] = f, y[1], e, y[2], y[3], y[4]
    return span, what


@kernel
def drive_on(
    model: TurnedCrank, s: Array, start_s: float, drive: ShaftDrive, command: float, log: Array
) -> tuple[Array, int, float]:
    """Carry the state through a step behind a motor; return events, and the friction torque (N m) at rest."""
    crank, count, done = model.crank, 0, 0.0
    for _ in range(MOST_PIECES):
        if s[W] == 0.0:
            log, count = set_off(model, s, start_s + done, drive, done, command, log, count)
        boundary, aim = next_boundary(crank, s)
        span, what = turn(model, s, drive, done, crank.step_s - done, aim)
        if what == NOT_INTEGRATED:
            return log, UNSTEADY, 0.0
        done += span
        if what == SPAN_ENDED:
            held = 0.0
            if s[SENSE] == 0.0:
                sense, held, share = rest(model, s, drive, done)
                s[SENSE], s[E], s[SHARE] = sense, 0.0, share
            return log, count, held
        if what == AT_ANGLE and boundary >= 0:
            log, count = apply_boundary(model, s, boundary, start_s + done, log, count)
    return log, TOO_MANY, 0.0


# ---- both


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
