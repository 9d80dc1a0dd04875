"""The breaker between two events as a system of the engine: equation of motion, method, signals of its events."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.events import UNKNOWN, signals_of
from mech_twin.engine.integration import Workspace, rates_of
from mech_twin.engine.tableaus import COOPER_VERNER_8
from mech_twin.kernel import kernel
from mech_twin.machines.mb10_breaker.bearing_friction import (
    BearingTorques,
    Instant,
    bearing_torques,
    rubs,
    senses_at,
)
from mech_twin.machines.mb10_breaker.dynamics import (
    PHI,
    STATES,
    TOOL,
    TOOL_SPEED,
    Accelerations,
    Breaker,
    P,
    Q,
    Senses,
    U,
    contact_accelerations,
    crank_torque,
    derivatives,
    masses_at,
    striker,
)
from mech_twin.parts.gear import gear_torque

# signals, each falling through zero at its event: striker from tool, body from collar, collar's moment, way to the
# rocker's next dead centre, speed of the tool, force of the striker on it, what more the wall can hold, crank speed;
# of crank and body their speeds in the sense in which they slide, and what more their friction can hold at rest
GAP, LIFT, COLLAR, DEAD_CENTRE, TOOL_MOTION, THRUST, WALL, CRANK_MOTION = range(8)
CRANK_TURN, CRANK_GRIP, BODY_TURN, BODY_GRIP = range(8, 12)
SINGLE_STEP_RAD = 0.04  # longest turn of the crank in one substep: truncation below 1e-13
LONGEST_SUBSTEP_S = 5e-4
# while the tool is pushed: a stiff wall stops the crank within less, and the moment on a free body is a line between
# knots of this distance
PUSHING_SUBSTEP_S = 1e-4
ADHESION_N = 1e-9  # a striker that touches the tool without force has not left it


class Motion(NamedTuple):
    """The breaker under a motor torque that is a line in the time since the start of the coupling step."""

    breaker: Breaker
    torque_nm: float
    slope_nm_per_s: float
    compensation_nm: float  # on the crank: makes good what the extrapolation of the step before missed
    rests: bool
    tool: int
    dead_centre_rad: float  # crank angle of the rocker's next extreme
    senses: Senses


@kernel
def drive_torque(system: Motion, t: float, u: float, p: float) -> float:
    """Return the torque on the crank behind the gear (N m); a shaft that stands is taken to turn as the crank will."""
    b, motor = system.breaker, system.torque_nm + system.slope_nm_per_s * t
    if b.crank_coulomb_nm > 0.0 and u - b.frame_drive * p == 0.0:
        return gear_torque(b.ratio, b.efficiency, motor, system.senses.crank) + system.compensation_nm
    return crank_torque(b, motor, u, p) + system.compensation_nm


@kernel
def instant(system: Motion, t: float, y: NDArray[np.float64]) -> Instant:
    """Return an instant of the motion as the bearings see it."""
    b, motor = system.breaker, system.torque_nm + system.slope_nm_per_s * t
    drive, gap = crank_torque(b, motor, y[U], y[P]) + system.compensation_nm, 0.0
    if b.crank_coulomb_nm > 0.0 and y[U] == 0.0 and b.frame_drive * y[P] == 0.0:
        gap = abs(b.ratio * motor) * (1.0 / b.efficiency - b.efficiency)
    low, high = (gap, 0.0) if motor < 0.0 else (0.0, gap)
    return Instant(y[Q], y[U], y[PHI], y[P], drive, low, high, system.rests, system.tool)


@kernel
def torques_now(system: Motion, t: float, y: NDArray[np.float64]) -> BearingTorques:
    """Return drive, friction and the striker's force on the tool in a state."""
    m = masses_at(system.breaker, y[Q], y[PHI])
    return bearing_torques(system.breaker, m, instant(system, t, y), system.senses)


