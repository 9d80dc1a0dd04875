# SPDX-License-Identifier: Apache-2.0
"""Steady turn of the roller former under full load, motor and mechanism solved together, and its start.

A start is simulated until load and speed are steady, or the motor has stalled.
"""

from dataclasses import dataclass
from math import inf, isfinite, isnan, nan, pi
from typing import NamedTuple

import numpy as np

from mech_twin.engine.hybrid.loop import ENDED, UNSTEADY
from mech_twin.engine.sample_vectors import EVENT_WIDTH, Array
from mech_twin.errors import MotionError
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.roller_former.dynamics import (
    CRANK,
    LOADED,
    SPEED,
    TWIST_RATE,
    Former,
    FormerState,
    Modes,
    coupling_moment,
    geared,
    modes_of,
    shaft_torque,
    start_modes,
    state_array,
    state_of,
)
from mech_twin.machines.roller_former.motion import Advance, advance_motion, ending, twist_acceleration
from mech_twin.machines.roller_former.parameters import RollerFormer
from mech_twin.parts.induction_motor import limited_command, supplied_motor

TURN = 2.0 * pi
SLOW_S, STALLED = (Modes._fields.index(name) for name in ("slow_s", "stalled_1"))
CRITERION = 1e-11
MOST_TURNS = 400
SHOOT_FROM, SHOOT_EVERY = 20, 10  # turns: a heavy shaft on a steep motor comes to its speed over thousands
SHOT_OFFSET = 1e-4  # of the scales, for the slopes of the turn
SHOT_SHARES = (1.0, 0.5, 0.25, 0.125)  # of the correction: the motor's curve bends
MOST_STEADY_STEPS = 1_000_000  # of integration in all those turns: some ten seconds
NODES = 1440
LONGEST_TURN = 20.0  # times that at synchronous speed: slower, the machine does not run
STEADY = 1e-4  # change of the mean crank speed from turn to turn, relative
LONGEST_START_S = 60.0  # after the supply has reached its rated frequency
LONGEST_RAMP_S = 600.0
CHUNK_S = 0.001
MOST_START_STEPS = 250_000  # of integration: some ten seconds; a drive so stiff has no verdict within them


class TurnColumns(NamedTuple):
    """Nodes of one turn, equal in time: (nodes,) each."""

    time_s: Array
    crank_rad: Array
    crank_speed_rad_per_s: Array
    twist_rad: Array
    twist_rate_rad_per_s: Array
    twist_acceleration_rad_per_s2: Array
    coupling_nm: Array
    drive_nm: Array
    motor_nm: Array


@dataclass(frozen=True)
class SteadyTurn:
    """One turn of the periodic motion.

    ``works`` are the works of the turn (J), integrated with the motion.  ``change`` is the largest change of twist,
    crank speed and twist rate from the turn before, relative to their scales.
    """

    turn_time_s: float
    turns_taken: int
    change: float
    columns: TurnColumns
    works: FormerState

    @property
    def mean_speed_rad_per_s(self) -> float:
        """Mean crank speed over the turn."""
        return TURN / self.turn_time_s


def closed_extremes(values: Array) -> tuple[float, float]:
    """Return minimum and maximum of a periodic curve sampled at equal steps, each refined by a parabola."""
    found = []
    for sign in (-1.0, 1.0):
        curve = sign * values
        at = int(np.argmax(curve))
        before, here, after = curve[at - 1], curve[at], curve[(at + 1) % curve.size]
        bend = before - 2.0 * here + after
        lift = (before - after) ** 2 / (8.0 * -bend) if bend < 0.0 else 0.0
        found.append(float(sign * (here + lift)))
    return found[0], found[1]


def failed(done: Advance) -> bool:
    """Return whether an integration failed."""
    return done.status < 0 and done.status != ENDED


@kernel
def turned(
    former: Former, command: float, begin_s: float, longest_s: float, nodes: int, stop: float, y: Array, modes: Array
) -> tuple[Advance, TurnColumns]:
    """Integrate state and modes up to a crank angle, at most ``longest_s``; return the end, and the nodes' values.

    One kernel for a turn of unknown time and for the columns of a known one: each would hold the whole integration.
    """
    found, log = np.empty((9, nodes)), np.empty((8, EVENT_WIDTH))
    torque, done, mode = supplied_motor(former.motor, command), Advance(begin_s, 0, 0), modes_of(modes, 0)
    for node in range(nodes):
        now, t = state_of(y), begin_s + longest_s * node / nodes
        shaft = shaft_torque(former, torque, t, now.crank_speed_rad_per_s + now.twist_rate_rad_per_s)
        found[0, node], found[1, node], found[2, node] = t, now.crank_rad, now.crank_speed_rad_per_s
        found[3, node], found[4, node] = now.twist_rad, now.twist_rate_rad_per_s
        found[5, node] = twist_acceleration(former, torque, t, y, mode.drive_direction_1)
        found[6, node] = coupling_moment(former, now)
        found[7, node], found[8, node] = geared(former, shaft, mode.drive_direction_1), shaft
        until = begin_s + longest_s * (node + 1) / nodes
        done, log = advance_motion(former, torque, t, until, y, modes, log, stop)
    columns = TurnColumns(found[0], found[1], found[2], found[3], found[4], found[5], found[6], found[7], found[8])
    return done, columns


