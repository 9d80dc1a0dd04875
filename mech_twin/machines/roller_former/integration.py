"""Integration of the roller former between two instants: one compiled kernel with error control.

Method: Dormand and Prince, eighth order with embedded fifth and third (the coefficients of scipy's DOP853).  Every
step ends at the latest where something happens: the event is bracketed by repeated steps and landed on.

Source: E. Hairer, S. Norsett, G. Wanner, Solving Ordinary Differential Equations I, section II.5 and II.10.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.cart_statics import holds_at_rest
from mech_twin.machines.roller_former.dynamics import (
    CRANK,
    SHARE,
    SIZE,
    SPEED,
    TRIAL_STEP,
    Former,
    Stretch,
    Torque,
    rates,
)
from mech_twin.machines.roller_former.events import (
    SIGNALS,
    apply_event,
    count_slow,
    normalise_modes,
    signal,
    something_happened,
    stretch_from,
)

FAILED = -1
SHORTEST_S = 1e-13
STAGES = 12
_A = np.ascontiguousarray(DOP853.A[:STAGES, :STAGES])
_B = np.ascontiguousarray(DOP853.B)
_C = np.ascontiguousarray(DOP853.C[:STAGES])
_E3 = np.ascontiguousarray(DOP853.E3)
_E5 = np.ascontiguousarray(DOP853.E5)


@kernel
def trial(
    former: Former,
    torque: Torque,
    stretch: Stretch,
    sides: NDArray[np.float64],
    t: float,
    h: float,
    y: NDArray[np.float64],
    k: NDArray[np.float64],
    end: NDArray[np.float64],
) -> None:
    """Fill ``end`` with the state a step ``h`` later; ``k[0]`` holds the rates at ``y`` and ``k[1:12]`` is filled."""
    for stage in range(1, STAGES):
        for i in range(SIZE):
            end[i] = y[i]
        for j in range(stage):
            weight = h * _A[stage, j]
            if weight != 0.0:
                for i in range(SIZE):
                    end[i] += weight * k[j, i]
        rates(former, torque, stretch, sides, t + _C[stage] * h, end, k, stage)
    for i in range(SIZE):
        end[i] = y[i]
    for j in range(STAGES):
        weight = h * _B[j]
        if weight != 0.0:
            for i in range(SIZE):
                end[i] += weight * k[j, i]


@kernel
def trial_error(former: Former, h: float, k: NDArray[np.float64]) -> float:
    """Return the estimated error of a step over the tolerance: at most 1 is good."""
    fifth, third = 0.0, 0.0
    for i in range(SIZE):
        e5, e3 = 0.0, 0.0
        for j in range(STAGES + 1):
            e5 += _E5[j] * k[j, i]
            e3 += _E3[j] * k[j, i]
        scale = former.tolerance * former.scales[i]
        fifth += (e5 / scale) ** 2
        third += (e3 / scale) ** 2
    if fifth == 0.0 and third == 0.0:
        return 0.0
    return float(abs(h) * fifth / np.sqrt((fifth + 0.01 * third) * SIZE))


@kernel
def root_step(
    former: Former,
    torque: Torque,
    stretch: Stretch,
    sides: NDArray[np.float64],
    modes: NDArray[np.float64],
    code: int,
    t: float,
    h: float,
    y: NDArray[np.float64],
    k: NDArray[np.float64],
    end: NDArray[np.float64],
) -> float:
    """Return the step after which event ``code`` has just happened, at most ``h``; ``end`` becomes the state there.

    False position with halved memory (Illinois); the bracket is kept and the far side returned.
    """
    low, high = 0.0, h
    at_low = signal(former, torque, stretch, modes, code, t, y)
    at_high = signal(former, torque, stretch, modes, code, t + h, end)
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
        trial(former, torque, stretch, sides, t, middle, y, k, end)
        value = signal(former, torque, stretch, modes, code, t + middle, end)
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
    trial(former, torque, stretch, sides, t, high, y, k, end)
    return high


@kernel
def speed_dips(
    stretch: Stretch, h: float, y: NDArray[np.float64], k: NDArray[np.float64], end: NDArray[np.float64]
) -> bool:
    """Return whether the speed may have gone through nought and back within a step (cubic through both ends)."""
    d = stretch.direction
    v0, v1, a0, a1 = d * y[SPEED], d * end[SPEED], d * k[0, SPEED] * h, d * k[STAGES, SPEED] * h
    if v0 <= 0.0 or v1 <= 0.0 or a0 >= 0.0 or a1 <= 0.0:
        return False
    for part in range(1, 16):
        x = part / 16.0
        low = v0 * (1.0 - x) ** 2 * (1.0 + 2.0 * x) + a0 * x * (1.0 - x) ** 2 + v1 * x * x * (3.0 - 2.0 * x)
        if low - a1 * x * x * (1.0 - x) <= 0.0:
            return True
    return False


@kernel
def accepted_step(
    former: Former,
    torque: Torque,
    stretch: Stretch,
    sides: NDArray[np.float64],
    t: float,
    wanted: float,
    y: NDArray[np.float64],
    k: NDArray[np.float64],
    end: NDArray[np.float64],
) -> tuple[float, float]:
    """Return the step taken and the next one to try; ``end`` is the state after it.  The step is 0 if none is good."""
    h = wanted
    dips = holds_at_rest(former.bank) and stretch.share > 0.0
    while h > SHORTEST_S:
        trial(former, torque, stretch, sides, t, h, y, k, end)
        rates(former, torque, stretch, sides, t + h, end, k, STAGES)
        error = trial_error(former, h, k)
        if error > 1.0 or not np.isfinite(error):
            h *= max(0.2, 0.9 * error ** (-0.125)) if np.isfinite(error) else 0.2
        elif dips and h > 1e-6 and speed_dips(stretch, h, y, k, end):
            h *= 0.5
        else:
            growth = 5.0 if error < 1e-7 else min(5.0, max(0.3, 0.9 * error ** (-0.125)))
            return h, h * growth
    return 0.0, 0.0


@kernel
def advance_motion(
    former: Former,
    torque: Torque,
    t: float,
    end_s: float,
    y: NDArray[np.float64],
    modes: NDArray[np.float64],
    events: NDArray[np.float64],
    stop_rad: float,
) -> tuple[float, int]:
    """Carry state and modes on to ``end_s``, or to the crank angle ``stop_rad`` if that is reached first.

    Parameters
    ----------
    former, torque
        Constants, and the motor's torque during the interval.
    t, end_s : float
        Start and end, s.
    y : array, shape (7,)
        State (rad, rad, rad/s, rad/s, J, J, J), changed in place.
    modes : array, shape (6,)
        Travel direction (0 held), load engaged, load share, seconds below the stall threshold (-1: above), stalled,
        next step to try (0: the whole interval); changed in place.
    events : array, shape (64, 3)
        Filled with time, kind and turn of what happened.
    stop_rad : float
        Crank angle to stop at (landed on), ``inf`` for none.

    Returns
    -------
    tuple of float, int
        Time reached, and the number of events; the number is -1 if no step was small enough.
    """
    k = np.zeros((STAGES + 1, SIZE))
    end = np.empty(SIZE)
    sides = np.empty(former.bank.carts.shape[0])
    normalise_modes(former, torque, y, modes)
    wanted = modes[TRIAL_STEP] if modes[TRIAL_STEP] > 0.0 else end_s - t
    count = 0
    fresh = True
    stretch = stretch_from(former, t, y, modes, sides, stop_rad)
    while t < end_s and y[CRANK] < stop_rad:
        if fresh:
            stretch = stretch_from(former, t, y, modes, sides, stop_rad)
            rates(former, torque, stretch, sides, t, y, k, 0)
            fresh = False
        limit = end_s - t
        if stretch.share_rate > 0.0:
            limit = min(limit, max((1.0 - modes[SHARE]) / stretch.share_rate, SHORTEST_S * 2.0))
        h, following = accepted_step(former, torque, stretch, sides, t, min(wanted, limit), y, k, end)
        if h == 0.0:
            return t, FAILED
        if h < wanted and following < wanted and h == limit:
            following = wanted
        code = -1
        if something_happened(former, torque, stretch, modes, t + h, end):
            for candidate in range(SIGNALS):
                if signal(former, torque, stretch, modes, candidate, t + h, end) > 0.0:
                    h = root_step(former, torque, stretch, sides, modes, candidate, t, h, y, k, end)
                    code = candidate
        count = count_slow(former, t, h, end, modes, events, count)
        y[:] = end
        t = end_s if h == end_s - t else t + h
        wanted = following
        if stretch.share_rate > 0.0:
            modes[SHARE] = 1.0 if h == limit and h < end_s - t else min(1.0, modes[SHARE] + stretch.share_rate * h)
            fresh = fresh or modes[SHARE] >= 1.0
        if code >= 0:
            count = apply_event(former, stretch, code, t, y, modes, events, count)
            fresh = True
        elif not fresh:
            k[0] = k[STAGES]
    modes[TRIAL_STEP] = wanted
    return t, count
