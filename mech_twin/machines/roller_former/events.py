# SPDX-License-Identifier: Apache-2.0
"""What happens to the roller former at its events, and the log of those a user is told of.

Events are dead centres (kinks of the load), reversals of crank and drive, the load coming on, a stuck crank or drive
let go, and the stall threshold; their signals are in `motion`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import borrowing_kernel, kernel
from mech_twin.machines.roller_former.cart_statics import (
    LOOK_AHEAD_RAD,
    has_kinks,
    load_moment,
    rod_weight_moment,
    sides_of_travel,
)
from mech_twin.machines.roller_former.dynamics import (
    CRANK,
    SPEED,
    TWIST_RATE,
    Array,
    DriveLine,
    Former,
    FormerState,
    Modes,
    TravelStretch,
    coupling_moment,
    crank_band,
    drive_band,
    gear_may_stick,
    may_stick,
    shaft_torque,
    state_of,
)
from mech_twin.machines.roller_former.motion import (
    CRANK_AHEAD,
    CRANK_TURNS,
    DRIVE_AHEAD,
    DRIVE_BACK,
    DRIVE_TURNS,
    HIGH,
    LOAD_ENGAGES,
    LOW,
    QUICKENS,
    SHAFT_TURNS,
    SLACKENS,
    FormerMotion,
)

EVENT_KINDS = ("held", "released", "load_engaged", "stall", "recovered", "events_cut")
HELD_EVENT, RELEASED_EVENT, ENGAGED_EVENT, STALL_EVENT, RECOVERED_EVENT, CUT_EVENT = range(len(EVENT_KINDS))
EVENT_ROWS = 64
TURN = 2.0 * np.pi


class EventLog(NamedTuple):
    """What happened in an interval, ``EVENT_ROWS`` entries: time (s), kind, turn of the crank."""

    time_s: NDArray[np.float64]
    kind: NDArray[np.int64]
    turn: NDArray[np.int64]


@kernel
def empty_log() -> EventLog:
    """Return a log without entries."""
    return EventLog(np.zeros(EVENT_ROWS), np.zeros(EVENT_ROWS, np.int64), np.zeros(EVENT_ROWS, np.int64))


@borrowing_kernel
def log_event(log: EventLog, count: int, t: float, kind: int, crank_rad: float) -> int:
    """Write an event; return the new count.  The last entry says that the events after it are left out."""
    row = min(count, EVENT_ROWS - 1)
    if count < EVENT_ROWS:
        log.time_s[row] = t
        log.kind[row] = kind if row < EVENT_ROWS - 1 else CUT_EVENT
        log.turn[row] = int(np.floor(crank_rad / TURN))
    return row + 1


@borrowing_kernel
def setting_off(former: Former, now: FormerState, modes: Modes) -> float:
    """Return a moment (N m) with the sense in which a crank at rest sets off, 0 where nothing drives it."""
    driving = coupling_moment(former, now) - rod_weight_moment(former.bank, now.crank_rad)
    if not modes.load_on or modes.direction == 0.0:
        return driving
    load = load_moment(former.bank, now.crank_rad, modes.direction)
    driving -= modes.load_share * load
    return -load if driving == 0.0 == modes.load_share else driving  # of a load that rises from nothing the sense


@borrowing_kernel
def stretch_from(
    former: Former, t: float, y: Array, modes: Modes, sides: Array, stop_rad: float, passed: int
) -> TravelStretch:
    """Return the stretch that begins at this state, filling ``sides``; it ends at ``stop_rad`` at the latest.

    ``passed`` is the event that ended the one before, or `NONE`; what sets a crank off from a dead centre may have
    moved it no further than rounding.
    """
    bank, now = former.bank, state_of(y)
    direction = modes.direction
    known = may_stick(former, modes) and direction != 0.0
    sense = now.crank_speed_rad_per_s
    if sense == 0.0:  # at rest on a dead centre: the side it is driven to
        sense = 1.0 if passed == HIGH else -1.0 if passed == LOW else setting_off(former, now, modes)
    ahead = direction if known else (1.0 if sense >= 0.0 else -1.0)
    low, high = sides_of_travel(bank, now.crank_rad + ahead * LOOK_AHEAD_RAD, sides)
    if now.crank_speed_rad_per_s == 0.0:  # on dead centres of two carts that rounding tells apart: it is past neither
        low, high = min(low, now.crank_rad), max(high, now.crank_rad)
    if not has_kinks(bank):
        low, high = -1e300, 1e300
    share, rate = modes.load_share, 0.0
    if modes.load_on and share < 1.0:
        rate = 1.0 / former.load_rise_s
    forward, backward = 0.0, 0.0
    if direction == 0.0:
        forward = load_moment(bank, now.crank_rad, 1.0)
        backward = load_moment(bank, now.crank_rad, -1.0)
    return TravelStretch(
        t, direction, modes.drive_direction, modes.shaft_sense, share, rate, low, min(high, stop_rad), forward, backward
    )


@borrowing_kernel
def crank_sense(former: Former, y: Array, modes: Modes) -> float:
    """Return the sense of a crank: that of its speed; at rest the way the coupling overcomes what holds it, or 0."""
    if not may_stick(former, modes):
        return 1.0
    now = state_of(y)
    if now.crank_speed_rad_per_s != 0.0:
        return 1.0 if now.crank_speed_rad_per_s > 0.0 else -1.0
    backward, forward = crank_band(former, now.crank_rad, modes.load_share)
    transmitted = coupling_moment(former, now)
    return 1.0 if transmitted > forward else (-1.0 if transmitted < backward else 0.0)


@borrowing_kernel
def drive_sense(former: Former, torque: DriveLine, t: float, y: Array) -> float:
    """Return the sense of the drive: that of its speed, and at rest the way its gear lets it go, or 0."""
    if not gear_may_stick(former):
        return 1.0
    now = state_of(y)
    first = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    if first != 0.0:
        return 1.0 if first > 0.0 else -1.0
    low, high = drive_band(former, torque, t)
    transmitted = coupling_moment(former, now)
    return 1.0 if transmitted < low else (-1.0 if transmitted > high else 0.0)


@borrowing_kernel
def normalised_modes(former: Former, torque: DriveLine, t: float, y: Array, modes: Modes) -> Modes:
    """Return the modes in line with the present parameters and command, which may have changed since the last step."""
    now = state_of(y)
    first = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    slow_s, stalled = modes.slow_s, modes.stalled
    if torque.command <= 0.0 or first >= former.slow_speed_rad_per_s * torque.command:
        slow_s, stalled = -1.0, False
    elif slow_s < 0.0:
        slow_s = 0.0
    share = 1.0 if modes.load_on and former.load_rise_s == 0.0 else modes.load_share
    sense = 1.0 if shaft_torque(former, torque, t, first) >= 0.0 else -1.0
    modes = Modes(1.0, 1.0, sense, modes.load_on, share, slow_s, stalled, modes.trial_step_s)
    return with_senses(modes, crank_sense(former, y, modes), drive_sense(former, torque, t, y))


@borrowing_kernel
def with_senses(modes: Modes, direction: float, drive_direction: float) -> Modes:
    """Return the modes with other senses of crank and drive."""
    return Modes(
        direction,
        drive_direction,
        modes.shaft_sense,
        modes.load_on,
        modes.load_share,
        modes.slow_s,
        modes.stalled,
        modes.trial_step_s,
    )


@borrowing_kernel
def with_shaft_sense(modes: Modes, shaft_sense: float) -> Modes:
    """Return the modes with another sign of the motor's torque."""
    return Modes(
        modes.direction,
        modes.drive_direction,
        shaft_sense,
        modes.load_on,
        modes.load_share,
        modes.slow_s,
        modes.stalled,
        modes.trial_step_s,
    )


