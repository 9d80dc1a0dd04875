# SPDX-License-Identifier: Apache-2.0
"""The breaker's state by name (integrated variables, memory, kinds of events), and the constants of its motion."""

from __future__ import annotations

import math
from collections import namedtuple
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.addresses import record_at, record_of
from mech_twin.kernels.kernel import borrowing_kernel
from mech_twin.machines.drives import root_between
from mech_twin.machines.mb10_breaker.dynamics import Breaker, turn_rocker_rates
from mech_twin.parts.four_bar import FourBar, Link, coefficients, link_angles, position
from mech_twin.parts.rod_waves.parameters import WaveTool, wave_grid
from mech_twin.samples import Coordinate

if TYPE_CHECKING:
    from mech_twin.machines.mb10_breaker.parameters import BreakerParameters

GEAR_GRIP = 1e-12  # of the rated torque: least friction of a crank that its gear may hold
NO_WAVES = wave_grid(WaveTool(), 0.0)  # of a rigid tool: not looked at


EventKinds = namedtuple(
    "EventKinds",
    "blow missed touchdown settled lift_off off_collar catch_up push_begins pushing released stalled crank_stopped "
    "crank_started crank_reversed body_stopped body_started body_reversed gear_stopped gear_started gear_reversed",
)
Laws = namedtuple("Laws", "collar wall tool crank pivot gear")
KINDS = EventKinds._fields
EVENT, LAW = EventKinds(*range(len(KINDS))), Laws(*range(len(Laws._fields)))  # their numbers, places in the regimes
# coordinates and velocities of the motion, and its quadratures
CRANK, BODY, TOOL, CRANK_RATE, BODY_RATE, TOOL_RATE = range(6)
DRIVE_WORK, DAMPING_LOSS, ANGULAR_IMPULSE, WALL_WORK = range(6, 10)
FREEDOMS, LAWS = 3, len(LAW)


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
    sizes = ("mass_kg", "inertia_kg_m2", "centroid_along_m", "centroid_across_m")
    crank, coupler, rocker = (
        Link(*(getattr(link, f"{name}_{size}") for size in sizes)) for name in ("crank", "coupler", "rocker")
    )
    own = rocker.mass_kg * (rocker.along_m**2 + rocker.across_m**2)
    k = p.body.spring_arm_m * math.sqrt(p.body.spring_rate_n_per_m / p.body.inertia_kg_m2)
    waves = p.tool.model == "wave"
    wave = wave_grid(p.tool.wave, p.tool.wall_force_n) if waves else NO_WAVES
    return Breaker(
        bar=bar,
        crank=crank,
        coupler=coupler,
        rocker=rocker._replace(inertia_kg_m2=rocker.inertia_kg_m2 - own),
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


class BreakerState(NamedTuple):
    """Integrated variables: crank, body and tool, and works and angular impulse since the start of the step."""

    crank_rad: float  # against the body
    body_rad: float
    tool_m: float  # into the wall
    crank_rad_per_s: float
    body_rad_per_s: float
    tool_m_per_s: float
    drive_work_j: float
    damping_loss_j: float
    angular_impulse_nms: float  # on everything
    wall_work_j: float


class BreakerMemory(NamedTuple):
    """State of the linkage besides its joints; fields of the balances are sums since the start."""

    turns: float = 0.0
    cycle: float = 0.0
    pass_done: float = 0.0  # 1 from the blow (or the missed one) to the rocker's return
    drive_work_j: float = 0.0
    damping_loss_j: float = 0.0
    angular_impulse_nms: float = 0.0
    blow_loss_j: float = 0.0
    collar_loss_j: float = 0.0
    reseating_loss_j: float = 0.0  # what a tool that is still moving when it is reseated takes with it
    wall_work_j: float = 0.0
    coupling_defect_j: float = 0.0  # by the angle of a body that somebody else moves in place of the one it was led to
    parameter_work_j: float = 0.0  # by changes of spring, preload and gravity while running
    impact_impulse_nms: float = 0.0
    coupling_defect_nms: float = 0.0
    energy_j: float = 0.0
    energy_error_j: float = 0.0  # sum over the steps of what each left open: does not grow with the sums above
    momentum_error_nms: float = 0.0
    tool_regime: float = 0.0
    tool_travel_m: float = 0.0
    tool_speed_m_per_s: float = 0.0
    tool_force_n: float = 0.0  # of the striker
    feed_per_blow_m: float = 0.0  # the tool's travel in the last pass, taken when it was reseated
    stalled: float = 0.0  # 1 from a stall to the next extreme of the rocker
    crank_sense: float = 0.0  # of sliding in the crank's bearing, +1 or -1, 0 where friction holds it; so for the body
    body_sense: float = 0.0
    crank_friction_nm: float = 0.0  # Coulomb friction as this step ended
    body_friction_nm: float = 0.0


class EventSide(NamedTuple):
    """Coordinates before or after an event, in the order of the linkage's events."""

    crank: Coordinate
    body: Coordinate
    tool: Coordinate
    crank_bearing: Coordinate
    body_pivot: Coordinate


# records, not plain structures: their fields are attributes in plain Python too
STATE = record_of(BreakerState._fields)
STATES = len(BreakerState._fields)
MEMORY = record_of(BreakerMemory._fields)


@borrowing_kernel
def named(y: NDArray[np.float64]) -> Any:
    """Return the numbers of a state (10,) by name: a record that shares them."""
    return record_at(y, 0, STATE)