def next_section(former: Former, command: float, t: float, y: Array, modes: Array, longest_s: float) -> Advance:
    """Integrate state and modes over one whole turn; the time reached is nan if the turn does not end in time."""
    stop = y[CRANK] + TURN
    done, _ = turned(former, command, t, longest_s, 1, stop, y, modes)
    if y[CRANK] < stop:
        return done._replace(time_s=nan)
    y[CRANK] = stop - TURN
    return done


def closing_state(former: Former, y: Array, modes: Array, longest_s: float) -> tuple[Array, int]:
    """Return the state after one Newton step towards a periodic turn (shooting), and the integration steps it took.

    The step is on y - P(y) over twist, crank speed and twist rate, with P the map over a turn.  It is taken in full or
    in part.  Returned unchanged where a turn nearby does not end, the matrix is singular, or no step reduces y - P(y).
    """
    steps = 0

    def end_of_turn(start: Array) -> Array:
        nonlocal steps
        end, after = start.copy(), modes.copy()
        done = next_section(former, 1.0, 0.0, end, after, longest_s)
        steps += done.steps
        return end if not failed(done) and after[STALLED] == 0.0 and isfinite(done.time_s) else end * np.nan

    free = slice(CRANK + 1, TWIST_RATE + 1)
    scales = np.array(former.scales[free])
    base = end_of_turn(y)
    missed = (base - y)[free] / scales
    slopes = np.empty((len(scales), len(scales)))
    for i in range(len(scales)):
        beside = y.copy()
        beside[CRANK + 1 + i] += SHOT_OFFSET * scales[i]
        slopes[:, i] = (end_of_turn(beside) - base)[free] / scales / SHOT_OFFSET
    if not (np.isfinite(slopes).all() and np.isfinite(missed).all()):
        return y, steps
    try:
        correction = np.linalg.solve(np.eye(len(scales)) - slopes, missed)
    except np.linalg.LinAlgError:  # a turn that keeps what it is given: every state closes alike
        return y, steps
    for share in SHOT_SHARES:
        shot = y.copy()
        shot[free] += share * correction * scales
        if shot[SPEED] > 0.0 and np.abs((end_of_turn(shot) - shot)[free] / scales).max() < np.abs(missed).max():
            return shot, steps
    return y, steps


def steady_turn(former: Former) -> SteadyTurn | None:
    """Return the periodic motion under full load at rated supply, or None if the motor cannot keep it up.

    Started at synchronous speed, untwisted.  Steady means that from one passage of the starting crank angle to the
    next twist, crank speed and twist rate change by less than 1e-11 of their scales.  The scales are the twist of the
    rated moment and synchronous speed; a hundredth of the integrator's tolerance counts if it is more.  After twenty
    turns without success, Newton steps are tried as well (`closing_state`).  None too if the turn is not steady within
    `MOST_TURNS` or within the budget of integration steps.

    Raises
    ------
    MotionError
        If the integration cannot go on.
    """
    speed = former.motor.synchronous_speed_rad_per_s / former.ratio
    y, modes, t = state_array(0.0, speed), np.array(LOADED), 0.0
    longest_s = LONGEST_TURN * TURN / speed
    criterion = max(CRITERION, float(np.max(former.tolerances / np.array(former.scales))) / 100.0)
    free, steps = slice(CRANK + 1, TWIST_RATE + 1), 0
    for turns in range(1, MOST_TURNS + 1):
        before = y.copy()
        done = next_section(former, 1.0, t, y, modes, longest_s)
        steps += done.steps
        if (failed(done) and done.status != UNSTEADY) or steps > MOST_STEADY_STEPS:
            return None
        if failed(done):
            raise MotionError(f"roller_former: {ending(done)}")
        if not isfinite(done.time_s) or modes[STALLED] > 0.0:
            return None
        change = float((np.abs(y - before)[free] / former.scales[free]).max())
        works, y = y, state_array(0.0, 0.0) + y * KEPT
        if change < criterion:
            _, columns = turned(former, 1.0, 0.0, done.time_s - t, NODES, inf, y, modes)
            return SteadyTurn(done.time_s - t, turns, change, columns, FormerState(*works.tolist()))
        t = done.time_s
        if turns >= SHOOT_FROM and turns % SHOOT_EVERY == 0:
            y, shot_steps = closing_state(former, y, modes, longest_s)
            steps += shot_steps
    return None


