r"""Motion of the roller former: two masses and all carts, their rates, and what may happen to them.

::

    M_p1 --> (J_p1, phi1) ==[ c, k ]== (J_p2(phi2), phi2) <-- M_p2(phi2)

    J_p1 phi1'' = M_p1 - T,   J_p2 phi2'' + phi2'^2 sum m_B x' x'' = T - M_p2,   T = c (phi1 - phi2) + k (phi1' - phi2')

State: crank angle phi2, twist phi1 - phi2, crank speed, twist rate, and three works (motor, damping, load) that make
the energy book.  Twist instead of phi1, so that a twist of 1e-4 rad keeps its digits after many turns.

Dead centres (kinks of the load), reversals, engagement of the load and the stall threshold are signals that the
integrator brackets and lands on.

Source: LoveikinRoller2018 eq. (40).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
from mech_twin.parts.induction_motor import MotorConstants, motor_torque
from mech_twin.parts.roller_cart.parameters import CartBank
from mech_twin.parts.roller_cart.statics import (
    LOOK_AHEAD_RAD,
    branching_terms,
    has_kinks,
    holds_at_rest,
    load_moment,
    plain_terms,
    shaft_terms,
    sides_of_travel,
)

CRANK, TWIST, SPEED, TWIST_RATE, MOTOR_WORK, DAMPING_WORK, LOAD_WORK = range(7)
SIZE = 7
DIRECTION, ENGAGED, SHARE, SLOW, STALLED, TRIAL_STEP = range(6)
MODES = 6
HELD_EVENT, RELEASED_EVENT, ENGAGED_EVENT, STALL_EVENT, RECOVERED_EVENT = range(5)
EVENT_KINDS = ("held", "released", "load_engaged", "stall", "recovered")
EVENT_ROWS = 64

HIGH, LOW, TURN, ENGAGE, QUICKEN, SLACKEN, RELEASE_AHEAD, RELEASE_BACK = range(8)
SIGNALS = 8
RELEASE_MARGIN = 1e-9


class Former(NamedTuple):
    """All the kernels need: carts, motor, drive, start and stall thresholds, tolerance and scales of the state."""

    bank: CartBank
    motor: MotorConstants
    motor_inertia_kg_m2: float
    stiffness_nm_per_rad: float
    damping_nms_per_rad: float
    ratio: float
    efficiency: float
    engage_speed_rad_per_s: float
    load_rise_s: float
    slow_speed_rad_per_s: float
    stall_time_s: float
    tolerance: float
    scales: tuple[float, float, float, float, float, float, float]


class Torque(NamedTuple):
    """Motor torque during a stretch: from the speed itself (``coupled``), or a straight line in time (N m, N m/s)."""

    coupled: bool
    command: float
    value_nm: float
    slope_nm_per_s: float
    origin_s: float


class Stretch(NamedTuple):
    """What stays as it is until the next event: travel direction, load share and its rate, the dead centres ahead."""

    start_s: float
    direction: float
    share: float
    share_rate: float
    low_rad: float
    high_rad: float
    forward_nm: float
    backward_nm: float


@kernel
def motor_moment(former: Former, torque: Torque, t: float, speed: float) -> float:
    """Return the motor's moment at the crank, ``M u eta`` (N m), at a time and a speed of the first mass."""
    if torque.coupled:
        shaft = motor_torque(former.motor, speed * former.ratio, torque.command)
    else:
        shaft = torque.value_nm + torque.slope_nm_per_s * (t - torque.origin_s)
    return shaft * former.ratio * former.efficiency


@kernel
def coupling_moment(former: Former, y: NDArray[np.float64]) -> float:
    """Return ``T = c (phi1 - phi2) + k (phi1' - phi2')`` (N m)."""
    return float(former.stiffness_nm_per_rad * y[TWIST] + former.damping_nms_per_rad * y[TWIST_RATE])


@kernel
def kinetic_and_elastic(former: Former, y: NDArray[np.float64], sides: NDArray[np.float64]) -> float:
    """Return the kinetic and elastic energy of the state (J)."""
    inertia, _, _ = shaft_terms(former.bank, y[CRANK], sides, 1.0)
    first = y[SPEED] + y[TWIST_RATE]
    return float(
        0.5 * former.motor_inertia_kg_m2 * first * first
        + 0.5 * inertia * y[SPEED] * y[SPEED]
        + 0.5 * former.stiffness_nm_per_rad * y[TWIST] * y[TWIST]
    )


@kernel
def rates(
    former: Former,
    torque: Torque,
    stretch: Stretch,
    sides: NDArray[np.float64],
    t: float,
    y: NDArray[np.float64],
    out: NDArray[np.float64],
    row: int,
) -> None:
    """Fill a row of ``out`` with the time derivative of the state; direction 0 is a crank held by its load."""
    speed, rate = y[SPEED], y[TWIST_RATE]
    moment = motor_moment(former, torque, t, speed + rate)
    transmitted = coupling_moment(former, y)
    load, acceleration = transmitted, 0.0
    if stretch.direction != 0.0:
        bank = former.bank
        if bank.plain:  # called here and not through shaft_terms, so that the compiler puts it in line
            inertia, slope, full = plain_terms(
                bank.carts, bank.crank_m, bank.ratio, bank.friction, bank.load, y[CRANK], sides, stretch.direction
            )
            inertia += bank.crank_inertia_kg_m2
        else:
            inertia, slope, full = branching_terms(bank, y[CRANK], sides, stretch.direction)
        load = full * (stretch.share + stretch.share_rate * (t - stretch.start_s))
        acceleration = (transmitted - load - speed * speed * slope) / inertia
    out[row, CRANK] = speed
    out[row, TWIST] = rate
    out[row, SPEED] = acceleration
    out[row, TWIST_RATE] = (moment - transmitted) / former.motor_inertia_kg_m2 - acceleration
    out[row, MOTOR_WORK] = moment * (speed + rate)
    out[row, DAMPING_WORK] = former.damping_nms_per_rad * rate * rate
    out[row, LOAD_WORK] = load * speed


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
