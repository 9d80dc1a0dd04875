"""The coupled motion through time: one eighth-order step, and the instants at which something happens inside it.

Every event is a sign change of a smooth function of the time since the start of a substep.  The function is evaluated
by integrating from that start to the time asked for with the full order (no interpolant), so a root is as exact as the
motion itself.  A function that touches zero between the ends of a substep shows by the sign of its derivative, or by
the parabola through three points, and is followed to its extreme first: nothing is stepped over.

Integrator: Cooper and Verner 1972, 11 stages, order 8.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import (
    PHI,
    STATES,
    Breaker,
    P,
    Q,
    U,
    derivatives,
    gap,
)

Array = NDArray[np.float64]

STAGES = 11
GAP, CLOSING, LIFT, SINKING, COLLAR, ANGLE = 0, 1, 2, 3, 4, 5  # functions whose roots are events
SINGLE_STEP_RAD = 0.04  # longest turn of the crank in one substep: truncation below 1e-13
LONGEST_SUBSTEP_S = 5e-4
_r = math.sqrt(21.0)
NODES = np.array([0, 0.5, 0.5, (7 + _r) / 14, (7 + _r) / 14, 0.5, (7 - _r) / 14, (7 - _r) / 14, 0.5, (7 + _r) / 14, 1])
WEIGHTS = np.array([1 / 20, 0, 0, 0, 0, 0, 0, 49 / 180, 16 / 45, 49 / 180, 1 / 20])


def _tableau() -> Array:
    rows: tuple[tuple[float, ...], ...] = (
        (),
        (1 / 2,),
        (1 / 4, 1 / 4),
        (1 / 7, (-7 - 3 * _r) / 98, (21 + 5 * _r) / 49),
        ((11 + _r) / 84, 0, (18 + 4 * _r) / 63, (21 - _r) / 252),
        ((5 + _r) / 48, 0, (9 + _r) / 36, (-231 + 14 * _r) / 360, (63 - 7 * _r) / 80),
        (
            (10 - _r) / 42,
            0,
            (-432 + 92 * _r) / 315,
            (633 - 145 * _r) / 90,
            (-504 + 115 * _r) / 70,
            (63 - 13 * _r) / 35,
        ),
        (1 / 14, 0, 0, 0, (14 - 3 * _r) / 126, (13 - 3 * _r) / 63, 1 / 9),
        (1 / 32, 0, 0, 0, (91 - 21 * _r) / 576, 11 / 72, (-385 - 75 * _r) / 1152, (63 + 13 * _r) / 128),
        (
            1 / 14,
            0,
            0,
            0,
            1 / 9,
            (-733 - 147 * _r) / 2205,
            (515 + 111 * _r) / 504,
            (-51 - 11 * _r) / 56,
            (132 + 28 * _r) / 245,
        ),
        (
            0,
            0,
            0,
            0,
            (-42 + 7 * _r) / 18,
            (-18 + 28 * _r) / 45,
            (-273 - 53 * _r) / 72,
            (301 + 53 * _r) / 72,
            (28 - 28 * _r) / 45,
            (49 - 7 * _r) / 18,
        ),
    )
    table = np.zeros((STAGES, STAGES))
    for i, row in enumerate(rows):
        table[i, : len(row)] = row
    return table


TABLEAU = _tableau()


@kernel
def integrated(
    b: Breaker, state: Array, torque: float, slope: float, rests: bool, span: float, slopes: Array, out: Array
) -> None:
    """Fill ``out`` with the state a span (s) later under the motor torque ``torque + slope t`` (N m, N m/s).

    ``slopes`` is working room of shape (stages + 1, states).
    """
    for i in range(STAGES):
        for k in range(STATES):
            total = 0.0
            for j in range(i):
                total += TABLEAU[i, j] * slopes[j, k]
            slopes[STAGES, k] = state[k] + span * total
        derivatives(b, slopes[STAGES], torque + slope * NODES[i] * span, rests, slopes[i])
    for k in range(STATES):
        total = 0.0
        for i in range(STAGES):
            total += WEIGHTS[i] * slopes[i, k]
        out[k] = state[k] + span * total


@kernel
def indicator(b: Breaker, which: int, state: Array, torque: float, rests: bool, aim: float, room: Array) -> float:
    """Return the function whose root is sought, in one state: gap, closing speed, lift, lift's rate, R, or q - aim."""
    if which == GAP:
        return gap(b, state[Q], state[U], state[PHI], state[P])[0]
    if which == CLOSING:
        return gap(b, state[Q], state[U], state[PHI], state[P])[1]
    if which == LIFT:
        return float(state[PHI])
    if which == SINKING:
        return float(state[P])
    if which == COLLAR:
        return derivatives(b, state, torque, rests, room)
    return float(state[Q] - aim)


