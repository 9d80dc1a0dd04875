# SPDX-License-Identifier: Apache-2.0
"""Constants of the breaker's motion, derived from its parameters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mech_twin.capabilities.root import root_between
from mech_twin.machines.mb10_breaker.dynamics import Breaker, turn_rocker_rates
from mech_twin.parts.four_bar import FourBar, Link, coefficients, link_angles, position
from mech_twin.parts.rod_waves.parameters import WaveTool, wave_grid

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
            found = root_between(lambda q: coefficients(position(bar, q)).g3, angles[i], angles[i + 1])
            if values[i] > values[i + 1]:
                striking = found
            else:
                retreating = found
    return striking, retreating


def crank_coulomb_nm(p: BreakerParameters) -> float:
    """Return the Coulomb friction of the crank's bearing (N m), at least a tiny value where the gear alone can hold it.

    A gear with losses holds a crank whose load at rest lies between eta tau and tau/eta; this is computed together
    with the friction of the bearing.
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
