"""What may happen to the roller former within a step, and what it changes.

Dead centres (kinks of the load), reversals of the crank, the load coming on, a held crank let go, and the stall
threshold are signals: numbers that turn positive, which the integrator brackets and lands on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.cart_statics import (
    LOOK_AHEAD_RAD,
    has_kinks,
    holds_at_rest,
    load_moment,
    sides_of_travel,
)
from mech_twin.machines.roller_former.dynamics import (
    CRANK,
    DIRECTION,
    ENGAGED,
    EVENT_ROWS,
    SHARE,
    SLOW,
    SPEED,
    STALLED,
    TWIST_RATE,
    Former,
    Stretch,
    Torque,
    coupling_moment,
)

HELD_EVENT, RELEASED_EVENT, ENGAGED_EVENT, STALL_EVENT, RECOVERED_EVENT = range(5)
EVENT_KINDS = ("held", "released", "load_engaged", "stall", "recovered")
HIGH, LOW, TURN, ENGAGE, QUICKEN, SLACKEN, RELEASE_AHEAD, RELEASE_BACK = range(8)
SIGNALS = 8
RELEASE_MARGIN = 1e-9


@kernel
def signal(
    former: Former,
    torque: Torque,
    stretch: Stretch,
    modes: NDArray[np.float64],
    code: int,
    t: float,
    y: NDArray[np.float64],
) -> float:
    """Return a number that is positive once event ``code`` has happened, and -1 where it cannot."""
    value = -1.0
    if stretch.direction == 0.0:
        transmitted = coupling_moment(former, y)
        share = (stretch.share + stretch.share_rate * (t - stretch.start_s)) * (1.0 + RELEASE_MARGIN)
        if code == RELEASE_AHEAD:
            value = transmitted - stretch.forward_nm * share
        elif code == RELEASE_BACK:
            value = stretch.backward_nm * share - transmitted
    elif code == HIGH:
        value = y[CRANK] - stretch.high_rad
    elif code == LOW:
        value = stretch.low_rad - y[CRANK]
    elif code == TURN and modes[ENGAGED] > 0.0 and holds_at_rest(former.bank):
        value = -stretch.direction * y[SPEED]
    elif code == ENGAGE and modes[ENGAGED] == 0.0:
        value = y[SPEED] - former.engage_speed_rad_per_s
    if torque.command > 0.0:
        spare = y[SPEED] + y[TWIST_RATE] - former.slow_speed_rad_per_s * torque.command
        if code == QUICKEN and modes[SLOW] >= 0.0:
            value = spare
        elif code == SLACKEN and modes[SLOW] < 0.0:
            value = -spare
    return float(value)


@kernel
def something_happened(
    former: Former,
    torque: Torque,
    stretch: Stretch,
    modes: NDArray[np.float64],
    t: float,
    y: NDArray[np.float64],
) -> bool:
    """Return whether any signal may be positive; most steps end here."""
    fast = y[SPEED] + y[TWIST_RATE] >= former.slow_speed_rad_per_s * torque.command
    return (
        stretch.direction == 0.0
        or y[CRANK] > stretch.high_rad
        or y[CRANK] < stretch.low_rad
        or stretch.direction * y[SPEED] < 0.0
        or modes[ENGAGED] == 0.0
        or fast == (modes[SLOW] >= 0.0)
    )


@kernel
def stretch_from(
    former: Former,
    t: float,
    y: NDArray[np.float64],
    modes: NDArray[np.float64],
    sides: NDArray[np.float64],
    stop_rad: float,
) -> Stretch:
    """Return the stretch that begins at this state, filling ``sides``; it ends at ``stop_rad`` at the latest."""
    bank = former.bank
    direction = modes[DIRECTION]
    ahead = direction if holds_at_rest(bank) and direction != 0.0 else (1.0 if y[SPEED] >= 0.0 else -1.0)
    low, high = sides_of_travel(bank, y[CRANK] + ahead * LOOK_AHEAD_RAD, sides)
    if not has_kinks(bank):
        low, high = -1e300, 1e300
    share, rate = modes[SHARE], 0.0
    if modes[ENGAGED] > 0.0 and share < 1.0:
        rate = 1.0 / former.load_rise_s
    forward, backward = 0.0, 0.0
    if direction == 0.0:
        forward = load_moment(bank, y[CRANK], 1.0)
        backward = load_moment(bank, y[CRANK], -1.0)
    return Stretch(t, direction, share, rate, low, min(high, stop_rad), forward, backward)


@kernel
def settle_direction(former: Former, y: NDArray[np.float64], modes: NDArray[np.float64]) -> None:
    """Set the direction of a crank that stands still: held, or the way the coupling overcomes the load."""
    transmitted = coupling_moment(former, y)
    y[SPEED] = 0.0
    if transmitted > load_moment(former.bank, y[CRANK], 1.0) * modes[SHARE]:
        modes[DIRECTION] = 1.0
    elif transmitted < load_moment(former.bank, y[CRANK], -1.0) * modes[SHARE]:
        modes[DIRECTION] = -1.0
    else:
        modes[DIRECTION] = 0.0


@kernel
def normalise_modes(former: Former, torque: Torque, y: NDArray[np.float64], modes: NDArray[np.float64]) -> None:
    """Bring the modes in line with the present parameters and command, which may have changed since the last step."""
    if not holds_at_rest(former.bank):
        modes[DIRECTION] = 1.0
    slow = y[SPEED] + y[TWIST_RATE] < former.slow_speed_rad_per_s * torque.command
    if torque.command <= 0.0 or not slow:
        modes[SLOW] = -1.0
        modes[STALLED] = 0.0
    elif modes[SLOW] < 0.0:
        modes[SLOW] = 0.0
    if modes[ENGAGED] > 0.0 and modes[SHARE] < 1.0 and former.load_rise_s == 0.0:
        modes[SHARE] = 1.0


@kernel
def note(events: NDArray[np.float64], count: int, t: float, kind: int, y: NDArray[np.float64]) -> int:
    """Write an event's time, kind and turn; return the new count (the last row is overwritten when full)."""
    row = min(count, EVENT_ROWS - 1)
    events[row, 0] = t
    events[row, 1] = kind
    events[row, 2] = np.floor(y[CRANK] / (2.0 * np.pi))
    return row + 1


