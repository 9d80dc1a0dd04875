# SPDX-License-Identifier: Apache-2.0
"""Integration of the roller former between two instants: one compiled kernel with error control.

Method: Dormand and Prince, eighth order with embedded fifth and third (`engine.tableaus`).  Every step ends at the
latest where something happens: the first event is bracketed by repeated steps and landed on (`engine.events`).
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.events import NONE, Step, first_event
from mech_twin.engine.integration import (
    SHORTEST_S,
    Workspace,
    controlled_step,
    finish_step,
    start_step,
    take_step,
)
from mech_twin.engine.tableaus import DORMAND_PRINCE_8
from mech_twin.kernel import borrowing_kernel, kernel
from mech_twin.machines.roller_former.cart_statics import shaft_terms
from mech_twin.machines.roller_former.dynamics import (
    CRANK,
    SIZE,
    SPEED,
    Array,
    DriveLine,
    Former,
    Modes,
    TravelStretch,
    may_stick,
    state_of,
)
from mech_twin.machines.roller_former.events import (
    EventLog,
    apply_event,
    count_slow_time,
    normalised_modes,
    stretch_from,
    with_load,
)
from mech_twin.machines.roller_former.motion import (
    MOST_WATCHES,
    SHAFT_TURNS,
    FormerMotion,
    fill_watches,
    motion_signals,
    something_happened,
    turned_idly,
    without_shaft,
)

DONE, TOO_SHORT, TOO_MANY = range(3)
MOST_STEPS = 200_000  # in one call: some seconds
STAGES = len(DORMAND_PRINCE_8.weights)
CALM = 4.0  # of rate times step: up to 4.37 a step of the method leaves a decaying speed its sign


class Advance(NamedTuple):
    """Where an integration got to: time (s), how it ended, number of events logged, modes, steps tried."""

    time_s: float
    status: int
    events: int
    modes: Modes
    steps: int


NO_STEP = f"no integration step of {SHORTEST_S:g} s or more is small enough"
TIGHT = "integrator.tolerance is too tight for these loads"


def ending(advance: Advance) -> str:
    """Return in one line why an integration did not reach its end."""
    at = f" at {advance.time_s:.6g} s" if isfinite(advance.time_s) else ""
    if advance.status == TOO_SHORT:
        return f"{NO_STEP}{at}: {TIGHT}"
    return (
        f"more than {MOST_STEPS} integration steps{at}: drive.stiffness_nm_per_rad, "
        "drive.damping_nms_per_rad or friction.viscous_nms_per_rad is too large for the inertia"
    )


@borrowing_kernel
def happened_already(motion: FormerMotion, modes: Modes, watches: NDArray[np.int64], t: float, y: Array) -> int:
    """Return the first watched event whose signal is past its root when a stretch begins, or `NONE`."""
    for i in range(fill_watches(motion, modes, y, watches)):
        value, _ = motion_signals(motion, watches[i, 0], t, y)
        if value > 0.0:
            return int(watches[i, 0])
    return NONE


@borrowing_kernel
def keep_digits(motion: FormerMotion, y: Array, h: float, end: Array, work: Workspace, lost: Array) -> None:
    """Give the ``end`` of the step of ``h`` taken what rounding took from a heavy crank in the steps before.

    ``lost`` (2, SIZE) is what rounding took from its angle and speed before and after the step: summed over the steps
    of a turn it opens the balance of energy.
    """
    if not motion.former.heavy or motion.stretch.direction == 0.0:
        return
    for i in (CRANK, SPEED):
        change = 0.0
        for stage in range(STAGES):
            change += DORMAND_PRINCE_8.weights[stage] * work.rates[stage, i]
        change = h * change + lost[0, i]
        end[i] = y[i] + change
        lost[1, i] = change - (end[i] - y[i])


@kernel
def locate_event(
    motion: FormerMotion,
    modes: Modes,
    watches: NDArray[np.int64],
    t: float,
    y: Array,
    h: float,
    end: Array,
    work: Workspace,
    lost: Array,
) -> tuple[int, float]:
    """Return the event that ends a step of ``h``, or `NONE`, and the step up to it; ``end`` becomes the state there."""
    end[:] = work.end
    keep_digits(motion, y, h, end, work, lost)
    if not something_happened(motion, modes, y, t + h, end, h, work.rates):
        return NONE, h
    if turned_idly(motion, y, t + h, end, h) and not something_happened(
        without_shaft(motion), modes, y, t + h, end, h, work.rates
    ):
        return SHAFT_TURNS, h
    count = fill_watches(motion, modes, y, watches)
    which, span = first_event(Step(motion, t, y, h, work), watches, count, end)
    if which == NONE:
        finish_step(motion, t, h, Workspace(work.rates, work.stage, end))
        return NONE, h
    take_step(motion, t, y, span, work)
    end[:] = work.end
    keep_digits(motion, y, span, end, work, lost)
    return int(watches[which, 0]), span


@borrowing_kernel
def longest_step(stretch: TravelStretch, modes: Modes, left_s: float) -> float:
    """Return the longest step (s): up to the end, or to where the load has risen to its full size."""
    if stretch.share_rate <= 0.0:
        return left_s
    return min(left_s, max((1.0 - modes.load_share) / stretch.share_rate, 2.0 * SHORTEST_S))


@borrowing_kernel
def calm_step(motion: FormerMotion, modes: Modes, y: Array, wanted: float) -> float:
    """Return the step to try (s): of a crank that creeps, one in which the method turns no decay into a reversal.

    Below its tolerance error control no longer sees the sign of a speed, which is an event where the crank may stick.
    """
    former, now = motion.former, state_of(y)
    creeps = abs(now.crank_speed_rad_per_s) <= former.tolerances[SPEED]
    if not creeps or motion.stretch.direction == 0.0 or not may_stick(former, modes):
        return wanted
    inertia, _, _ = shaft_terms(former.bank, now.crank_rad, motion.sides, motion.stretch.direction)
    return min(wanted, CALM * inertia / max(former.viscous_nms_per_rad + former.damping_nms_per_rad, 1e-300))


@kernel
def advance_motion(
    former: Former, torque: DriveLine, t: float, end_s: float, y: Array, modes: Modes, log: EventLog, stop_rad: float
) -> Advance:
    """Carry the state on to ``end_s``, or to the crank angle ``stop_rad`` if that is reached first.

    Parameters
    ----------
    former, torque
        Constants, and the motor's torque during the interval.
    t, end_s : float
        Start and end, s.
    y : array, shape (8,)
        The `State`, changed in place.
    modes : Modes
        Modes at the start.
    log : EventLog
        Filled with what happened.
    stop_rad : float
        Crank angle to stop at (landed on), ``inf`` for none.

    Returns
    -------
    Advance
        The time reached, and the modes there.
    """
    work = Workspace(np.empty((16, SIZE)), np.empty(SIZE), np.empty(SIZE))
    end, sides, lost = np.empty(SIZE), np.empty(former.bank.offset_rad.size), np.zeros((2, SIZE))
    watches = np.zeros((MOST_WATCHES, 3), np.int64)
    modes = normalised_modes(former, torque, t, y, modes)
    wanted = modes.trial_step_s if modes.trial_step_s > 0.0 else end_s - t
    count, steps, fresh, passed = 0, 0, True, NONE
    motion = FormerMotion(former, torque, stretch_from(former, t, y, modes, sides, stop_rad, passed), sides)
    while end_s - t > SHORTEST_S and state_of(y).crank_rad < stop_rad:
        steps += 1
        if steps > MOST_STEPS:
            return Advance(t, TOO_MANY, count, modes, steps)
        if fresh:
            motion = FormerMotion(former, torque, stretch_from(former, t, y, modes, sides, stop_rad, passed), sides)
            code = happened_already(motion, modes, watches, t, y)
            if code != NONE:
                modes, count = apply_event(motion, code, t, y, modes, log, count)
                passed = code
                continue
            start_step(motion, t, y, work)
            fresh = False
        rise, limit = motion.stretch.share_rate, longest_step(motion.stretch, modes, end_s - t)
        trial = calm_step(motion, modes, y, min(max(wanted, 2.0 * SHORTEST_S), limit))
        h, following = controlled_step(motion, t, y, trial, former.tolerances, work)
        if h == 0.0:
            return Advance(t, TOO_SHORT, count, modes, steps)
        if not (h < wanted and following < wanted and h == limit):
            wanted = following
        code, h = locate_event(motion, modes, watches, t, y, h, end, work, lost)
        passed = code
        modes, count = count_slow_time(former, t, h, state_of(end).crank_rad, modes, log, count)
        y[:] = end
        if rise > 0.0:
            whole = h == limit and h < end_s - t
            modes = with_load(modes, True, 1.0 if whole else min(1.0, modes.load_share + rise * h))
            fresh = modes.load_share >= 1.0
        t = end_s if h == end_s - t else t + h
        if code != NONE:
            modes, count = apply_event(motion, code, t, y, modes, log, count)
            fresh = True
        for i in (CRANK, SPEED):
            lost[0, i] = lost[1, i] if y[i] == end[i] else 0.0  # what an event sets it sets exactly
        if not fresh:
            work.rates[0] = work.rates[STAGES]
    reached = end_s if state_of(y).crank_rad < stop_rad else t
    return Advance(reached, DONE, count, with_trial_step(modes, wanted), steps)


@borrowing_kernel
def with_trial_step(modes: Modes, trial_step_s: float) -> Modes:
    """Return the modes with another step to try first."""
    return Modes(
        modes.direction,
        modes.drive_direction,
        modes.shaft_sense,
        modes.load_on,
        modes.load_share,
        modes.slow_s,
        modes.stalled,
        trial_step_s,
    )
