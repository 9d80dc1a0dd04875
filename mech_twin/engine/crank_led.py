"""A coupling step of a crank at prescribed speed: its angle is a parabola in time, and the cuts are roots of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mech_twin.engine.crank_motion import (
    AT_ANGLE,
    AT_REST,
    LONGEST_TURN_RAD,
    SPAN_ENDED,
    integrated_work,
)
from mech_twin.engine.crank_piece import (
    AT_REGIME,
    DRIVE_WORK,
    FRICTION_LOSS,
    LOAD_WORK,
    MOST_PIECES,
    SENSE,
    TOLERANCE,
    TOO_MANY,
    WORK_UNKNOWN,
    E,
    F,
    W,
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
    led_system,
    mechanism_load_work,
    within_a_turn,
)
from mech_twin.engine.sample_vectors import (
    Array,
)
from mech_twin.kernel import kernel

if TYPE_CHECKING:
    from mech_twin.engine.crank_step import TurnedCrank


@kernel
def led_state(model: TurnedCrank, s: Array, h: float, end: float) -> bool:
    """Carry the state on for h (s) to an angle (rad) at constant acceleration; return whether the work is known."""
    friction, w, e = model.crank.friction, s[W], s[E]
    lost = friction.coulomb_nm * abs(end - s[F])
    lost += friction.viscous_nms_per_rad * h * (w * w + w * e * h + e * e * h * h / 3.0)
    work, regime, after = 0.0, int(s[AT_REGIME]), w + e * h
    if h > 0.0:
        system = led_system(model.mechanism, within_a_turn(s[F]), w, e, regime)
        fastest = max(abs(w), abs(after), 1e-9)
        work = integrated_work(system, h, TOLERANCE * work_scale(model, s, h), LONGEST_TURN_RAD / fastest)
    if abs(end) >= LARGE_ANGLE:
        work += rounding_work(model, end, after, e, regime, (end - s[F]) - (w + 0.5 * e * h) * h)
    s[LOAD_WORK] = s[LOAD_WORK] + mechanism_load_work(model.mechanism, s[F], end, regime)
    s[F], s[W] = end, after
    s[DRIVE_WORK] = s[DRIVE_WORK] + work + lost
    s[FRICTION_LOSS] = s[FRICTION_LOSS] + lost
    return math.isfinite(work)


@kernel
def led_piece(s: Array, left: float, aim: float) -> tuple[float, float, int]:
    """Return duration (s), end (rad) and ending of the next smooth piece at constant acceleration."""
    span, what, w, e = left, SPAN_ENDED, s[W], s[E]
    turns_back = -w / e if w * e < 0.0 else math.inf
    if turns_back < left:
        span, what = turns_back, AT_REST
    end = s[F] + (w + 0.5 * e * span) * span
    if s[SENSE] * (end - aim) >= 0.0 and math.isfinite(aim):
        way = aim - s[F]
        root = math.sqrt(max(w * w + 2.0 * e * way, 0.0))
        below = w + s[SENSE] * root
        span, what, end = min(span, 2.0 * way / below if below != 0.0 else 0.0), AT_ANGLE, aim
    return span, end, what


@kernel
def holding_torque(model: TurnedCrank, s: Array) -> float:
    """Return the friction torque (N m) at rest: all it can carry of the load, the drive holds what is left."""
    needed, coulomb = load_torque(model.mechanism, s[F], int(s[AT_REGIME])), model.crank.friction.coulomb_nm
    return min(max(needed, -coulomb), coulomb)


@kernel
def lead(model: TurnedCrank, s: Array, start_s: float, speed: float, log: Array) -> tuple[Array, int, float]:
    """Carry the state through a step to a speed (rad/s); return events, and the friction torque (N m) at rest."""
    crank, count, done = model.crank, 0, 0.0
    e = (speed - s[W]) / crank.step_s
    for _ in range(MOST_PIECES):
        s[E] = e
        s[SENSE] = sign_of(s[W]) if s[W] != 0.0 else sign_of(e)
        boundary, aim = next_boundary(crank, s)
        span, end, what = led_piece(s, crank.step_s - done, aim)
        if not led_state(model, s, span, end):
            return log, WORK_UNKNOWN, 0.0
        done += span
        if what == SPAN_ENDED:
            s[W] = speed
            return log, count, holding_torque(model, s) if s[SENSE] == 0.0 else 0.0
        if what == AT_ANGLE and boundary >= 0:
            log, count = apply_boundary(model, s, boundary, start_s + done, log, count)
        elif what == AT_REST:
            s[W], s[SENSE] = 0.0, sign_of(s[E])
            turn_back(crank, s)
    return log, TOO_MANY, 0.0
