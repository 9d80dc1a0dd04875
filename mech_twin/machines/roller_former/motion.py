# SPDX-License-Identifier: Apache-2.0
"""Equations of motion of the roller former, as declared to the event loop, and what the loop integrates.

Two laws act: at the crank, friction of the shaft and a load that opposes the motion; at the drive, the loss of the
gear.  Further signals: dead centres (kinks of the load), start and end of the load's rise, stall threshold and time.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.compiled_steps import LOG_FULL, fill_event
from mech_twin.engine.hybrid import laws
from mech_twin.engine.hybrid.laws import HIGH, HOLD, LOW, OPEN, Array, Equations, Indices
from mech_twin.engine.hybrid.loop import ENDED, MOST_PIECES, MOST_STEPS, UNSTEADY, advance, room_in, room_sizes
from mech_twin.engine.hybrid.type_erasure import declared
from mech_twin.engine.integration import DORMAND_PRINCE_8, SHORTEST_S
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel, inline_kernel, kernel
from mech_twin.machines.roller_former.cart_parameters import NONE, PRINTED
from mech_twin.machines.roller_former.cart_statics import (
    LOOK_AHEAD_RAD,
    load_moment,
    rod_weight_moment,
    shaft_terms,
    sides_of_travel,
)
from mech_twin.machines.roller_former.dynamics import (
    STATE_SIZE,
    Former,
    coupling_moment,
    geared,
    may_stick,
    modes_of,
    shaft_torque,
    state_of,
)
from mech_twin.parts.friction_and_gear import gear_split
from mech_twin.parts.induction_motor import MotorInStep

EVENT_KINDS = ("held", "released", "load_engaged", "stall", "recovered")
HELD_EVENT, RELEASED_EVENT, ENGAGED_EVENT, STALL_EVENT, RECOVERED_EVENT = range(len(EVENT_KINDS))
TURN = 2.0 * np.pi
FAR_RAD = 1e300
CRANK, TWIST, SPEED, DRIVE = 0, 1, 2, 3  # places in the state, which has the speed of the drive for its twist rate
CRANK_LAW, DRIVE_LAW, LOAD_ON, IS_SLOW, IS_STALLED = range(5)  # places in the regimes
SIDE_AHEAD, SIDE_BEHIND, ENGAGES, CROSSES, IN_FULL, STALLS, STOPS = range(7)  # own signals
# kept from piece to piece; the whole load (N m) of the instant evaluated last
SHARE, SLOW_S, SINCE_S, LOW_RAD, HIGH_RAD, PASSED, LOAD, KEPT = range(8)
OWN_SIGNALS = 7
LAWS = 2


@laws.of_size(2, LAWS)
class FormerMotion(NamedTuple):
    """The system: constants, motor torque, crank angle to stop at (rad); stored values; half turns of the carts."""

    former: Former
    torque: MotorInStep
    begin_s: float
    stop_rad: float
    kept: Array
    sides: Array


@embedded_kernel
def sense_of(regime: int) -> float:
    """Return the direction of rotation: 0 while sticking, 1 for a shaft that cannot stick."""
    return -1.0 if regime == HIGH else 0.0 if regime == HOLD else 1.0


@embedded_kernel
def regime_of(sticks: bool, speed: float, sense: float) -> int:
    """Return the regime of a law; at rest that of the stored direction."""
    return laws.regime_of(speed if speed != 0.0 else sense) if sticks else OPEN


@embedded_kernel
def share_rate(motion: FormerMotion, regimes: Indices) -> float:
    """Return the rate of the load's rise (1/s)."""
    rises = regimes[LOAD_ON] == 1 and motion.kept[SHARE] < 1.0
    return 1.0 / motion.former.load_rise_s if rises else 0.0


@embedded_kernel
def load_share(motion: FormerMotion, t: float, regimes: Indices) -> float:
    """Return the share of the load that acts (0 to 1)."""
    return float(motion.kept[SHARE] + share_rate(motion, regimes) * (t - motion.kept[SINCE_S]))


