"""What may happen to the roller former within a step, and what it changes.

Dead centres (kinks of the load), reversals of crank and drive, the load coming on, a stuck crank or drive let go, and
the stall threshold are signals: numbers that turn positive, which the integrator brackets and lands on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
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
    Former,
    Modes,
    Motion,
    Stretch,
    Torque,
    coupling_moment,
    crank_band,
    drive_band,
    gear_may_stick,
    may_stick,
    state_of,
)

EVENT_KINDS = ("held", "released", "load_engaged", "stall", "recovered", "events_cut")
HELD_EVENT, RELEASED_EVENT, ENGAGED_EVENT, STALL_EVENT, RECOVERED_EVENT, CUT_EVENT = range(len(EVENT_KINDS))
(
    HIGH,
    LOW,
    CRANK_TURNS,
    LOAD_ENGAGES,
    QUICKENS,
    SLACKENS,
    CRANK_AHEAD,
    CRANK_BACK,
    DRIVE_TURNS,
    DRIVE_AHEAD,
    DRIVE_BACK,
) = SIGNALS = tuple(range(11))
EVENT_ROWS = 64
RELEASE_MARGIN = 1e-9
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


@kernel
def log_event(log: EventLog, count: int, t: float, kind: int, crank_rad: float) -> int:
    """Write an event; return the new count.  The last entry says that the events after it are left out."""
    row = min(count, EVENT_ROWS - 1)
    if count < EVENT_ROWS:
        log.time_s[row] = t
        log.kind[row] = kind if row < EVENT_ROWS - 1 else CUT_EVENT
        log.turn[row] = int(np.floor(crank_rad / TURN))
    return row + 1


@kernel
def crank_signal(motion: Motion, modes: Modes, code: int, y: Array) -> float:
    """Return the signal of a crank that turns: a dead centre either side, and the reversal of one that may stick."""
    former, stretch, now = motion.former, motion.stretch, state_of(y)
    if code == HIGH:
        return now.crank_rad - stretch.high_rad
    if code == LOW:
        return stretch.low_rad - now.crank_rad
    return -stretch.direction * now.crank_speed_rad_per_s if may_stick(former, modes) else -1.0


@kernel
def release_signal(motion: Motion, code: int, t: float, y: Array) -> float:
    """Return the signal of a crank that is stuck: how far the moment in the coupling is beyond what holds it."""
    former, stretch, now = motion.former, motion.stretch, state_of(y)
    share = (stretch.share + stretch.share_rate * (t - stretch.start_s)) * (1.0 + RELEASE_MARGIN)
    friction = former.coulomb_nm * (1.0 + RELEASE_MARGIN)
    rest = coupling_moment(former, now) - rod_weight_moment(former.bank, now.crank_rad)
    if code == CRANK_AHEAD:
        return rest - stretch.forward_nm * share - friction
    return stretch.backward_nm * share - friction - rest


@kernel
def drive_signal(motion: Motion, code: int, t: float, y: Array) -> float:
    """Return the signal of a drive whose gear may hold it: its reversal, and where it is stuck its release."""
    former, direction, now = motion.former, motion.stretch.drive_direction, state_of(y)
    if (direction == 0.0) == (code == DRIVE_TURNS) or not gear_may_stick(former):
        return -1.0
    if code == DRIVE_TURNS:
        return -direction * (now.crank_speed_rad_per_s + now.twist_rate_rad_per_s)
    low, high = drive_band(former, motion.torque, t)
    transmitted = coupling_moment(former, now)
    if code == DRIVE_AHEAD:
        return low - abs(low) * RELEASE_MARGIN - transmitted
    return transmitted - high - abs(high) * RELEASE_MARGIN


@kernel
def stall_signal(motion: Motion, modes: Modes, code: int, y: Array) -> float:
    """Return the signal of the speed at which a supplied motor begins or ends to count as stalling."""
    if motion.torque.command <= 0.0 or (modes.slow_s >= 0.0) != (code == QUICKENS):
        return -1.0
    now = state_of(y)
    threshold = motion.former.slow_speed_rad_per_s * motion.torque.command
    spare = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s - threshold
    return spare if code == QUICKENS else -spare


@kernel
def signal(motion: Motion, modes: Modes, code: int, t: float, y: Array) -> float:
    """Return a number that is positive once event ``code`` has happened, and -1 where it cannot."""
    if code in (HIGH, LOW, CRANK_TURNS):
        return crank_signal(motion, modes, code, y) if motion.stretch.direction != 0.0 else -1.0
    if code in (CRANK_AHEAD, CRANK_BACK):
        return release_signal(motion, code, t, y) if motion.stretch.direction == 0.0 else -1.0
    if code == LOAD_ENGAGES:
        return -1.0 if modes.load_on else state_of(y).crank_speed_rad_per_s - motion.former.engage_speed_rad_per_s
    if code in (QUICKENS, SLACKENS):
        return stall_signal(motion, modes, code, y)
    return drive_signal(motion, code, t, y)


@kernel
def something_happened(motion: Motion, modes: Modes, y: Array) -> bool:
    """Return whether any signal may be positive; most steps end here."""
    former, stretch, now = motion.former, motion.stretch, state_of(y)
    first = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    fast = first >= former.slow_speed_rad_per_s * motion.torque.command
    return (
        stretch.direction == 0.0
        or stretch.drive_direction == 0.0
        or now.crank_rad > stretch.high_rad
        or now.crank_rad < stretch.low_rad
        or stretch.direction * now.crank_speed_rad_per_s < 0.0
        or stretch.drive_direction * first < 0.0
        or not modes.load_on
        or fast == (modes.slow_s >= 0.0)
    )


@kernel
def stretch_from(former: Former, t: float, y: Array, modes: Modes, sides: Array, stop_rad: float) -> Stretch:
    """Return the stretch that begins at this state, filling ``sides``; it ends at ``stop_rad`` at the latest."""
    bank, now = former.bank, state_of(y)
    direction = modes.direction
    known = may_stick(former, modes) and direction != 0.0
    ahead = direction if known else (1.0 if now.crank_speed_rad_per_s >= 0.0 else -1.0)
    low, high = sides_of_travel(bank, now.crank_rad + ahead * LOOK_AHEAD_RAD, sides)
    if not has_kinks(bank):
        low, high = -1e300, 1e300
    share, rate = modes.load_share, 0.0
    if modes.load_on and share < 1.0:
        rate = 1.0 / former.load_rise_s
    forward, backward = 0.0, 0.0
    if direction == 0.0:
        forward = load_moment(bank, now.crank_rad, 1.0)
        backward = load_moment(bank, now.crank_rad, -1.0)
    return Stretch(t, direction, modes.drive_direction, share, rate, low, min(high, stop_rad), forward, backward)


@kernel
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


@kernel
def drive_sense(former: Former, torque: Torque, t: float, y: Array) -> float:
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


@kernel
def normalised_modes(former: Former, torque: Torque, t: float, y: Array, modes: Modes) -> Modes:
    """Return the modes in line with the present parameters and command, which may have changed since the last step."""
    now = state_of(y)
    first = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    slow_s, stalled = modes.slow_s, modes.stalled
    if torque.command <= 0.0 or first >= former.slow_speed_rad_per_s * torque.command:
        slow_s, stalled = -1.0, False
    elif slow_s < 0.0:
        slow_s = 0.0
    share = 1.0 if modes.load_on and former.load_rise_s == 0.0 else modes.load_share
    modes = Modes(1.0, 1.0, modes.load_on, share, slow_s, stalled, modes.trial_step_s)
    return with_senses(modes, crank_sense(former, y, modes), drive_sense(former, torque, t, y))


@kernel
def with_senses(modes: Modes, direction: float, drive_direction: float) -> Modes:
    """Return the modes with other senses of crank and drive."""
    return Modes(
        direction,
        drive_direction,
        modes.load_on,
        modes.load_share,
        modes.slow_s,
        modes.stalled,
        modes.trial_step_s,
    )


@kernel
def with_load(modes: Modes, on: bool, share: float) -> Modes:
    """Return the modes with another state of the load."""
    return Modes(modes.direction, modes.drive_direction, on, share, modes.slow_s, modes.stalled, modes.trial_step_s)


@kernel
def with_slow_time(modes: Modes, slow_s: float, stalled: bool) -> Modes:
    """Return the modes with another time below the stall threshold."""
    return Modes(
        modes.direction,
        modes.drive_direction,
        modes.load_on,
        modes.load_share,
        slow_s,
        stalled,
        modes.trial_step_s,
    )


@kernel
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


@kernel
def apply_event(
    motion: Motion, code: int, t: float, y: Array, modes: Modes, log: EventLog, count: int
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
    elif code in (DRIVE_AHEAD, DRIVE_BACK):
        modes = with_senses(modes, modes.direction, 1.0 if code == DRIVE_AHEAD else -1.0)
    else:
        modes = with_senses(modes, 1.0 if code == CRANK_AHEAD else -1.0, modes.drive_direction)
        count = log_event(log, count, t, RELEASED_EVENT, y[CRANK])
    return modes, count
