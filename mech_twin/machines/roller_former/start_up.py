# SPDX-License-Identifier: Apache-2.0
"""Start of the roller former: simulated until load and speed are steady, or the motor has stalled."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isnan, nan

import numpy as np

from mech_twin.engine.errors import MotionError
from mech_twin.engine.sample_vectors import EVENT_WIDTH
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.roller_former.dynamics import CRANK, SPEED, Array, Former, Modes, state_array
from mech_twin.machines.roller_former.integration import Advance, advance_motion, ending
from mech_twin.machines.roller_former.parameters import RollerFormer
from mech_twin.machines.roller_former.roles import start_modes
from mech_twin.machines.roller_former.steady import TURN
from mech_twin.parts.induction_motor import supplied_motor
from mech_twin.parts.supply import limited_command

STEADY = 1e-4  # change of the mean crank speed from turn to turn, relative
LONGEST_START_S = 60.0  # after the supply has reached its rated frequency
LONGEST_RAMP_S = 600.0
CHUNK_S = 0.001
MOST_START_STEPS = 1_000_000  # of integration: some ten seconds; a drive so stiff has no verdict within them


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
    load_on: bool
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
    modes: Modes,
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
    done, steps = Advance(t, 0, modes, 0), 0
    for chunk in range(round(longest_s / CHUNK_S)):
        command = limited_command(command, 1.0, rate, CHUNK_S)
        t, before, angle = chunk * CHUNK_S, y[SPEED], y[CRANK]
        torque = supplied_motor(former.motor, command)
        done, log = advance_motion(former, torque, t, t + CHUNK_S, y, done.modes, log, inf)
        steps += done.steps
        if done.status < 0 or done.modes.stalled or steps > MOST_START_STEPS:
            return done, reached, False
        if isnan(reached) and y[SPEED] >= goal_rad_per_s > before:
            reached = t + (goal_rad_per_s - before) / (y[SPEED] - before) * CHUNK_S
        if command < 1.0 or not done.modes.load_on or done.modes.load_share < 1.0:
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
    y, modes = state_array(p.start.crank_deg * TURN / 360.0, at), start_modes(former, at)
    ramp_s = min((1.0 - p.supply.initial_fraction) / p.supply.rate_per_s, LONGEST_RAMP_S)
    supply = (p.supply.initial_fraction, p.supply.rate_per_s)
    done, reached, steady = start_motion(former, supply, goal_rad_per_s, LONGEST_START_S + ramp_s, y, modes)
    if done.status < 0:
        raise MotionError(f"roller_former: {ending(done)}")
    stalled = bool(done.modes.stalled)
    below = done.modes.slow_s - former.stall_time_s
    return StartUp(
        stalled,
        bool(steady),
        bool(done.modes.load_on),
        float(reached),
        float(done.time_s) if steady else nan,
        float(done.time_s - below) if stalled else nan,
    )