@laws.declares(laws.evaluate, FormerMotion)
def evaluate_former(motion: FormerMotion, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill inertias, moments, and the bounds of load and friction at the crank, of the gear at the drive."""
    former, crank, twist, w, first = motion.former, y[CRANK], y[TWIST], y[SPEED], y[DRIVE]
    bank, direction = former.bank, sense_of(regimes[CRANK_LAW])
    share = load_share(motion, t, regimes)
    inertia, slope, full = shaft_terms(bank, crank, motion.sides, direction if direction != 0.0 else 1.0)
    motion.kept[LOAD] = full
    transmitted = former.stiffness_nm_per_rad * twist + former.damping_nms_per_rad * (first - w)
    at.mass[0, 0], at.mass[1, 1] = inertia, former.motor_inertia_kg_m2
    at.directions[CRANK_LAW, 0], at.directions[DRIVE_LAW, 1] = 1.0, 1.0
    at.force[0] = transmitted - w * w * slope - former.viscous_nms_per_rad * w
    if bank.gravity_m_per_s2 > 0.0:
        at.force[0] -= rod_weight_moment(bank, crank)
    if regimes[CRANK_LAW] == OPEN:
        at.force[0] -= share * full
    elif w == 0.0:
        at.low[0] = -share * load_moment(bank, crank, 1.0) - former.coulomb_nm
        at.high[0] = max(-share * load_moment(bank, crank, -1.0) + former.coulomb_nm, at.low[0])
    else:
        at.low[0] = -share * full - former.coulomb_nm
        at.high[0] = -share * full + former.coulomb_nm
    shaft = shaft_torque(former, motion.torque, t, first)
    if regimes[DRIVE_LAW] == OPEN:
        at.force[1] = shaft * former.ratio * former.efficiency - transmitted
    else:
        passed = gear_split(former.ratio, former.efficiency, shaft)
        at.force[1] = passed.mean_nm - transmitted
        at.low[1], at.high[1] = -passed.friction_nm, passed.friction_nm


@laws.declares(laws.accumulate, FormerMotion)
def accumulate_work(motion: FormerMotion, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    """Fill the rate of the twist (rad/s), and the power of motor, damping, load and friction (W)."""
    former, w, first = motion.former, y[SPEED], y[DRIVE]
    twist_rate = first - w
    damping = former.damping_nms_per_rad * twist_rate
    out[TWIST] = twist_rate
    moment = at.force[1] + former.stiffness_nm_per_rad * y[TWIST] + damping + at.multiplier[DRIVE_LAW]
    friction = former.viscous_nms_per_rad * w
    if regimes[CRANK_LAW] == OPEN:
        load = load_share(motion, t, regimes) * motion.kept[LOAD]
    else:
        coulomb = former.coulomb_nm * sense_of(regimes[CRANK_LAW])
        load = -at.multiplier[CRANK_LAW] - coulomb
        friction += coulomb
    out[4] = moment * first
    out[5] = damping * twist_rate
    out[6] = load * w
    out[7] = friction * w


@laws.declares(laws.fill_signals, FormerMotion)
def signal_events(
    motion: FormerMotion, t: float, y: Array, regimes: Indices, at: Equations, values: Array, rates: Array
) -> None:
    """Fill the distances to dead centres (rad), speed thresholds (rad/s), and times of load and stall (s)."""
    former, kept, first, begin = motion.former, motion.kept, y[DRIVE], 2 * LAWS
    for i in range(OWN_SIGNALS):
        values[begin + i], rates[begin + i] = math.inf, 0.0
    values[begin + STOPS], rates[begin + STOPS] = motion.stop_rad - y[CRANK], -y[SPEED]
    if regimes[CRANK_LAW] != HOLD:
        values[begin + SIDE_AHEAD], rates[begin + SIDE_AHEAD] = kept[HIGH_RAD] - y[CRANK], -y[SPEED]
        values[begin + SIDE_BEHIND], rates[begin + SIDE_BEHIND] = y[CRANK] - kept[LOW_RAD], y[SPEED]
    if regimes[LOAD_ON] == 0:
        values[begin + ENGAGES] = former.engage_speed_rad_per_s - y[SPEED]
        rates[begin + ENGAGES] = -at.acceleration[0]
    elif kept[SHARE] < 1.0:
        values[begin + IN_FULL] = kept[SINCE_S] + (1.0 - kept[SHARE]) * former.load_rise_s - t
        rates[begin + IN_FULL] = -1.0
    if motion.torque.command > 0.0:
        sense = -1.0 if regimes[IS_SLOW] == 1 else 1.0
        values[begin + CROSSES] = sense * (first - former.slow_speed_rad_per_s * motion.torque.command)
        rates[begin + CROSSES] = sense * at.acceleration[1]
    if regimes[IS_SLOW] == 1 and regimes[IS_STALLED] == 0:
        values[begin + STALLS] = kept[SINCE_S] + former.stall_time_s - kept[SLOW_S] - t
        rates[begin + STALLS] = -1.0


@borrowing_kernel
def setting_off(motion: FormerMotion, y: Array, regimes: Indices) -> float:
    """Return a moment (N m) with the direction in which a crank at rest starts, 0 if nothing drives it."""
    former, bank = motion.former, motion.former.bank
    driving = former.stiffness_nm_per_rad * y[TWIST] + former.damping_nms_per_rad * (y[DRIVE] - y[SPEED])
    driving -= rod_weight_moment(bank, y[CRANK])
    if regimes[LOAD_ON] == 0 or regimes[CRANK_LAW] == HOLD:
        return float(driving)
    load = load_moment(bank, y[CRANK], sense_of(regimes[CRANK_LAW]))
    driving -= motion.kept[SHARE] * load
    rises_from_nothing = driving == 0.0 == motion.kept[SHARE]
    return float(-load if rises_from_nothing else driving)


@laws.declares(laws.begin_piece, FormerMotion)
def look_ahead(motion: FormerMotion, t: float, y: Array, regimes: Indices) -> None:
    """Store the dead centres on both sides of the crank angle, and the half turn of each cart.

    A crank that starts from a dead centre may have moved no further than rounding, so its direction decides.
    """
    bank, kept, crank, w = motion.former.bank, motion.kept, y[CRANK], y[SPEED]
    sense = w
    if w == 0.0:  # at rest on a dead centre: the side it is driven to
        sense = kept[PASSED] if kept[PASSED] != 0.0 else setting_off(motion, y, regimes)
    known = regimes[CRANK_LAW] in (LOW, HIGH)
    ahead = sense_of(regimes[CRANK_LAW]) if known else (1.0 if sense >= 0.0 else -1.0)
    low, high = sides_of_travel(bank, crank + ahead * LOOK_AHEAD_RAD, motion.sides)
    if w == 0.0:  # between dead centres of two carts that differ by rounding: neither is passed
        low, high = min(low, crank), max(high, crank)
    if bank.load in (NONE, PRINTED):  # no kink at a dead centre
        low, high = -FAR_RAD, FAR_RAD
    kept[LOW_RAD], kept[HIGH_RAD], kept[PASSED] = low, high, 0.0


@laws.declares(laws.end_piece, FormerMotion)
def count_time(motion: FormerMotion, t: float, before: Array, y: Array, regimes: Indices) -> None:
    """Store the load's share at the end of a piece, and the time (s) the motor is below its stall threshold."""
    kept, span = motion.kept, t - motion.kept[SINCE_S]
    kept[SHARE] = min(1.0, kept[SHARE] + share_rate(motion, regimes) * span)
    if regimes[IS_SLOW] == 1:
        kept[SLOW_S] += span
    kept[SINCE_S] = t


@borrowing_kernel
def log_former(motion: FormerMotion, t: float, kind: int, crank_rad: float, log: Array, count: int) -> int:
    """Log an event with the number of the crank's turn; return the number of events."""
    turn = float(math.floor(crank_rad / TURN))
    fill_event(log, count, motion.begin_s + t, kind, 0, 0.0, 0.0, 0.0, turn)
    return count + 1


@laws.declares(laws.pass_signal, FormerMotion)
def pass_event(motion: FormerMotion, which: int, t: float, y: Array, regimes: Indices, log: Array, count: int) -> int:
    """Pass a dead centre, apply the load, stop, or cross the stall threshold; log what is an event for users."""
    former, kept = motion.former, motion.kept
    if which == SIDE_AHEAD:
        y[CRANK], kept[PASSED] = kept[HIGH_RAD], 1.0
    elif which == SIDE_BEHIND:
        y[CRANK], kept[PASSED] = kept[LOW_RAD], -1.0
    elif which == ENGAGES:
        kept[SHARE], regimes[LOAD_ON] = 1.0 if former.load_rise_s == 0.0 else 0.0, 1
        regimes[CRANK_LAW] = regime_of(may_stick(former, True), y[SPEED], 1.0)
        return log_former(motion, t, ENGAGED_EVENT, y[CRANK], log, count)
    elif which == STOPS:
        y[CRANK] = motion.stop_rad
        return ENDED
    elif which == IN_FULL:
        kept[SHARE] = 1.0
    elif which == STALLS:
        regimes[IS_STALLED] = 1
        return log_former(motion, t, STALL_EVENT, y[CRANK], log, count)
    elif which == CROSSES and regimes[IS_SLOW] == 1:
        recovers, y[DRIVE] = regimes[IS_STALLED] == 1, former.slow_speed_rad_per_s * motion.torque.command
        kept[SLOW_S], regimes[IS_SLOW], regimes[IS_STALLED] = -1.0, 0, 0
        if recovers:
            return log_former(motion, t, RECOVERED_EVENT, y[CRANK], log, count)
    elif which == CROSSES:
        y[DRIVE] = former.slow_speed_rad_per_s * motion.torque.command
        kept[SLOW_S], regimes[IS_SLOW] = 0.0, 1
    return count


@laws.declares(laws.change_regimes, FormerMotion)
def change_sense(
    motion: FormerMotion, t: float, y: Array, past: Indices, regimes: Indices, at: Equations, log: Array, count: int
) -> int:
    """Log that the crank sticks or is released."""
    before, after = past[CRANK_LAW], regimes[CRANK_LAW]
    if after == HOLD and before != HOLD:
        return log_former(motion, t, HELD_EVENT, y[CRANK], log, count)
    if before == HOLD and after != HOLD:
        return log_former(motion, t, RELEASED_EVENT, y[CRANK], log, count)
    return count


OF_A_STEP = 0.002  # of the tolerance of the motion: what one step may miss
CREEPING, LEAST_SPEED = 1e-3, 1e-14  # of the speed that the twist gives a creeping crank; rad/s
NO_STEP = f"no integration step of {SHORTEST_S:g} s or more is small enough"
TIGHT = "integrator.tolerance is too tight for these loads"


class Advance(NamedTuple):
    """End of an integration: time (s), number of events or failure status (< 0), steps tried."""

    time_s: float
    status: int
    steps: int


def ending(advance: Advance) -> str:
    """Return the error text of a failed integration, one line."""
    at = f" at {advance.time_s:.6g} s" if math.isfinite(advance.time_s) else ""
    if advance.status == UNSTEADY:
        return f"{NO_STEP}{at}: {TIGHT}"
    return (
        f"more than {MOST_STEPS} integration steps or {MOST_PIECES} events{at}: drive.stiffness_nm_per_rad, "
        "drive.damping_nms_per_rad or friction.viscous_nms_per_rad is too large for the inertia"
    )


@inline_kernel
def begin_modes(former: Former, torque: MotorInStep, y: Array, modes: Any, kept: Array, regimes: Indices) -> None:
    """Fill regimes and stored values from the modes, consistent with the present parameters and command."""
    kept[SLOW_S], stalled, load_on = modes.slow_s, modes.stalled_1 > 0.0, modes.load_on_1 > 0.0
    gear_holds = former.loss_by_power and former.efficiency < 1.0
    if torque.command <= 0.0 or y[DRIVE] >= former.slow_speed_rad_per_s * torque.command:
        kept[SLOW_S], stalled = -1.0, False
    elif modes.slow_s < 0.0:
        kept[SLOW_S] = 0.0
    kept[SHARE] = 1.0 if load_on and former.load_rise_s == 0.0 else modes.load_share_1
    kept[SINCE_S], kept[PASSED] = 0.0, 0.0
    regimes[CRANK_LAW] = regime_of(may_stick(former, load_on), y[SPEED], modes.direction_1)
    regimes[DRIVE_LAW] = regime_of(gear_holds, y[DRIVE], modes.drive_direction_1)
    regimes[LOAD_ON], regimes[IS_SLOW] = 1 if load_on else 0, 1 if kept[SLOW_S] >= 0.0 else 0
    regimes[IS_STALLED] = 1 if stalled else 0


@inline_kernel
def former_room(carts: int) -> tuple[int, int]:
    """Return the lengths of the float and integer arrays that `advance_in` needs."""
    size, places = room_sizes(2, LAWS, OWN_SIGNALS, STATE_SIZE)
    return STATE_SIZE + KEPT + carts + size, 5 + places


@borrowing_kernel
def advance_in(
    former: Former, torque: MotorInStep, times: tuple[float, float], stop_rad: float, state: Array,
    modes: Any, log: Array, numbers: Array, marks: Indices,
) -> Advance:  # fmt: skip
    """Integrate as `advance_motion` does, with given work arrays; leave state and modes where the log is full."""
    carts, y, regimes = former.bank.offset_rad.size, numbers[:STATE_SIZE], marks[:5]
    kept, sides = numbers[STATE_SIZE : STATE_SIZE + KEPT], numbers[STATE_SIZE + KEPT : STATE_SIZE + KEPT + carts]
    room = room_in(numbers[STATE_SIZE + KEPT + carts :], marks[5:], 2, LAWS, OWN_SIGNALS, STATE_SIZE, DORMAND_PRINCE_8)
    for i in range(STATE_SIZE):
        y[i], room.tolerance[i] = state[i], OF_A_STEP * former.tolerances[i]
    y[DRIVE] = state[SPEED] + state[DRIVE]
    if former.viscous_nms_per_rad > 0.0:  # error control sees a crank that creeps in thick friction
        creeps = CREEPING * abs(former.stiffness_nm_per_rad * y[TWIST]) / former.viscous_nms_per_rad
        room.tolerance[SPEED] = max(min(room.tolerance[SPEED], creeps), LEAST_SPEED)
    room.steps[0] = 0
    begin_modes(former, torque, y, modes, kept, regimes)
    motion = FormerMotion(former, torque, times[0], stop_rad, kept, sides)
    system = declared(motion, room.at)
    count = advance(system, 0.0, times[1] - times[0], y, regimes, room, log, 0)
    if count != LOG_FULL:
        for i in range(STATE_SIZE):
            state[i] = y[i]
        state[DRIVE] = y[DRIVE] - y[SPEED]
        modes.direction_1, modes.drive_direction_1 = sense_of(regimes[CRANK_LAW]), sense_of(regimes[DRIVE_LAW])
        modes.load_on_1, modes.load_share_1 = regimes[LOAD_ON], kept[SHARE]
        modes.slow_s, modes.stalled_1 = kept[SLOW_S], regimes[IS_STALLED]
    return Advance(times[0] + kept[SINCE_S], count, room.steps[0])


@kernel
def advance_motion(
    former: Former, torque: MotorInStep, t: float, end_s: float, y: Array, modes: Array, log: Array,
    stop_rad: float,
) -> tuple[Advance, Array]:  # fmt: skip
    """Integrate the state up to ``end_s``, or to the crank angle ``stop_rad`` if that is reached first.

    Parameters
    ----------
    former, torque
        Constants, and the motor's torque during the interval.
    t, end_s : float
        Start and end, s.
    y : array, shape (8,)
        The `FormerState`, changed in place.
    modes : array, shape (6,)
        The `Modes`, changed in place.
    log : array
        Table of events, filled; returned, longer where it has to be.
    stop_rad : float
        Crank angle to stop at (landed on), ``inf`` for none.
    """
    size, places = former_room(former.bank.offset_rad.size)
    numbers, marks, now = np.zeros(size), np.zeros(places, dtype=np.int64), modes_of(modes, 0)
    done = advance_in(former, torque, (t, end_s), stop_rad, y, now, log, numbers, marks)
    while done.status == LOG_FULL:
        log = np.empty((2 * len(log) + 8, log.shape[1]))
        done = advance_in(former, torque, (t, end_s), stop_rad, y, now, log, numbers, marks)
    return done, log


@kernel
def twist_acceleration(former: Former, torque: MotorInStep, t: float, y: Array, drive_direction: float) -> float:
    """Return the twist's acceleration (rad/s2) of a loaded machine that turns forward."""
    now, sides = state_of(y), np.empty(former.bank.offset_rad.size)
    sides_of_travel(former.bank, now.crank_rad, sides)
    inertia, slope, load = shaft_terms(former.bank, now.crank_rad, sides, 1.0)
    w, transmitted = now.crank_speed_rad_per_s, coupling_moment(former, now)
    opposing = load + former.coulomb_nm + former.viscous_nms_per_rad * w + w * w * slope
    opposing += rod_weight_moment(former.bank, now.crank_rad)
    shaft = shaft_torque(former, torque, t, w + now.twist_rate_rad_per_s)
    first = (geared(former, shaft, drive_direction) - transmitted) / former.motor_inertia_kg_m2
    return first - (transmitted - opposing) / inertia