@kernel
def indicated(
    b: Breaker,
    which: int,
    state: Array,
    torque: float,
    slope: float,
    rests: bool,
    aim: float,
    span: float,
    slopes: Array,
    out: Array,
) -> float:
    """Return the function a span after the state; ``out`` receives the state there."""
    integrated(b, state, torque, slope, rests, span, slopes, out)
    value = indicator(b, which, out, torque + slope * span, rests, aim, slopes[0])
    return value / span if which == LIFT and span > 0.0 and state[PHI] == 0.0 else value


@kernel
def root(
    b: Breaker,
    which: int,
    state: Array,
    torque: float,
    slope: float,
    rests: bool,
    aim: float,
    low: float,
    low_value: float,
    high: float,
    high_value: float,
    slopes: Array,
    out: Array,
) -> float:
    """Return the span (s) of the root between two spans of opposite sign: secant steps kept in their bracket.

    The lift of a body that starts on its collar is divided by the span, which takes out the root at the start.  The
    bracket is halved whenever the secant (Illinois) gains little; it ends at the last bits of the span.
    """
    side = 0
    for turn in range(100):
        width = high - low
        if width <= 4e-16 * high + 1e-22 or low_value == 0.0 or high_value == 0.0:
            break
        middle = high - high_value * width / (high_value - low_value)
        if turn % 4 == 3 or not low < middle < high:
            middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        value = indicated(b, which, state, torque, slope, rests, aim, middle, slopes, out)
        if (value > 0.0) == (high_value > 0.0):
            high, high_value = middle, value
            if side == 1:
                low_value *= 0.5
            side = 1
        else:
            low, low_value = middle, value
            if side == -1:
                high_value *= 0.5
            side = -1
    return low if low_value == 0.0 else high


@kernel
def crossing(
    b: Breaker,
    which: int,
    rate: int,
    state: Array,
    torque: float,
    slope: float,
    rests: bool,
    span: float,
    end: Array,
    slopes: Array,
    out: Array,
) -> float:
    """Return the span at which a positive function first falls through zero within the substep, or -1.

    ``rate`` names the function's own derivative up to sign (closing speed for the gap, p for the lift): where it
    changes sign inside, the function is followed to its lowest point before it is called positive throughout.
    """
    start = indicator(b, which, state, torque, rests, 0.0, slopes[0])
    if which == LIFT and start == 0.0:
        start = state[P] if state[P] != 0.0 else 1e-300
    final = indicator(b, which, end, torque + slope * span, rests, 0.0, slopes[0])
    sign = -1.0 if rate == CLOSING else 1.0
    falling = sign * indicator(b, rate, state, torque, rests, 0.0, slopes[0])
    rising = sign * indicator(b, rate, end, torque, rests, 0.0, slopes[0])
    if start <= 0.0:
        return 0.0 if falling < 0.0 else -1.0
    if final > 0.0 and not (falling < 0.0 < rising):
        return -1.0
    if final > 0.0:
        span = root(b, rate, state, torque, slope, rests, 0.0, 0.0, sign * falling, span, sign * rising, slopes, out)
        final = indicated(b, which, state, torque, slope, rests, 0.0, span, slopes, out)
        if final > 0.0:
            return -1.0
    return root(b, which, state, torque, slope, rests, 0.0, 0.0, start, span, final, slopes, out)


@kernel
def release(
    b: Breaker, state: Array, torque: float, slope: float, span: float, end: Array, slopes: Array, out: Array
) -> float:
    """Return the span at which the collar's moment R on a resting body falls through zero, or -1."""
    start = derivatives(b, state, torque, True, slopes[0])
    if start <= 0.0:
        return 0.0
    final = derivatives(b, end, torque + slope * span, True, slopes[0])
    if final > 0.0:
        middle = indicated(b, COLLAR, state, torque, slope, True, 0.0, 0.5 * span, slopes, out)
        curve = start - 2.0 * middle + final
        lowest = 0.5 - 0.25 * (final - start) / curve if curve > 0.0 else -1.0
        if not 0.0 < lowest < 1.0:
            return -1.0
        span *= lowest
        final = indicated(b, COLLAR, state, torque, slope, True, 0.0, span, slopes, out)
        if final > 0.0:
            return -1.0
    return root(b, COLLAR, state, torque, slope, True, 0.0, 0.0, start, span, final, slopes, out)
