# SPDX-License-Identifier: Apache-2.0
"""A coupling step of a crank at prescribed speed: its angle is a parabola in time, and the cuts are roots of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from mech_twin.engine.crank_motion import (
    AT_ANGLE,
    AT_REST,
    LONGEST_TURN_RAD,
    SPAN_ENDED,
    integrated_work,
)
from mech_twin.engine.crank_piece import (
    MOST_PIECES,
    TOLERANCE,
    TOO_MANY,
    WORK_UNKNOWN,
    apply_boundary,
    load_torque,
    next_boundary,
    rounding_work,
    sign_of,
    turn_back,
    work_scale,
)
from mech_twin.engine.crank_state import (
    LARGE_ANGLE,
    mechanism_load_work,
    within_a_turn,
)
from mech_twin.engine.crank_systems import LedMechanism
from mech_twin.engine.sample_vectors import (
    Array,
)
from mech_twin.kernel import kernel

if TYPE_CHECKING:
    from mech_twin.engine.crank_step import TurnedCrank


@kernel
def led_state(model: TurnedCrank, s: Any, h: float, end: float) -> bool:
    """Carry the state on for h (s) to an angle (rad) at constant acceleration; return whether the work is known."""
    friction, w, e = model.crank.friction, s.speed_rad_per_s, s.acceleration_rad_per_s2
    lost = friction.coulomb_nm * abs(end - s.angle_rad)
    lost += friction.viscous_nms_per_rad * h * (w * w + w * e * h + e * e * h * h / 3.0)
    work, regime, after = 0.0, int(s.regime), w + e * h
    if h > 0.0:
        system = LedMechanism(model.mechanism, within_a_turn(s.angle_rad), w, e, regime)
        fastest = max(abs(w), abs(after), 1e-9)
        work = integrated_work(system, h, TOLERANCE * work_scale(model, s, h), LONGEST_TURN_RAD / fastest)
    if abs(end) >= LARGE_ANGLE:
        work += rounding_work(model, end, after, e, regime, (end - s.angle_rad) - (w + 0.5 * e * h) * h)
    s.load_work_j = s.load_work_j + mechanism_load_work(model.mechanism, s.angle_rad, end, regime)
    s.angle_rad, s.speed_rad_per_s = end, after
    s.drive_work_j = s.drive_work_j + work + lost
    s.friction_loss_j = s.friction_loss_j + lost
    return math.isfinite(work)


@kernel
def led_piece(s: Any, left: float, aim: float) -> tuple[float, float, int]:
    """Return duration (s), end (rad) and ending of the next smooth piece at constant acceleration."""
    span, what, w, e = left, SPAN_ENDED, s.speed_rad_per_s, s.acceleration_rad_per_s2
    turns_back = -w / e if w * e < 0.0 else math.inf
    if turns_back < left:
        span, what = turns_back, AT_REST
    end = s.angle_rad + (w + 0.5 * e * span) * span
    if s.turning_sense * (end - aim) >= 0.0 and math.isfinite(aim):
        way = aim - s.angle_rad
        root = math.sqrt(max(w * w + 2.0 * e * way, 0.0))
        below = w + s.turning_sense * root
        span, what, end = min(span, 2.0 * way / below if below != 0.0 else 0.0), AT_ANGLE, aim
    return span, end, what


@kernel
def holding_torque(model: TurnedCrank, s: Any) -> float:
    """Return the friction torque (N m) at rest: all it can carry of the load, the drive holds what is left."""
    needed, coulomb = load_torque(model.mechanism, s.angle_rad, int(s.regime)), model.crank.friction.coulomb_nm
    return min(max(needed, -coulomb), coulomb)


@kernel
def lead(model: TurnedCrank, s: Any, start_s: float, speed: float, log: Array) -> tuple[Array, int, float]:
    """Carry the state through a step to a speed (rad/s); return events, and the friction torque (N m) at rest."""
    crank, count, done = model.crank, 0, 0.0
    e = (speed - s.speed_rad_per_s) / crank.step_s
    for _ in range(MOST_PIECES):
        s.acceleration_rad_per_s2 = e
        s.turning_sense = sign_of(s.speed_rad_per_s) if s.speed_rad_per_s != 0.0 else sign_of(e)
        boundary, aim = next_boundary(crank, s)
        span, end, what = led_piece(s, crank.step_s - done, aim)
        if not led_state(model, s, span, end):
            return log, WORK_UNKNOWN, 0.0
        done += span
        if what == SPAN_ENDED:
            s.speed_rad_per_s = speed
            return log, count, holding_torque(model, s) if s.turning_sense == 0.0 else 0.0
        if what == AT_ANGLE and boundary >= 0:
            log, count = apply_boundary(model, s, boundary, start_s + done, log, count)
        elif what == AT_REST:
            s.speed_rad_per_s, s.turning_sense = 0.0, sign_of(s.acceleration_rad_per_s2)
            turn_back(crank, s)
    return log, TOO_MANY, 0.0
