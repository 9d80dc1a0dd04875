# SPDX-License-Identifier: Apache-2.0
"""Integration of the roller former from one instant to another by the event loop."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mech_twin.engine.compiled_steps import LOG_FULL
from mech_twin.engine.hybrid.declared import declared
from mech_twin.engine.hybrid.laws import Array, Indices
from mech_twin.engine.hybrid.loop import MOST_PIECES, MOST_STEPS, UNSTEADY, advance, room_in, room_sizes
from mech_twin.engine.integration import SHORTEST_S
from mech_twin.engine.tableaus import DORMAND_PRINCE_8
from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel, kernel
from mech_twin.machines.roller_former.cart_statics import rod_weight_moment, shaft_terms, sides_of_travel
from mech_twin.machines.roller_former.dynamics import (
    STATE_SIZE,
    Former,
    Modes,
    coupling_moment,
    gear_may_stick,
    geared,
    may_stick,
    shaft_torque,
    state_of,
)
from mech_twin.machines.roller_former.motion import (
    CRANK_LAW,
    DRIVE,
    DRIVE_LAW,
    IS_SLOW,
    IS_STALLED,
    KEPT,
    LAWS,
    LOAD_ON,
    OWN_SIGNALS,
    PASSED,
    SHARE,
    SINCE_S,
    SLOW_S,
    SPEED,
    TWIST,
    FormerMotion,
    law_of,
    sense_of,
)
from mech_twin.parts.induction_motor import MotorInStep

OF_A_STEP = 0.002  # of the tolerance of the motion: what one step may miss
CREEPING, LEAST_SPEED = 1e-3, 1e-14  # of the speed that the twist gives a creeping crank; rad/s
NO_STEP = f"no integration step of {SHORTEST_S:g} s or more is small enough"
TIGHT = "integrator.tolerance is too tight for these loads"


class Advance(NamedTuple):
    """End of an integration: time (s), number of events or failure status (< 0), modes, steps tried."""

    time_s: float
    status: int
    modes: Modes
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
def begin_modes(former: Former, torque: MotorInStep, y: Array, modes: Modes, kept: Array, regimes: Indices) -> None:
    """Fill regimes and stored values from the modes, consistent with the present parameters and command."""
    kept[SLOW_S], stalled = modes.slow_s, modes.stalled
    if torque.command <= 0.0 or y[DRIVE] >= former.slow_speed_rad_per_s * torque.command:
        kept[SLOW_S], stalled = -1.0, False
    elif modes.slow_s < 0.0:
        kept[SLOW_S] = 0.0
    kept[SHARE] = 1.0 if modes.load_on and former.load_rise_s == 0.0 else modes.load_share
    kept[SINCE_S], kept[PASSED] = 0.0, 0.0
    regimes[CRANK_LAW] = law_of(may_stick(former, modes.load_on), y[SPEED], modes.direction)
    regimes[DRIVE_LAW] = law_of(gear_may_stick(former), y[DRIVE], modes.drive_direction)
    regimes[LOAD_ON], regimes[IS_SLOW] = 1 if modes.load_on else 0, 1 if kept[SLOW_S] >= 0.0 else 0
    regimes[IS_STALLED] = 1 if stalled else 0


@inline_kernel
def former_room(carts: int) -> tuple[int, int]:
    """Return the lengths of the float and integer arrays that `advance_in` needs."""
    size, places = room_sizes(2, LAWS, OWN_SIGNALS, STATE_SIZE)
    return STATE_SIZE + KEPT + carts + size, 5 + places


@borrowing_kernel
def advance_in(
    former: Former, torque: MotorInStep, times: tuple[float, float], stop_rad: float, state: Array,
    modes: Modes, log: Array, numbers: Array, marks: Indices,
) -> Advance:  # fmt: skip
    """Integrate as `advance_motion` does, with given work arrays."""
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
    for i in range(STATE_SIZE):
        state[i] = y[i]
    state[DRIVE] = y[DRIVE] - y[SPEED]
    after = Modes(
        sense_of(regimes[CRANK_LAW]), sense_of(regimes[DRIVE_LAW]), regimes[LOAD_ON] == 1, kept[SHARE], kept[SLOW_S],
        regimes[IS_STALLED] == 1,
    )  # fmt: skip
    return Advance(times[0] + kept[SINCE_S], count, after, room.steps[0])


@kernel
def advance_motion(
    former: Former, torque: MotorInStep, t: float, end_s: float, y: Array, modes: Modes, log: Array,
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
    modes : Modes
        Modes at the start.
    log : array
        Table of events, filled; returned, longer where it has to be.
    stop_rad : float
        Crank angle to stop at (landed on), ``inf`` for none.
    """
    size, places = former_room(former.bank.offset_rad.size)
    numbers, marks, start = np.zeros(size), np.zeros(places, dtype=np.int64), y.copy()
    done = advance_in(former, torque, (t, end_s), stop_rad, y, modes, log, numbers, marks)
    while done.status == LOG_FULL:
        log = np.empty((2 * len(log) + 8, log.shape[1]))
        for i in range(len(y)):  # a slice would have numba compile the words of an error
            y[i] = start[i]
        done = advance_in(former, torque, (t, end_s), stop_rad, y, modes, log, numbers, marks)
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