KEPT = np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # coordinates go on, works begin anew with each turn


@dataclass(frozen=True)
class StartUp:
    """How a start ends.

    ``stalled`` and ``steady`` are both false if neither has happened within a minute of full supply: the load is not
    applied, the speed still changes, or the drive is too stiff to be integrated so long.  ``time_s`` is the time at
    which the crank first reached the required speed, ``steady_time_s`` that at which load and speed were steady,
    ``stall_time_s`` that of the stall (nan: never).
    """

    stalled: bool
    steady: bool
    time_s: float
    steady_time_s: float
    stall_time_s: float


@kernel
def start_motion(
    former: Former,
    supply: tuple[float, float],
    goal_rad_per_s: float,
    longest_s: float,
    y: Array,
    modes: Array,
) -> tuple[Advance, float, bool]:
    """Integrate until load and speed are steady or the motor has stalled, at most ``longest_s``.

    ``supply`` is the fraction at the start and its rate (1/s).  Returns the end of the integration, the time at which
    the crank first reached the goal (nan: never), and whether it is steady.  Steady: the whole load on, supply at rated
    frequency, and three turns in a row of the same duration.
    """
    command, rate = supply
    reached = 0.0 if y[SPEED] >= goal_rad_per_s else nan
    passed, last_turn_s, alike, t = y[CRANK], nan, 0, 0.0
    section_s, log = nan, np.empty((8, EVENT_WIDTH))
    done, steps, mode = Advance(t, 0, 0), 0, modes_of(modes, 0)
    for chunk in range(round(longest_s / CHUNK_S)):
        command = limited_command(command, 1.0, rate, CHUNK_S)
        t, before, angle = chunk * CHUNK_S, y[SPEED], y[CRANK]
        torque = supplied_motor(former.motor, command)
        done, log = advance_motion(former, torque, t, t + CHUNK_S, y, modes, log, inf)
        steps += done.steps
        if done.status < 0 or mode.stalled_1 > 0.0 or steps > MOST_START_STEPS:
            return done, reached, False
        if isnan(reached) and y[SPEED] >= goal_rad_per_s > before:
            reached = t + (goal_rad_per_s - before) / (y[SPEED] - before) * CHUNK_S
        if command < 1.0 or mode.load_on_1 == 0.0 or mode.load_share_1 < 1.0:
            passed, section_s, last_turn_s, alike = y[CRANK], nan, nan, 0
        elif y[CRANK] >= passed + TURN and y[CRANK] > angle:
            now = t + (passed + TURN - angle) / (y[CRANK] - angle) * CHUNK_S
            turn_s = now - section_s
            alike = alike + 1 if abs(turn_s - last_turn_s) < STEADY * last_turn_s else 0
            passed, section_s, last_turn_s = passed + TURN, now, turn_s
            if alike >= 2:
                return done, reached, True
    return done, reached, False


def start_up(parameters: RollerFormer, former: Former, goal_rad_per_s: float) -> StartUp:
    """Return the result of the configured start; ``goal_rad_per_s`` is the crank speed whose first passage is timed.

    Raises
    ------
    MotionError
        If the integration cannot go on.
    """
    p = parameters
    at = p.start.speed_fraction * p.synchronous_crank_speed_rad_per_s
    y, modes = state_array(p.start.crank_deg * TURN / 360.0, at), np.array(start_modes(former, at))
    ramp_s = min((1.0 - p.supply.initial_fraction) / p.supply.rate_per_s, LONGEST_RAMP_S)
    supply = (p.supply.initial_fraction, p.supply.rate_per_s)
    done, reached, steady = start_motion(former, supply, goal_rad_per_s, LONGEST_START_S + ramp_s, y, modes)
    if done.status < 0:
        raise MotionError(f"roller_former: {ending(done)}")
    stalled = bool(modes[STALLED] > 0.0)
    below = float(modes[SLOW_S]) - former.stall_time_s
    return StartUp(
        stalled,
        bool(steady),
        float(reached),
        float(done.time_s) if steady else nan,
        float(done.time_s - below) if stalled else nan,
    )