@kernel
def count_slow(
    former: Former,
    t: float,
    h: float,
    y: NDArray[np.float64],
    modes: NDArray[np.float64],
    events: NDArray[np.float64],
    count: int,
) -> int:
    """Add a step to the time spent below the stall threshold; note the stall at its exact time."""
    if modes[SLOW] >= 0.0:
        if modes[STALLED] == 0.0 and modes[SLOW] + h >= former.stall_time_s:
            count = note(events, count, t + max(0.0, former.stall_time_s - modes[SLOW]), STALL_EVENT, y)
            modes[STALLED] = 1.0
        modes[SLOW] += h
    return count


@kernel
def apply_event(
    former: Former,
    stretch: Stretch,
    code: int,
    t: float,
    y: NDArray[np.float64],
    modes: NDArray[np.float64],
    events: NDArray[np.float64],
    count: int,
) -> int:
    """Change state and modes as event ``code`` does; return the count of noted events."""
    if code == HIGH:
        y[CRANK] = stretch.high_rad
    elif code == LOW:
        y[CRANK] = stretch.low_rad
    elif code == TURN:
        settle_direction(former, y, modes)
        if modes[DIRECTION] == 0.0:
            count = note(events, count, t, HELD_EVENT, y)
    elif code == ENGAGE:
        modes[ENGAGED] = 1.0
        modes[DIRECTION] = 1.0
        modes[SHARE] = 1.0 if former.load_rise_s == 0.0 else 0.0
        count = note(events, count, t, ENGAGED_EVENT, y)
    elif code == QUICKEN:
        modes[SLOW] = -1.0
        if modes[STALLED] > 0.0:
            modes[STALLED] = 0.0
            count = note(events, count, t, RECOVERED_EVENT, y)
    elif code == SLACKEN:
        modes[SLOW] = 0.0
    else:
        modes[DIRECTION] = 1.0 if code == RELEASE_AHEAD else -1.0
        count = note(events, count, t, RELEASED_EVENT, y)
    return count
