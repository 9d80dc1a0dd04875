# SPDX-License-Identifier: Apache-2.0
"""Constants of the breaker's motion, derived from its parameters.

How far the body's own motion may lie from the one the linkage led it to, by the step and by what the body weighs.

Over a coupling step h the body takes the linkage's moment as a line between knots.  The moment of a linkage that turns
at u (the drive's speed, or what the weight of its links can turn it to) on a body at rest is M = -M12,q u^2, so its
second derivative in time is at most M2 = max |M12,qqq| u^4, and what the line misses turns the body of inertia J by

    rate   M2 h^3/(12 J)          angle   M2 h^4/(24 J)          share of the energy held   2 rate/u

(trapezoid rule; the momentum M12 u over the energy M11 u^2/2, both of the flywheel).  Another body or step has other
differences, and so other limits; beyond them it is not the coupling that is wrong.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import brentq

from mech_twin.machines.mb10_breaker.dynamics import Breaker, turn_heights, turn_masses, turn_rocker_rates
from mech_twin.parts.four_bar import FourBar, Link, coefficients, link_angles, position
from mech_twin.parts.rod_waves.parameters import WaveTool, wave_grid
from mech_twin.roles import RESIDUALS

if TYPE_CHECKING:
    from mech_twin.machines.mb10_breaker.parameters import BreakerParameters

GEAR_GRIP = 1e-12  # of the rated torque: least friction of a crank that its gear may hold
NO_WAVES = wave_grid(WaveTool(), 0.0)  # of a rigid tool: not looked at


def extremes(bar: FourBar) -> tuple[float, float]:
    """Return the crank angles (rad, 0 to 2 pi) of the rocker's striking extreme and of its other extreme.

    The rocker strikes counter-clockwise: its coefficient falls through zero at the first and rises at the second.
    """
    count = 720
    angles = [2.0 * math.pi * i / count for i in range(count + 1)]
    values = turn_rocker_rates(bar, count).tolist()
    striking = retreating = math.nan
    for i in range(count):
        if values[i] * values[i + 1] <= 0.0 and values[i] != values[i + 1]:
            found = float(
                brentq(lambda q: coefficients(position(bar, q)).g3, angles[i], angles[i + 1], xtol=1e-15, rtol=1e-15)
            )
            if values[i] > values[i + 1]:
                striking = found
            else:
                retreating = found
    return striking, retreating


def crank_coulomb_nm(p: BreakerParameters) -> float:
    """Return the Coulomb friction of the crank's bearing (N m): next to none where the gear alone may hold the weight.

    A gear with losses holds a crank whose load at rest lies between eta tau and tau/eta; that is followed together with
    the friction of the bearing.
    """
    if p.friction.coulomb_nm > 0.0 or p.gravity_m_per_s2 == 0.0 or p.gear.efficiency == 1.0:
        return p.friction.coulomb_nm
    return GEAR_GRIP * p.gear.ratio * p.motor.rated_power_w / (p.motor.rated_speed_rpm * math.pi / 30.0)


def breaker(p: BreakerParameters) -> Breaker:
    """Return the constants of the coupled motion."""
    link, bar = p.linkage, p.linkage.four_bar
    striking, retreating = extremes(bar)
    at = position(bar, striking)
    rotor, i = p.motor.rotor_inertia_kg_m2, p.gear.ratio
    on_frame = p.drive_mount == "frame"
    lever = (p.body.tool_radius_m - link.striker_arm_m) / link.ground_m
    # two lines touch both circles; the striker's angle says which is meant
    towards = link_angles(at)[1] + math.radians(link.striker_angle_deg) + 0.5 * math.pi
    along = math.copysign(math.sqrt(1.0 - lever * lever), math.cos(towards))
    own = link.rocker_mass_kg * (link.rocker_centroid_along_m**2 + link.rocker_centroid_across_m**2)
    k = p.body.spring_arm_m * math.sqrt(p.body.spring_rate_n_per_m / p.body.inertia_kg_m2)
    waves = p.tool.model == "wave"
    wave = wave_grid(p.tool.wave, p.tool.wall_force_n) if waves else NO_WAVES
    return Breaker(
        bar=bar,
        crank=Link(
            link.crank_mass_kg, link.crank_inertia_kg_m2, link.crank_centroid_along_m, link.crank_centroid_across_m
        ),
        coupler=Link(
            link.coupler_mass_kg,
            link.coupler_inertia_kg_m2,
            link.coupler_centroid_along_m,
            link.coupler_centroid_across_m,
        ),
        rocker=Link(
            link.rocker_mass_kg,
            link.rocker_inertia_kg_m2 - own,
            link.rocker_centroid_along_m,
            link.rocker_centroid_across_m,
        ),
        rotor_11_kg_m2=i * i * rotor,
        rotor_12_kg_m2=-i * i * rotor if on_frame else i * rotor,
        rotor_22_kg_m2=i * i * rotor if on_frame else rotor,
        frame_drive=1.0 if on_frame else 0.0,
        ratio=i,
        efficiency=p.gear.efficiency,
        body_inertia_kg_m2=p.body.inertia_kg_m2,
        spring_rate_n_per_m=p.body.spring_rate_n_per_m,
        spring_arm_m=p.body.spring_arm_m,
        preload_m=p.body.preload_deflection_m,
        body_damping_nms_per_rad=2.0 * p.body.damping_ratio * k * p.body.inertia_kg_m2
        + p.body.friction.viscous_nms_per_rad,
        collar_restitution=p.body.restitution,
        tool_radius_m=p.body.tool_radius_m,
        striker_arm_m=link.striker_arm_m,
        tool_mass_kg=wave.tool_mass_kg if waves else p.tool.mass_kg,
        tool_restitution=1.0 if waves else p.tool.restitution,  # of a wave: not that of the blow
        overtravel_m=p.tool.overtravel_m,
        wall_force_n=p.tool.wall_force_n,
        n_x=along,
        n_y=lever,
        striking_crank_rad=striking,
        retreating_crank_rad=retreating,
        extreme_x=at.v_x / link.rocker_m,
        extreme_y=at.v_y / link.rocker_m,
        gravity_m_per_s2=p.gravity_m_per_s2,
        held=p.excitation.kind == "approximated",
        crank_viscous_nms_per_rad=p.friction.viscous_nms_per_rad,
        crank_coulomb_nm=crank_coulomb_nm(p),
        body_coulomb_nm=p.body.friction.coulomb_nm,
        waves=waves,
        wave=wave,
    )


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
