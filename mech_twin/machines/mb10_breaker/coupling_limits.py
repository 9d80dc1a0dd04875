# SPDX-License-Identifier: Apache-2.0
"""How far the body's own motion may lie from the one the linkage led it to, by the step and by what the body weighs.

Over a coupling step h the body takes the linkage's moment as a line between knots.  The moment of a linkage that turns
at u (the drive's speed, or what the weight of its links can turn it to) on a body at rest is M = -M12,q u^2, so its
second derivative in time is at most M2 = max |M12,qqq| u^4, and what the line misses turns the body of inertia J by

    rate   M2 h^3/(12 J)          angle   M2 h^4/(24 J)          share of the energy held   2 rate/u

(trapezoid rule; the momentum M12 u over the energy M11 u^2/2, both of the flywheel).  Another body or step has other
differences, and so other limits; beyond them it is not the coupling that is wrong.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.machines.mb10_breaker.turn_curves import turn_heights, turn_masses
from mech_twin.roles import RESIDUALS

POSITIONS = 360
ALLOWED = 5.0  # times what the line misses: impacts and the spring add to it
ANGLE_RAD, RATE_RAD_PER_S, DEFECT = (  # allowed to a heavy body at 1 ms
    RESIDUALS[name].least_limit for name in ("angle_difference_rad", "rate_difference_rad_per_s", "coupling_defect")
)
SMALL_PART = 0.2  # of a limit, for one piece of a flight: a blow may throw harder than the preload presses back
LARGEST_MISS_RAD_PER_S = 0.01  # in a step; a blow throws a light body back at some 5 rad/s


class CouplingLimits(NamedTuple):
    """Limits of the differences between led and own motion, and the rate (rad/s) that a coupling step costs."""

    angle_rad: float
    rate_rad_per_s: float
    coupling_defect: float
    missed_rad_per_s: float


def moment_curvature(b: Breaker, speed: float) -> float:
    """Return the largest second derivative in time (N m/s^2) of the linkage's moment, its crank at a speed (rad/s)."""
    slopes = np.fft.rfft(turn_masses(b, POSITIONS).m12_q)
    order = np.arange(len(slopes))
    return float(np.abs(np.fft.irfft(-(order**2) * slopes, POSITIONS)).max()) * speed**4


def fastest_rad_per_s(b: Breaker, speed: float) -> float:
    """Return a speed of the drive (rad/s), or the one to which the weight of the links turns the crank if that is more.

    Half of M11 u^2 is at most what the weights lose between the highest and the lowest of their positions.
    """
    weights = b.gravity_m_per_s2 * turn_heights(b, POSITIONS)
    lightest = float(np.min(turn_masses(b, POSITIONS).m11))
    return max(speed, math.sqrt(2.0 * float(weights.max() - weights.min()) / lightest))


def longest_step_s(b: Breaker, speed: float) -> float:
    """Return the coupling step (s) in which the line costs the body as much of its rate as is allowed.

    ``speed`` is that of the drive (rad/s); the weight of the links may turn the crank faster.
    """
    speed = fastest_rad_per_s(b, speed)
    most = LARGEST_MISS_RAD_PER_S * 12.0 * b.body_inertia_kg_m2
    return math.cbrt(most / max(moment_curvature(b, speed), 1e-300))


def longest_swing_step_s(b: Breaker, speed: float) -> float:
    """Return the coupling step (s) in which the swing of a sprung body keeps the line of the moment near its curve.

    Thrown off its collar the body is pressed back with a = c a_0 l/(J + m) and swings at k = l sqrt(c/(J + m)), m what
    the linkage weighs about its pivot, M22 - M12^2/M11 - J: its moment m a has a second derivative of at most m a k^2,
    which costs the body's rate m a k^2 h^3/(12 J).  Infinite where that is a small part of what the limits allow to the
    turning of the linkage at a speed of the drive (rad/s), which grows alike.
    """
    m = turn_masses(b, POSITIONS)
    both = float(np.max(m.m22 - m.m12 * m.m12 / m.m11))
    pressed = b.spring_rate_n_per_m * abs(b.preload_m) * b.spring_arm_m / both
    curvature = (both - b.body_inertia_kg_m2) * pressed * b.spring_rate_n_per_m * b.spring_arm_m**2 / both
    if curvature <= SMALL_PART * ALLOWED * moment_curvature(b, fastest_rad_per_s(b, speed)):
        return math.inf
    return math.cbrt(SMALL_PART * RATE_RAD_PER_S * 12.0 * b.body_inertia_kg_m2 / max(curvature, 1e-300))


def coupling_limits(b: Breaker, speed: float, step_s: float) -> CouplingLimits:
    """Return the limits of a coupling step (s), the crank turning at a speed (rad/s)."""
    speed = fastest_rad_per_s(b, speed)
    missed = moment_curvature(b, speed) * step_s**3 / (12.0 * b.body_inertia_kg_m2)
    return CouplingLimits(
        max(ANGLE_RAD, ALLOWED * 0.5 * missed * step_s),
        max(RATE_RAD_PER_S, ALLOWED * missed),
        max(DEFECT * max(1.0, (step_s / 1e-3) ** 2), ALLOWED * 2.0 * missed / speed),
        missed,
    )