@kernel
def senses_now(system: Motion, t: float, y: NDArray[np.float64], rests: bool, tool: int) -> Senses:
    """Return in which senses crank and body go on from a state, body and tool in these regimes."""
    if not rubs(system.breaker):
        return Senses(1.0, 1.0)
    now = instant(system, t, y)
    return senses_at(
        system.breaker,
        Instant(now.q, now.u, now.phi, now.p, now.drive_nm, now.gear_low_nm, now.gear_high_nm, rests, tool),
    )


@kernel
def going_on(system: Motion, senses: Senses, rests: bool, tool: int) -> Motion:
    """Return the motion with body, tool and bearings in these regimes."""
    return Motion(
        system.breaker,
        system.torque_nm,
        system.slope_nm_per_s,
        system.compensation_nm,
        rests,
        tool,
        system.dead_centre_rad,
        senses,
    )


@rates_of(Motion, COOPER_VERNER_8)
def motion_rates(system: Motion, t: float, y: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Fill the derivatives of the state."""
    derivatives(system.breaker, y, drive_torque(system, t, y[U], y[P]), system.rests, system.tool, system.senses, out)


@kernel
def forces_now(system: Motion, t: float, y: NDArray[np.float64]) -> Accelerations:
    """Return accelerations, collar moment and force on the tool in a state."""
    b, drive = system.breaker, drive_torque(system, t, y[U], y[P])
    m = masses_at(b, y[Q], y[PHI])
    return contact_accelerations(b, m, y[Q], y[U], y[PHI], y[P], drive, system.rests, system.tool, system.senses)


@signals_of(Motion)
def motion_signals(system: Motion, index: int, t: float, y: NDArray[np.float64]) -> tuple[float, float]:
    """Return value and derivative of a signal."""
    b = system.breaker
    if index == GAP:
        travel, slope, _ = striker(b, y[Q])
        return b.tool_radius_m * y[PHI] + y[TOOL] - travel, b.tool_radius_m * y[P] + y[TOOL_SPEED] - slope * y[U]
    if index == LIFT:
        return float(y[PHI]), float(y[P])
    if index == DEAD_CENTRE:
        return float(system.dead_centre_rad - y[Q]), -float(y[U])
    if index in (CRANK_GRIP, BODY_GRIP):
        held = torques_now(system, t, y)
        return held.crank_margin_nm if index == CRANK_GRIP else held.body_margin_nm, UNKNOWN
    return force_signals(system, index, t, y)


@kernel
def force_signals(system: Motion, index: int, t: float, y: NDArray[np.float64]) -> tuple[float, float]:
    """Return value and derivative of the signals that need the forces."""
    now, wall = forces_now(system, t, y), system.breaker.wall_force_n
    value, rate = now.collar_nm, UNKNOWN
    if index == COLLAR and rubs(system.breaker):
        value = torques_now(system, t, y).body_margin_nm
    if index == TOOL_MOTION:
        value, rate = float(y[TOOL_SPEED]), (now.tool_force_n - wall) / system.breaker.tool_mass_kg
    elif index == CRANK_MOTION:
        value, rate = float(y[U]), now.crank
    elif index == CRANK_TURN:
        value, rate = system.senses.crank * float(y[U]), system.senses.crank * now.crank
    elif index == BODY_TURN:
        value, rate = system.senses.body * float(y[P]), system.senses.body * now.body
    elif index == THRUST:
        value = now.tool_force_n + ADHESION_N
    elif index == WALL:
        value = wall - now.tool_force_n
    return value, rate


@kernel
def substep(u: float, remaining: float, longest_s: float) -> float:
    """Return the length of the next substep (s): equal pieces of what remains, short in time and in crank angle."""
    longest = min(longest_s, SINGLE_STEP_RAD / (abs(u) + 1e-9))
    return remaining / max(math.ceil(remaining / longest - 1e-9), 1)


@kernel
def workspace_of_motion() -> Workspace:
    """Return room for the steps of one coupling step."""
    return Workspace(np.empty((len(COOPER_VERNER_8.nodes), STATES)), np.empty(STATES), np.empty(STATES))
