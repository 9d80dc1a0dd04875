# SPDX-License-Identifier: Apache-2.0
"""State of a crank within a coupling step, and the boundaries between its smooth pieces, as kernels."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from mech_twin.engine.compiled_steps import log_event
from mech_twin.engine.crank_motion import MOST_STEPS
from mech_twin.engine.crank_state import (
    TURN,
    Crank,
    mechanism_load_speed,
    mechanism_state,
)
from mech_twin.engine.records import record_of
from mech_twin.engine.sample_vectors import (
    EVENT_WIDTH,
    SIDES,
    Array,
)
from mech_twin.kernel import kernel

if TYPE_CHECKING:
    from mech_twin.engine.crank_step import TurnedCrank


MOST_PIECES = 10_000  # of one coupling step
TOLERANCE = 1e-12  # of a step: angle in rad, speed and works over their size
HELD_SHARE = 0.01  # of the energy held and moved: no error of work is asked to be below its rounding
KINDS = ("started", "stopped", "stalled", "reversed")  # then those of the boundaries
STARTED, STOPPED, STALLED, REVERSED = range(4)
CRANK_CONTACT, LOAD_CONTACT = 0, 1
TOO_MANY, WORK_UNKNOWN, UNSTEADY, NO_TORQUE, TOO_LONG = -1, -2, -3, -4, -5
FAILURES = (
    f"more than {MOST_PIECES} changes of regime; expected fewer: shorten coupling.step_s, or soften friction and load",
    "the work of a prescribed drive (drive.kind) has no integral: the mechanism does not turn through",
    "no integration step of 1e-13 s or more is small enough for the crank; friction, load or speed change too fast",
    "the crank torque is not finite",
    f"coupling.step_s = {{step_s:g}} s takes more than {MOST_STEPS} steps of integration, "
    "loads are large for the crank's inertia; try {shorter_s:g}",
)


def failures_at(step_s: float) -> tuple[str, ...]:
    """Return what each failure is told by, at a coupling step (s)."""
    return tuple(text.format(step_s=step_s, shorter_s=0.1 * step_s) for text in FAILURES)


class CrankPoint(NamedTuple):
    """State of the crank within a step; fields of the energy balance are sums since the start of the run."""

    angle_rad: float
    speed_rad_per_s: float
    acceleration_rad_per_s2: float
    turning_sense: float  # +1, -1; 0 at rest
    drive_work_j: float
    gear_loss_j: float
    friction_loss_j: float
    load_work_j: float
    regime: float
    stalled: float  # 1 where a supply that is on does not turn the crank
    load_share: float  # of the load that acts
    turned_back_rad: float  # angle at which the crank last turned back under a load that only resists


POINT = record_of(CrankPoint)


@kernel
def sign_of(value: float) -> float:
    """Return the sign of a number, 0 of 0."""
    return 0.0 if value == 0.0 else math.copysign(1.0, value)


@kernel
def load_torque(mechanism: Any, f: float, regime: int) -> float:
    """Return the torque (N m) that holds the mechanism at rest."""
    _, _, torque, _, _ = mechanism_state(mechanism, f, 0.0, 0.0, regime)
    return float(torque)


@kernel
def turned_over(s: Any) -> float:
    """Return the work (J) turned over, at least 1."""
    return float(max(1.0, abs(s.drive_work_j), abs(s.load_work_j), s.friction_loss_j))


@kernel
def work_scale(model: TurnedCrank, s: Any, h: float) -> float:
    """Return the size (J) an error of work is measured by: what was turned over, or is held and moved in ``h`` (s)."""
    friction, w, e = model.crank.friction, s.speed_rad_per_s, s.acceleration_rad_per_s2
    _, _, torque, energy, _ = mechanism_state(model.mechanism, s.angle_rad, w, e, int(s.regime))
    resisting = friction.coulomb_nm + friction.viscous_nms_per_rad * abs(w)
    moved = (abs(torque) + resisting) * (abs(w) + abs(e) * h) * h
    return max(turned_over(s), HELD_SHARE * float(abs(energy) + moved))


@kernel
def rounding_work(model: TurnedCrank, f: float, w: float, e: float, regime: int, rounded: float) -> float:
    """Return the work (J) on the way ``rounded`` (rad) that a large angle f has more than its step has integrated.

    Equal steps round alike, so it adds up over hours.
    """
    _, _, torque, _, _ = mechanism_state(model.mechanism, f, w, e, regime)
    return float(torque * rounded)


@kernel
def next_boundary(crank: Crank, s: Any) -> tuple[int, float]:
    """Return the next boundary in the sense of turning (-1: none), and its angle in this turn (rad)."""
    best, aim = -1, math.copysign(math.inf, s.turning_sense)
    for i in range(len(crank.boundaries)):
        angle, sign = crank.boundaries[i, 0], crank.boundaries[i, 1]
        if crank.boundaries[i, 2] != s.regime or sign != s.turning_sense:
            continue
        if math.isnan(angle):
            angle = s.turned_back_rad
        else:
            turns = math.floor(sign * (s.angle_rad - angle) / TURN) + 1.0
            angle = angle + sign * turns * TURN
        if best < 0 or sign * (angle - aim) < 0.0:
            best, aim = i, angle
    return best, aim


@kernel
def period_of(crank: Crank, f: float, sense: float) -> float:
    """Return the turn of a crank angle, counted from 0 in the sense of turning."""
    return max(0.0, float(math.floor((f - crank.start_rad) / TURN * (1.0 if sense >= 0.0 else -1.0))))


@kernel
def log_sides(log: Array, count: int, f: float, w: float, before_nm: float, after_nm: float) -> None:
    """Write angle, speed and torque of the crank on either side of an event."""
    log[count, SIDES] = 1.0
    for side in range(2):
        log[count, EVENT_WIDTH + 3 * side], log[count, EVENT_WIDTH + 3 * side + 1] = f, w
    log[count, EVENT_WIDTH + 2], log[count, EVENT_WIDTH + 5] = before_nm, after_nm


@kernel
def apply_boundary(
    model: TurnedCrank, s: Any, boundary: int, time_s: float, log: Array, count: int
) -> tuple[Array, int]:
    """Change the regime, and log the event with the speed of the loaded point."""
    crank, mechanism, f, w, e = model.crank, model.mechanism, s.angle_rad, s.speed_rad_per_s, s.acceleration_rad_per_s2
    before, after = int(s.regime), int(crank.boundaries[boundary, 3])
    speed = mechanism_load_speed(mechanism, f, w)
    kind, period = int(crank.boundaries[boundary, 4]), period_of(crank, f, s.turning_sense)
    log = log_event(log, count, time_s, kind, LOAD_CONTACT, speed, speed, 0.0, period)
    torque = mechanism_state(mechanism, f, w, e, before)[2]
    log_sides(log, count, f, w, torque, mechanism_state(mechanism, f, w, e, after)[2])
    s.regime = after
    return log, count + 1


@kernel
def turn_back(crank: Crank, s: Any) -> None:
    """Take the crank out of a load that only resists where it sets off against its sense."""
    for i in range(len(crank.resisting)):
        if crank.resisting[i, 0] == s.regime and s.turning_sense != 0.0 and s.turning_sense != crank.resisting[i, 1]:
            s.regime, s.turned_back_rad = crank.resisting[i, 2], s.angle_rad
            return
