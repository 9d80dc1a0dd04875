# SPDX-License-Identifier: Apache-2.0
r"""Motion of a linkage with one freedom between two events: its crank turned at a prescribed speed, or by a motor.

::

    motor --[ gear i, eta ]--> shaft inertia J --> crank: angle f, speed w, friction c, v --> I_pr(f), M_pr(f)

    (I_pr + J) w' + w^2/2 dI_pr/df = M_pr + gear(i M) - c sign w - v w
    M(t, w) = M_n + dM/dw i (w - w_n) + dM/dt (t - t_n),  kept within the breakdown torque

The motor's torque goes on within a step along its own slope at t_n, the directional derivative of the motor: the
coupling is second order, and stable however small the inertia behind a steep working branch is.  A piece of motion ends
where the step does, where the crank comes to rest, or where it reaches the next angle at which the load changes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.integration import (
    SHORTEST_S,
    Workspace,
    controlled_step,
    finish_step,
    interpolate,
    method_of,
    prepare_dense_output,
    start_step,
    take_step,
)
from mech_twin.kernel import borrowing_kernel, inline_kernel, kernel
from mech_twin.parts.friction import sliding_torque
from mech_twin.parts.gear import gear_split

Array = NDArray[np.float64]
SPAN_ENDED, AT_REST, AT_ANGLE, NOT_INTEGRATED, TOO_MANY_STEPS = 0, 1, 2, 3, 4
MOST_STEPS = 20_000  # of one piece: a fraction of a second
LONGEST_TURN_RAD = 0.2  # of the crank in one step of the integration, whatever its estimated error
DRIVE_POWER = 0  # the one rate of a crank at a prescribed speed


class ShaftState(NamedTuple):
    """What is integrated: the crank's angle and speed, work on the mechanism, losses of gear and friction."""

    angle_rad: float
    speed_rad_per_s: float
    drive_work_j: float
    gear_loss_j: float
    friction_loss_j: float


STATE_SIZE = len(ShaftState._fields)


@inline_kernel
def shaft_state(y: Array) -> ShaftState:
    """Return the numbers of a state (5,), or of its rates, by name."""
    return ShaftState(y[0], y[1], y[2], y[3], y[4])


@inline_kernel
def fill_shaft(y: Array, state: ShaftState) -> None:
    """Put a state, or its rates, into an array (5,)."""
    for i in range(STATE_SIZE):
        y[i] = state[i]


class ShaftDrive(NamedTuple):
    """What turns the crank during one coupling step; t = 0 at its start.

    ``torque_nm`` M_n, ``speed_slope`` dM/d(rotor speed) (N m s/rad), ``time_slope`` dM/dt (N m/s), ``speed`` w_n of the
    crank (rad/s), ``torque_limit_nm`` the largest motor torque; ``direction`` the sense of turning (+1, -1).
    """

    shaft_inertia_kg_m2: float
    ratio: float
    efficiency: float
    torque_nm: float
    speed_slope: float
    time_slope: float
    speed: float
    torque_limit_nm: float
    coulomb_nm: float
    viscous_nms_per_rad: float
    direction: float


class ShaftTorques(NamedTuple):
    """Torques on the crank shaft (N m): from the gear, and from friction; power lost in the gear (W)."""

    drive_nm: float
    friction_nm: float
    gear_loss_w: float


@inline_kernel
def line_torque(drive: ShaftDrive, t: float, w: float) -> float:
    """Return the motor torque (N m) at a time of the step (s) and a crank speed (rad/s)."""
    torque = drive.torque_nm + drive.speed_slope * drive.ratio * (w - drive.speed) + drive.time_slope * t
    return min(max(torque, -drive.torque_limit_nm), drive.torque_limit_nm)


@inline_kernel
def shaft_torques(drive: ShaftDrive, t: float, w: float) -> ShaftTorques:
    """Return what drives and what brakes a turning crank."""
    mean, loss = gear_split(drive.ratio, drive.efficiency, line_torque(drive, t, w))
    friction = sliding_torque(drive.coulomb_nm, drive.viscous_nms_per_rad, w, drive.direction)
    given = mean - drive.direction * loss
    return ShaftTorques(given, friction, drive.ratio * line_torque(drive, t, w) * w - given * w)


@inline_kernel
def crank_rates(drive: ShaftDrive, t: float, y: Array, inertia: float, slope: float, moment: float, out: Array) -> None:
    """Fill the rates of angle, speed, work on the mechanism, gear loss and friction loss.

    Parameters
    ----------
    inertia, slope, moment : float
        I_pr (kg m2), dI_pr/df (kg m2/rad) and M_pr (N m) of the mechanism at the angle.
    """
    w = shaft_state(y).speed_rad_per_s
    shaft = shaft_torques(drive, t, w)
    e = (shaft.drive_nm + shaft.friction_nm + moment - 0.5 * w * w * slope) / (inertia + drive.shaft_inertia_kg_m2)
    power = (shaft.drive_nm - drive.shaft_inertia_kg_m2 * e) * w
    fill_shaft(out, ShaftState(w, e, power, shaft.gear_loss_w, -shaft.friction_nm * w))


