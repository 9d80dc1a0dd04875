# SPDX-License-Identifier: Apache-2.0
"""One cycle of the press: torque, work, energy and inertia over the crank's turn, and the required flywheel.

Extremes (gamma, torque, energy that the flywheel must store) are those of the continuous curve.  The turn has two
smooth parts, contact to bottom and bottom to contact.  Each is sampled with both ends; every local maximum near the
largest is refined by golden sections between its neighbours, so that an extreme is that of the curve, not of its
samples.
"""

import math
from math import pi
from typing import NamedTuple

import numpy as np

from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.compaction_press.dynamics import (
    CONTACT,
    CONTACT_REVERSED,
    FREE,
    TURN,
    Press,
    Stroke,
    gains,
    layer_work,
    loaded_height,
    press_pins,
    press_reduced,
    press_weights,
    regime_at,
)
from mech_twin.machines.compaction_press.parameters import LEAST_TRANSMISSION_DEG
from mech_twin.parts.flywheel import (
    exact_inertia,
    mertsalov_inertia,
    non_uniformity,
    start_speed,
    textbook_inertia,
    wittenbauer,
)
from mech_twin.parts.four_bar import position

SAMPLES = 96  # of each part of the turn; more where a small transmission angle makes peaks narrow
SHARP = math.radians(20.0)  # transmission angle from which on peaks are narrower than usual
SHARPEST = math.radians(LEAST_TRANSMISSION_DEG)
SECTIONS = 45  # golden ones: the bracket shrinks to 4e-10 of itself, a smooth maximum is then exact to rounding
GOLDEN = 0.6180339887498949
NEAR = 1e-2  # of a curve's range: a local maximum this close to the largest sample may lie above it
GAMMA, TORQUE, TORQUE_REVERSED, UPPER, LOWER_REVERSED = range(5)
POSITIONS = 3600
WORK_POSITIONS = 36000


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
    least, most = transmission_range(press)
    count = int(SAMPLES * max(1.0, SHARP / max(SHARPEST, min(least, pi - most))))
    step = (end - start) / (count - 1)
    values = np.empty(count)
    for k in range(count):
        values[k] = _curve(press, turn, start + k * step, regime, what)
    best = float(values.max())
    asked = best - NEAR * (best - values.min())
    for k in range(count):
        before, after = max(k - 1, 0), min(k + 1, count - 1)
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


class PressCycle(NamedTuple):
    """Columns in the order of motion, shape (n,): crank angle (rad), torques (N m), energies (J), inertia (kg m2).

    ``load_torque`` is M_pr, ``drive_torque`` the torque at constant speed, ``work`` W of the constant mean torque and
    all loads (J) from the first position, counted along the motion; ``kinetic`` I_pr w^2/2 (J).
    """

    angle_rad: Array
    load_torque_nm: Array
    drive_torque_nm: Array
    work_j: Array
    kinetic_j: Array
    inertia_kg_m2: Array


@kernel
def _columns(press: Press, angles: Array, regimes: Array, w: float) -> Array:
    """Return reduced moment, drive torque (N m), potential, layer's work (J), inertia (kg m2) over angles (rad)."""
    table = np.empty((5, angles.size))
    for i in range(angles.size):
        now = press_reduced(press, angles[i], int(regimes[i]))
        table[0, i], table[1, i] = now.moment, press_pins(press, angles[i], w, 0.0, now.force).moment
        table[2, i], table[4, i] = press_weights(press, angles[i]), now.inertia
        table[3, i] = layer_work(press.load, now.y) if regimes[i] != FREE else 0.0
    return table


def press_cycle(press: Press, stroke: Stroke, speed: float, count: int, kinks: bool = True) -> PressCycle:
    """Return one cycle at ``count`` equally spaced positions from crank angle 0 along the motion.

    The work is in closed form: weights have a potential, and the layer's force has one in the height.  ``kinks`` adds
    the angles of first contact and of the bottom to the positions, since extremes may be there.
    """
    sign = 1.0 if speed >= 0.0 else -1.0
    entry = stroke.contact if sign > 0 else stroke.contact_reversed
    way = np.asarray(np.arange(count) * (TURN / count), dtype=np.float64)
    entry_way, bottom_way = (sign * entry) % TURN, (sign * stroke.bottom) % TURN
    if kinks:
        way = np.unique(np.append(way, (entry_way, bottom_way)))
    started_inside = bottom_way < entry_way
    before_bottom, met = way < bottom_way, way >= entry_way
    inside = (met | before_bottom) if started_inside else (met & before_bottom)
    regimes = np.where(inside, CONTACT if sign > 0 else CONTACT_REVERSED, FREE).astype(np.float64)
    angles = np.asarray(sign * way, dtype=np.float64)
    moment, drive, weights, pressed, inertia = _columns(press, angles, regimes, speed)
    whole = layer_work(press.load, stroke.bottom_y_m)
    # the layer's work so far along the motion, from position 0 on
    layer = np.where(inside, pressed, 0.0) + np.where(before_bottom, 0.0, whole)
    if started_inside:
        layer -= pressed[0]
    work = whole / TURN * way + (-(weights - weights[0]) - layer)
    return PressCycle(angles, moment, drive, work, 0.5 * inertia * speed * speed, inertia)


