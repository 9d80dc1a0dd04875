# SPDX-License-Identifier: Apache-2.0
"""Extremes of one cycle on the continuous curve: gamma, torque, and the energy that the flywheel must store.

The turn has two smooth parts, contact to bottom and bottom to contact.  Each is sampled with both ends; every local
maximum near the largest is refined by golden sections between its neighbours, so that an extreme is that of the curve,
not of its samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.compaction_press.dynamics import CONTACT, FREE, Press, press_reduced, press_weights
from mech_twin.machines.compaction_press.stroke_load import layer_work
from mech_twin.parts.four_bar import position

TURN = 2.0 * math.pi
SAMPLES = 96  # of each part of the turn
SECTIONS = 45  # golden ones: the bracket shrinks to 4e-10 of itself, a smooth maximum is then exact to rounding
GOLDEN = 0.6180339887498949
NEAR = 1e-2  # of a curve's range: a local maximum this close to the largest sample may lie above it
GAMMA, TORQUE, TORQUE_REVERSED, UPPER, LOWER_REVERSED = range(5)


class Turn(NamedTuple):
    """One turn at constant speed: first contact (rad), angle from it to the bottom (rad), speed (rad/s), direction.

    ``fast`` and ``slow`` are w_m (1 +- delta/2) (rad/s) of the required flywheel.
    """

    contact: float
    to_bottom: float
    speed: float
    direction: float
    fast: float
    slow: float


class CycleExtremes(NamedTuple):
    """Largest gamma (rad), largest and smallest drive torque (N m), max[W - w_max^2 I/2] and min[W - w_min^2 I/2] (J).

    W is counted from first contact.
    """

    gamma_max_rad: float
    torque_max_nm: float
    torque_min_nm: float
    upper_j: float
    lower_j: float


@kernel
def one_turn(contact: float, bottom: float, speed: float, delta: float) -> Turn:
    """Return a turn at ``speed`` (rad/s, of either sign) with first contact and bottom at these angles (rad)."""
    direction = 1.0 if speed >= 0.0 else -1.0
    mean = abs(speed)
    to_bottom = (direction * (bottom - contact)) % TURN
    return Turn(contact, to_bottom, speed, direction, mean * (1.0 + 0.5 * delta), mean * (1.0 - 0.5 * delta))


@kernel
def _curve(press: Press, turn: Turn, way: float, regime: int, what: int) -> float:
    f = turn.contact + turn.direction * way
    if what == GAMMA:
        at = position(press.bar, f)
        return abs(math.atan2(at.u_y, at.u_x))
    now = press_reduced(press, f, regime)
    torque = 0.5 * turn.speed * turn.speed * now.slope - now.moment
    if what == TORQUE:
        return torque
    if what == TORQUE_REVERSED:
        return -torque
    whole = layer_work(press.load, press.load.bottom_y_m)
    done = layer_work(press.load, now.y) if regime != FREE else whole
    work = whole * way / TURN - press_weights(press, f) - done
    if what == UPPER:
        return work - 0.5 * turn.fast * turn.fast * now.inertia
    return 0.5 * turn.slow * turn.slow * now.inertia - work


@kernel
def _refined_maximum(press: Press, turn: Turn, low: float, high: float, regime: int, what: int) -> float:
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = _curve(press, turn, left, regime, what), _curve(press, turn, right, regime, what)
    best = max(at_left, at_right)
    for _ in range(SECTIONS):
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            at_left = _curve(press, turn, left, regime, what)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            at_right = _curve(press, turn, right, regime, what)
        best = max(best, at_left, at_right)
    return best


@kernel
def _part_maximum(press: Press, turn: Turn, start: float, end: float, regime: int, what: int) -> float:
    """Return the largest value of a curve over one smooth part of the turn, its ends included."""
    step = (end - start) / (SAMPLES - 1)
    values = np.empty(SAMPLES)
    for k in range(SAMPLES):
        values[k] = _curve(press, turn, start + k * step, regime, what)
    best = float(values.max())
    asked = best - NEAR * (best - values.min())
    for k in range(SAMPLES):
        before, after = max(k - 1, 0), min(k + 1, SAMPLES - 1)
        if values[k] >= asked and values[k] >= values[before] and values[k] >= values[after]:
            low, high = start + before * step, start + after * step
            best = max(best, _refined_maximum(press, turn, low, high, regime, what))
    return best


@kernel
def _turn_maximum(press: Press, turn: Turn, what: int) -> float:
    pressing = _part_maximum(press, turn, 0.0, turn.to_bottom, CONTACT, what)
    return max(pressing, _part_maximum(press, turn, turn.to_bottom, TURN, FREE, what))


@kernel
def cycle_extremes(press: Press, turn: Turn) -> CycleExtremes:
    """Return the extremes over one turn at constant speed, the layer's law in force from contact to bottom."""
    return CycleExtremes(
        _turn_maximum(press, turn, GAMMA),
        _turn_maximum(press, turn, TORQUE),
        -_turn_maximum(press, turn, TORQUE_REVERSED),
        _turn_maximum(press, turn, UPPER),
        -_turn_maximum(press, turn, LOWER_REVERSED),
    )


@kernel
def asked_flywheel(found: CycleExtremes, turn: Turn) -> float:
    """Return the flywheel (kg m2) that keeps the speed within w_m (1 +- delta/2); negative where none is needed.

    J = {max[W - w_max^2 I/2] - min[W - w_min^2 I/2]}/(delta w_m^2), with delta w_m^2 = (w_max^2 - w_min^2)/2.
    """
    return (found.upper_j - found.lower_j) / (0.5 * (turn.fast * turn.fast - turn.slow * turn.slow))


@kernel
def transmission_range(press: Press) -> tuple[float, float]:
    """Return the smallest and largest angle between plate and pendulum at B over a full turn (rad, 0 to pi).

    It depends on the distance AC alone, which runs from | |OC| - r | to |OC| + r: both ends follow by the cosine rule.
    """
    bar = press.bar
    ground = math.hypot(bar.pivot_x_m, bar.pivot_y_m)
    double = 2.0 * bar.coupler_m * bar.rocker_m
    squares = bar.coupler_m * bar.coupler_m + bar.rocker_m * bar.rocker_m
    near, far = ground - bar.crank_m, ground + bar.crank_m
    least = math.acos(min(1.0, max(-1.0, (squares - near * near) / double)))
    return least, math.acos(min(1.0, max(-1.0, (squares - far * far) / double)))