@borrowing_kernel
def _good_step(
    system: Any, t: float, y: Array, wanted: float, tolerance: Array, work: Workspace
) -> tuple[float, float]:
    """Take a step within the tolerances from where `start_step` has been; return it and the next to try (s).

    Where none is short enough (a load that sets in with a vertical tangent) the shortest one is taken: in it the load
    does no work worth counting.
    """
    h, following = 0.0, wanted
    if wanted > SHORTEST_S:
        h, following = controlled_step(system, t, y, wanted, tolerance, work)
    if h == 0.0:
        h, following = min(wanted, SHORTEST_S), 10.0 * SHORTEST_S
        take_step(system, t, y, h, work)
        finish_step(system, t, h, work)
    return h, following


@kernel
def _first_share(
    system: Any, y: Array, h: float, direction: float, aim: float, what: int, high: float, work: Workspace
) -> float:
    """Return the share of a finished step at which rest or the angle is reached, by bisection of its dense output."""
    out, low = np.empty_like(y), 0.0
    for _ in range(55):
        middle = 0.5 * (low + high)
        interpolate(system, y, h, middle, work, out)
        now = shaft_state(out)
        left = now.speed_rad_per_s * direction if what == AT_REST else (aim - now.angle_rad) * direction
        if left > 0.0:
            low = middle
        else:
            high = middle
    return high


@borrowing_kernel
def _land(system: Any, t: float, y: Array, h: float, aim: float, what: int, work: Workspace) -> float:
    """Return the length (s) of the step that ends at rest or at the angle, and leave ``work.end`` there (Newton)."""
    last = len(method_of(system).weights)
    for _ in range(4):
        take_step(system, t, y, h, work)
        finish_step(system, t, h, work)
        end, rates = shaft_state(work.end), shaft_state(work.rates[last])
        miss = end.speed_rad_per_s if what == AT_REST else end.angle_rad - aim
        rate = rates.speed_rad_per_s if what == AT_REST else rates.angle_rad
        if miss == 0.0 or rate == 0.0 or not h - miss / rate >= 0.0:
            break
        h -= miss / rate
    take_step(system, t, y, h, work)
    finish_step(system, t, h, work)
    return h


@kernel
def turn_crank(
    system: Any, t: float, y: Array, span: float, direction: float, aim: float, tolerance: Array
) -> tuple[float, int, float]:
    """Advance ``y`` in place; return time (s), what ended the motion, and the crank's acceleration there (rad/s2).

    Parameters
    ----------
    system : NamedTuple
        Constants whose rates are `crank_rates`.
    t, span : float
        Time of the coupling step at which the motion starts, and its longest duration (s).
    y : ndarray
        The numbers of a `ShaftState`, shape (5,).
    direction : float
        Sense of turning (+1, -1); the motion ends at rest.
    aim : float
        Angle (rad) at which it ends, infinite where there is none.
    tolerance : ndarray
        Largest error of a step, shape (5,).
    """
    tableau = method_of(system)
    rows, last = len(tableau.nodes), len(tableau.weights)
    work = Workspace(np.empty((rows, STATE_SIZE)), np.empty(STATE_SIZE), np.empty(STATE_SIZE))
    done, wanted, e = 0.0, span, 0.0
    for _ in range(MOST_STEPS):
        start_step(system, t + done, y, work)
        h, wanted = _good_step(system, t + done, y, min(wanted, span - done), tolerance, work)
        end = shaft_state(work.end)
        if not np.isfinite(end.speed_rad_per_s):
            return done, NOT_INTEGRATED, e
        rests = direction * end.speed_rad_per_s < 0.0
        passes = direction * (end.angle_rad - aim) >= 0.0
        if rests or passes:
            prepare_dense_output(system, t + done, y, h, work)
            share, what = 1.0, SPAN_ENDED
            if rests:
                share, what = _first_share(system, y, h, direction, aim, AT_REST, 1.0, work), AT_REST
                interpolate(system, y, h, share, work, work.stage)
                passes = direction * (shaft_state(work.stage).angle_rad - aim) >= 0.0
            if passes:
                share, what = _first_share(system, y, h, direction, aim, AT_ANGLE, share, work), AT_ANGLE
            h = _land(system, t + done, y, share * h, aim, what, work)
            end = shaft_state(work.end)
            angle, speed = (end.angle_rad, 0.0) if what == AT_REST else (aim, end.speed_rad_per_s)
            fill_shaft(y, ShaftState(angle, speed, end.drive_work_j, end.gear_loss_j, end.friction_loss_j))
            return min(done + h, span), what, shaft_state(work.rates[last]).speed_rad_per_s
        y[:] = work.end
        e = shaft_state(work.rates[last]).speed_rad_per_s
        done += h
        if span - done <= 1e-15 * span:
            return span, SPAN_ENDED, e
    return done, TOO_MANY_STEPS, e


@kernel
def integrated_work(system: Any, span: float, tolerance: float, longest: float) -> float:
    """Return the integral (J) of a power over ``span`` (s) from time 0, or nan; its one rate is the power (W).

    No step is longer than ``longest`` (s): the estimate of a long step's error may vanish by chance.
    """
    rows = len(method_of(system).nodes)
    work, y, limit = Workspace(np.empty((rows, 1)), np.empty(1), np.empty(1)), np.zeros(1), np.full(1, tolerance)
    done, wanted = 0.0, span
    for _ in range(MOST_STEPS):
        if span - done <= 1e-15 * span:
            return float(y[DRIVE_POWER])
        start_step(system, done, y, work)
        h, wanted = _good_step(system, done, y, min(wanted, span - done, longest), limit, work)
        y[:] = work.end
        done += h
    return math.nan