def layer_work_on_the_way(press: Press, stroke: Stroke, f: float, direction: float) -> float:
    """Return the work (J) done on the layer from crank angle 0 to ``f`` (rad), turning in one direction."""
    entry, bottom = (stroke.contact, stroke.bottom) if direction > 0.0 else (stroke.contact_reversed, stroke.bottom)
    turns, way = divmod(direction * f, TURN)
    entry_way, bottom_way = (direction * entry) % TURN, (direction * bottom) % TURN
    whole = float(layer_work(press.load, stroke.bottom_y_m))
    at_start = float(layer_work(press.load, loaded_height(press, 0.0)[0])) if bottom_way < entry_way else 0.0
    so_far = turns * whole - at_start
    if way >= bottom_way:
        so_far += whole
    if regime_at(stroke, f, direction) != FREE:
        so_far += float(layer_work(press.load, loaded_height(press, f)[0]))
    return so_far


def mean_torque(press: Press, stroke: Stroke, speed: float) -> float:
    """Return the constant drive torque (N m) of the cycle: the layer's work over the angle of a turn."""
    whole = float(layer_work(press.load, stroke.bottom_y_m)) / TURN
    return whole if speed >= 0.0 else -whole


def turn_at(stroke: Stroke, speed: float, delta: float) -> Turn:
    """Return the turn at constant ``speed`` (rad/s), for extremes with non-uniformity ``delta``."""
    return one_turn(stroke.contact if speed >= 0.0 else stroke.contact_reversed, stroke.bottom, speed, delta)


def turn_flywheel(press: Press, stroke: Stroke, speed: float, delta: float) -> float:
    """Return the flywheel (kg m2) required on the continuous curve; negative if none is needed."""
    turn = turn_at(stroke, speed, delta)
    return float(asked_flywheel(cycle_extremes(press, turn), turn))


def flywheel_metrics(press: Press, stroke: Stroke, speed: float, delta: float) -> dict[str, float]:
    """Return the flywheel on the continuous curve, its variants at 36000 and 12 positions, and delta without one."""
    w = abs(speed)
    fine = press_cycle(press, stroke, speed, WORK_POSITIONS)
    coarse = press_cycle(press, stroke, speed, 12, kinks=False)
    curve = (fine.work_j, fine.inertia_kg_m2, delta, w)
    few = (coarse.work_j, coarse.inertia_kg_m2, delta, w)
    cuts = wittenbauer(*curve)
    bare = non_uniformity(fine.work_j, fine.inertia_kg_m2, w)
    return {
        "non_uniformity_without_flywheel": bare,
        "flywheel_inertia_kg_m2": turn_flywheel(press, stroke, speed, delta),
        "flywheel_inertia_12_positions_kg_m2": exact_inertia(*few),
        "flywheel_inertia_wittenbauer_kg_m2": cuts.inertia_kg_m2,
        "flywheel_inertia_textbook_kg_m2": textbook_inertia(*curve),
        "flywheel_inertia_mertsalov_kg_m2": mertsalov_inertia(*curve),
        "wittenbauer_upper_cut_j": cuts.upper_j,
        "wittenbauer_lower_cut_j": cuts.lower_j,
        "energy_range_j": float(np.ptp(fine.work_j)),
        "start_speed_with_flywheel_rad_per_s": start_speed(
            fine.work_j, fine.inertia_kg_m2, min(delta, bare), w, max(0.0, cuts.inertia_kg_m2)
        ),
    }


@kernel
def gain_rows(press: Press, angles: Array) -> Array:
    """Return `gains` at crank angles (rad), shape (4, n)."""
    rows = np.empty((4, angles.size))
    for i in range(angles.size):
        rows[0, i], rows[1, i], rows[2, i], rows[3, i] = gains(press, angles[i])
    return rows
