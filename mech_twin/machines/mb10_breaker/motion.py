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
from mech_twin.machines.mb10_breaker.dynamics import (
    PHI,
    STATES,
    TOOL,
    TOOL_SPEED,
    Accelerations,
    Breaker,
    P,
    Q,
    U,
    contact_accelerations,
    crank_torque,
    derivatives,
    masses_at,
    striker,
)

# signals, each falling through zero at its event: striker from tool, body from collar, collar's moment, way to the
# rocker's next dead centre, speed of the tool, force of the striker on it, what more the wall can hold, crank speed,
# speed of the gear (of either sign)
GAP, LIFT, COLLAR, DEAD_CENTRE, TOOL_MOTION, THRUST, WALL, CRANK_MOTION, GEAR_TURNS = range(9)
SINGLE_STEP_RAD = 0.04  # longest turn of the crank in one substep: truncation below 1e-13
PUSHING_SUBSTEP_S = 1e-4  # the moment on the body is a line between knots of this distance while the tool is pushed
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


@kernel
def drive_torque(system: Motion, t: float, u: float, p: float) -> float:
    """Return the torque on the crank behind the gear (N m)."""
    motor = system.torque_nm + system.slope_nm_per_s * t
    return crank_torque(system.breaker, motor, u, p) + system.compensation_nm


@rates_of(Motion, COOPER_VERNER_8)
def motion_rates(system: Motion, t: float, y: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Fill the derivatives of the state."""
    derivatives(system.breaker, y, drive_torque(system, t, y[U], y[P]), system.rests, system.tool, out)


@kernel
def forces_now(system: Motion, t: float, y: NDArray[np.float64]) -> Accelerations:
    """Return accelerations, collar moment and force on the tool in a state."""
    b, drive = system.breaker, drive_torque(system, t, y[U], y[P])
    m = masses_at(b, y[Q], y[PHI])
    return contact_accelerations(b, m, y[Q], y[U], y[PHI], y[P], drive, system.rests, system.tool)


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
    if index == GEAR_TURNS:
        return gear_speed(b, y), UNKNOWN
    return force_signals(system, index, t, y)


@kernel
def gear_speed(b: Breaker, y: NDArray[np.float64]) -> float:
    """Return the speed of the crank against what carries the gear (rad/s): with its sign the gear's loss jumps."""
    return float(y[U] - b.frame_drive * y[P])


@kernel
def force_signals(system: Motion, index: int, t: float, y: NDArray[np.float64]) -> tuple[float, float]:
    """Return value and derivative of the signals that need the forces."""
    now, wall = forces_now(system, t, y), system.breaker.wall_force_n
    value, rate = now.collar_nm, UNKNOWN
    if index == TOOL_MOTION:
        value, rate = float(y[TOOL_SPEED]), (now.tool_force_n - wall) / system.breaker.tool_mass_kg
    elif index == CRANK_MOTION:
        value, rate = float(y[U]), now.crank
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