@borrowing_kernel
def with_load(modes: Modes, on: bool, share: float) -> Modes:
    """Return the modes with another state of the load."""
    return Modes(
        modes.direction,
        modes.drive_direction,
        modes.shaft_sense,
        on,
        share,
        modes.slow_s,
        modes.stalled,
        modes.trial_step_s,
    )


@borrowing_kernel
def with_slow_time(modes: Modes, slow_s: float, stalled: bool) -> Modes:
    """Return the modes with another time below the stall threshold."""
    return Modes(
        modes.direction,
        modes.drive_direction,
        modes.shaft_sense,
        modes.load_on,
        modes.load_share,
        slow_s,
        stalled,
        modes.trial_step_s,
    )


@borrowing_kernel
def count_slow_time(
    former: Former, t: float, h: float, crank_rad: float, modes: Modes, log: EventLog, count: int
) -> tuple[Modes, int]:
    """Add a step to the time spent below the stall threshold; log the stall at its exact time."""
    if modes.slow_s < 0.0:
        return modes, count
    stalled = modes.stalled
    if not stalled and modes.slow_s + h >= former.stall_time_s:
        count = log_event(log, count, t + max(0.0, former.stall_time_s - modes.slow_s), STALL_EVENT, crank_rad)
        stalled = True
    return with_slow_time(modes, modes.slow_s + h, stalled), count


@borrowing_kernel
def apply_event(
    motion: FormerMotion, code: int, t: float, y: Array, modes: Modes, log: EventLog, count: int
) -> tuple[Modes, int]:
    """Change the state as event ``code`` does; return the modes after it and the count of logged events."""
    former, stretch = motion.former, motion.stretch
    if code == HIGH:
        y[CRANK] = stretch.high_rad
    elif code == LOW:
        y[CRANK] = stretch.low_rad
    elif code == CRANK_TURNS:
        y[TWIST_RATE] += y[SPEED]
        y[SPEED] = 0.0
        modes = with_senses(modes, crank_sense(former, y, modes), modes.drive_direction)
        if modes.direction == 0.0:
            count = log_event(log, count, t, HELD_EVENT, y[CRANK])
    elif code == LOAD_ENGAGES:
        modes = with_load(modes, True, 1.0 if former.load_rise_s == 0.0 else 0.0)
        modes = with_senses(modes, crank_sense(former, y, modes), modes.drive_direction)
        count = log_event(log, count, t, ENGAGED_EVENT, y[CRANK])
    elif code == QUICKENS:
        if modes.stalled:
            count = log_event(log, count, t, RECOVERED_EVENT, y[CRANK])
        modes = with_slow_time(modes, -1.0, False)
    elif code == SLACKENS:
        modes = with_slow_time(modes, 0.0, modes.stalled)
    elif code == DRIVE_TURNS:
        y[TWIST_RATE] = -y[SPEED]
        modes = with_senses(modes, modes.direction, drive_sense(former, motion.torque, t, y))
    elif code == SHAFT_TURNS:
        modes = with_shaft_sense(modes, -modes.shaft_sense)
    elif code in (DRIVE_AHEAD, DRIVE_BACK):
        modes = with_senses(modes, modes.direction, 1.0 if code == DRIVE_AHEAD else -1.0)
    else:
        modes = with_senses(modes, 1.0 if code == CRANK_AHEAD else -1.0, modes.drive_direction)
        count = log_event(log, count, t, RELEASED_EVENT, y[CRANK])
    return modes, count
