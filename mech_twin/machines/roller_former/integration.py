"""Integration of the roller former between two instants: one compiled kernel with error control.

Method: Dormand and Prince, eighth order with embedded fifth and third (the coefficients of scipy's DOP853).  Every
step ends at the latest where something happens: the event is bracketed by repeated steps and landed on.

Source: E. Hairer, S. Norsett, G. Wanner, Solving Ordinary Differential Equations I, section II.5 and II.10.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853

from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.dynamics import (
    SIZE,
    Array,
    Former,
    Modes,
    Motion,
    Torque,
    gear_may_stick,
    may_stick,
    rates,
    state_of,
)
from mech_twin.machines.roller_former.events import (
    SIGNALS,
    EventLog,
    apply_event,
    count_slow_time,
    normalised_modes,
    signal,
    something_happened,
    stretch_from,
    with_load,
)

DONE, TOO_SHORT, TOO_MANY = range(3)
MOST_STEPS = 200_000  # in one call: half a minute of a step that is a thousandth of the shortest period allowed
SHORTEST_S = 1e-13
STAGES = 12
_A = np.ascontiguousarray(DOP853.A[:STAGES, :STAGES])
_B = np.ascontiguousarray(DOP853.B)
_C = np.ascontiguousarray(DOP853.C[:STAGES])
_E3 = np.ascontiguousarray(DOP853.E3)
_E5 = np.ascontiguousarray(DOP853.E5)


class Advance(NamedTuple):
    """Where an integration got to: time (s), how it ended, number of events logged, modes."""

    time_s: float
    status: int
    events: int
    modes: Modes


def ending(advance: Advance) -> str:
    """Return in one line why an integration did not reach its end."""
    if advance.status == TOO_SHORT:
        return f"no integration step is small enough at {advance.time_s:.6g} s: integrator.tolerance is too tight"
    return (
        f"more than {MOST_STEPS} integration steps in one coupling step at {advance.time_s:.6g} s: drive or carts are "
        "too stiff for coupling.step_s"
    )


@kernel
def take_step(motion: Motion, t: float, y: Array, h: float, k: Array, end: Array) -> None:
    """Fill ``end`` with the state a step ``h`` later; ``k[0]`` holds the rates at ``y`` and ``k[1:12]`` is filled."""
    for stage in range(1, STAGES):
        for i in range(SIZE):
            end[i] = y[i]
        for j in range(stage):
            weight = h * _A[stage, j]
            if weight != 0.0:
                for i in range(SIZE):
                    end[i] += weight * k[j, i]
        rates(motion, t + _C[stage] * h, end, k[stage])
    for i in range(SIZE):
        end[i] = y[i]
    for j in range(STAGES):
        weight = h * _B[j]
        if weight != 0.0:
            for i in range(SIZE):
                end[i] += weight * k[j, i]


@kernel
def step_error(h: float, tolerances: Array, k: Array) -> float:
    """Return the estimated error of a step over the tolerances: at most 1 is good."""
    fifth, third = 0.0, 0.0
    for i in range(SIZE):
        e5, e3 = 0.0, 0.0
        for j in range(STAGES + 1):
            e5 += _E5[j] * k[j, i]
            e3 += _E3[j] * k[j, i]
        fifth += (e5 / tolerances[i]) ** 2
        third += (e3 / tolerances[i]) ** 2
    if fifth == 0.0 and third == 0.0:
        return 0.0
    return float(abs(h) * fifth / np.sqrt((fifth + 0.01 * third) * SIZE))


@kernel
def root_step(motion: Motion, modes: Modes, code: int, t: float, h: float, y: Array, k: Array, end: Array) -> float:
    """Return the step after which event ``code`` has just happened, at most ``h``; ``end`` becomes the state there.

    False position with halved memory (Illinois); the bracket is kept and the far side returned.
    """
    low, high = 0.0, h
    at_low = signal(motion, modes, code, t, y)
    at_high = signal(motion, modes, code, t + h, end)
    if at_low > 0.0:
        end[:] = y
        return 0.0
    side = 0
    for _ in range(60):
        if high - low <= SHORTEST_S:
            break
        middle = high - at_high * (high - low) / (at_high - at_low)
        if not low < middle < high:
            middle = 0.5 * (low + high)
        take_step(motion, t, y, middle, k, end)
        value = signal(motion, modes, code, t + middle, end)
        if value > 0.0:
            high, at_high = middle, value
            at_low = 0.5 * at_low if side == 1 else at_low
            side = 1
        else:
            low, at_low = middle, value
            at_high = 0.5 * at_high if side == -1 else at_high
            side = -1
            if value == 0.0:
                high = middle
    take_step(motion, t, y, high, k, end)
    return high


@kernel
def dips(v0: float, v1: float, a0: float, a1: float) -> bool:
    """Return whether a speed may have gone through zero and back within a step (cubic through both ends)."""
    if v0 <= 0.0 or v1 <= 0.0 or a0 >= 0.0 or a1 <= 0.0:
        return False
    for part in range(1, 16):
        x = part / 16.0
        low = v0 * (1.0 - x) ** 2 * (1.0 + 2.0 * x) + a0 * x * (1.0 - x) ** 2 + v1 * x * x * (3.0 - 2.0 * x)
        if low - a1 * x * x * (1.0 - x) <= 0.0:
            return True
    return False


@kernel
def speed_dips(motion: Motion, modes: Modes, h: float, y: Array, k: Array, end: Array) -> bool:
    """Return whether crank or drive may have stopped and gone on within a step, unseen at its ends."""
    former, stretch = motion.former, motion.stretch
    before, after, rate, late = state_of(y), state_of(end), state_of(k[0]), state_of(k[STAGES])
    d = stretch.direction
    v0, v1 = d * before.crank_speed_rad_per_s, d * after.crank_speed_rad_per_s
    a0, a1 = d * rate.crank_speed_rad_per_s * h, d * late.crank_speed_rad_per_s * h
    if may_stick(former, modes) and dips(v0, v1, a0, a1):
        return True
    if not gear_may_stick(former):
        return False
    e = stretch.drive_direction
    v0 = e * (before.crank_speed_rad_per_s + before.twist_rate_rad_per_s)
    v1 = e * (after.crank_speed_rad_per_s + after.twist_rate_rad_per_s)
    a0 = e * (rate.crank_speed_rad_per_s + rate.twist_rate_rad_per_s) * h
    a1 = e * (late.crank_speed_rad_per_s + late.twist_rate_rad_per_s) * h
    return dips(v0, v1, a0, a1)


@kernel
def accepted_step(
    motion: Motion, modes: Modes, t: float, wanted: float, y: Array, k: Array, end: Array
) -> tuple[float, float]:
    """Return the step taken and the next one to try; ``end`` is the state after it.  The step is 0 if none is good."""
    h = wanted
    while h > SHORTEST_S:
        take_step(motion, t, y, h, k, end)
        rates(motion, t + h, end, k[STAGES])
        error = step_error(h, motion.former.tolerances, k)
        if error > 1.0 or not np.isfinite(error):
            h *= max(0.2, 0.9 * error ** (-0.125)) if np.isfinite(error) else 0.2
        elif h > 1e-6 and speed_dips(motion, modes, h, y, k, end):
            h *= 0.5
        else:
            growth = 5.0 if error < 1e-7 else min(5.0, max(0.3, 0.9 * error ** (-0.125)))
            return h, h * growth
    return 0.0, 0.0


@kernel
def advance_motion(
    former: Former, torque: Torque, t: float, end_s: float, y: Array, modes: Modes, log: EventLog, stop_rad: float
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
    k = np.zeros((STAGES + 1, SIZE))
    end, sides = np.empty(SIZE), np.empty(former.bank.offset_rad.size)
    modes = normalised_modes(former, torque, t, y, modes)
    wanted = modes.trial_step_s if modes.trial_step_s > 0.0 else end_s - t
    count, steps, fresh = 0, 0, True
    motion = Motion(former, torque, stretch_from(former, t, y, modes, sides, stop_rad), sides)
    while t < end_s and state_of(y).crank_rad < stop_rad:
        if fresh:
            motion = Motion(former, torque, stretch_from(former, t, y, modes, sides, stop_rad), sides)
            rates(motion, t, y, k[0])
            fresh = False
        steps += 1
        rise, limit = motion.stretch.share_rate, end_s - t
        if limit <= SHORTEST_S:  # an event just before the end: what is left is less than time is known to
            t = end_s
            break
        if rise > 0.0:
            limit = min(limit, max((1.0 - modes.load_share) / rise, SHORTEST_S * 2.0))
        h, following = accepted_step(motion, modes, t, min(wanted, limit), y, k, end)
        if h == 0.0 or steps > MOST_STEPS:
            return Advance(t, TOO_SHORT if h == 0.0 else TOO_MANY, count, modes)
        if h < wanted and following < wanted and h == limit:
            following = wanted
        code = -1
        if something_happened(motion, modes, end):
            for candidate in range(len(SIGNALS)):
                if signal(motion, modes, candidate, t + h, end) > 0.0:
                    h = root_step(motion, modes, candidate, t, h, y, k, end)
                    code = candidate
        modes, count = count_slow_time(former, t, h, state_of(end).crank_rad, modes, log, count)
        y[:] = end
        if rise > 0.0:
            whole = h == limit and h < end_s - t
            modes = with_load(modes, True, 1.0 if whole else min(1.0, modes.load_share + rise * h))
            fresh = fresh or modes.load_share >= 1.0
        t = end_s if h == end_s - t else t + h
        wanted = following
        if code >= 0:
            modes, count = apply_event(motion, code, t, y, modes, log, count)
            fresh = True
        elif not fresh:
            k[0] = k[STAGES]
    return Advance(t, DONE, count, with_trial_step(modes, wanted))


@kernel
def with_trial_step(modes: Modes, trial_step_s: float) -> Modes:
    """Return the modes with another step to try first."""
    return Modes(
        modes.direction,
        modes.drive_direction,
        modes.load_on,
        modes.load_share,
        modes.slow_s,
        modes.stalled,
        trial_step_s,
    )
