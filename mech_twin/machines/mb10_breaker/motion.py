# SPDX-License-Identifier: Apache-2.0
"""The breaker between two events as a system of the engine: equation of motion, method, signals of its events."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.events import UNKNOWN, signals_of
from mech_twin.engine.integration import Workspace, rates_of
from mech_twin.engine.tableaus import COOPER_VERNER_8
from mech_twin.kernel import inline_kernel, kernel
from mech_twin.machines.mb10_breaker.accelerations import (
    Accelerations,
    contact_accelerations,
    rates_of_state,
)
from mech_twin.machines.mb10_breaker.bearing_friction import (
    BearingTorques,
    Instant,
    bearing_torques,
    rubs,
    senses_at,
)
from mech_twin.machines.mb10_breaker.dynamics import Breaker, Senses, crank_torque, masses_at, striker
from mech_twin.machines.mb10_breaker.state import STATES, pack_state, unpacked_state
from mech_twin.parts.gear import gear_torque

# signals, each falling through zero at its event: striker from tool, body from collar, collar's moment, way to the
# rocker's next dead centre, speed of the tool, force of the striker on it, what more the wall can hold, crank speed;
# of crank and body their speeds in the sense in which they slide, and what more their friction can hold at rest;
# speed of the gear (of either sign)
GAP, LIFT, COLLAR, DEAD_CENTRE, TOOL_MOTION, THRUST, WALL, CRANK_MOTION = range(8)
CRANK_TURN, CRANK_GRIP, BODY_TURN, BODY_GRIP, GEAR_TURNS = range(8, 13)
SINGLE_STEP_RAD = 0.04  # longest turn of the crank in one substep: truncation below 1e-13
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
    gear_sense: float  # sign of the gear's speed, in which its loss stays through the piece; 0: that of each instant


@inline_kernel
def drive_torque(system: Motion, t: float, u: float, p: float) -> float:
    """Return the torque on the crank behind the gear (N m); a shaft that stands is taken to turn as the crank will."""
    b, motor = system.breaker, system.torque_nm + system.slope_nm_per_s * t
    if system.gear_sense != 0.0:
        return gear_torque(b.ratio, b.efficiency, motor, system.gear_sense) + system.compensation_nm
    if b.crank_coulomb_nm > 0.0 and u - b.frame_drive * p == 0.0:
        return gear_torque(b.ratio, b.efficiency, motor, system.senses.crank) + system.compensation_nm
    return crank_torque(b, motor, u, p) + system.compensation_nm


@kernel
def instant(system: Motion, t: float, state: Any) -> Instant:
    """Return an instant of the motion as the bearings see it."""
    b, motor = system.breaker, system.torque_nm + system.slope_nm_per_s * t
    u, p = state.crank_rad_per_s, state.body_rad_per_s
    drive, gap = crank_torque(b, motor, u, p) + system.compensation_nm, 0.0
    if b.crank_coulomb_nm > 0.0 and u == 0.0 and b.frame_drive * p == 0.0:
        gap = abs(b.ratio * motor) * (1.0 / b.efficiency - b.efficiency)
    low, high = (gap, 0.0) if motor < 0.0 else (0.0, gap)
    return Instant(state.crank_rad, u, state.body_rad, p, drive, low, high, system.rests, system.tool)


@kernel
def torques_now(system: Motion, t: float, state: Any) -> BearingTorques:
    """Return drive, friction and the striker's force on the tool in a state."""
    m = masses_at(system.breaker, state.crank_rad, state.body_rad)
    return bearing_torques(system.breaker, m, instant(system, t, state), system.senses)


@kernel
def senses_now(system: Motion, t: float, state: Any, rests: bool, tool: int) -> Senses:
    """Return in which senses crank and body go on from a state, body and tool in these regimes."""
    if not rubs(system.breaker):
        return Senses(1.0, 1.0)
    now = instant(system, t, state)
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
        0.0,
    )


@rates_of(Motion, COOPER_VERNER_8)
def motion_rates(system: Motion, t: float, y: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Fill the derivatives of the state."""
    state = unpacked_state(y)
    drive = drive_torque(system, t, state.crank_rad_per_s, state.body_rad_per_s)
    pack_state(rates_of_state(system.breaker, state, drive, system.rests, system.tool, system.senses), out)


@kernel
def forces_now(system: Motion, t: float, state: Any) -> Accelerations:
    """Return accelerations, collar moment and force on the tool in a state."""
    q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    b, drive = system.breaker, drive_torque(system, t, u, p)
    m = masses_at(b, q, phi)
    return contact_accelerations(b, m, q, u, phi, p, drive, system.rests, system.tool, system.senses)


@signals_of(Motion)
def motion_signals(system: Motion, index: int, t: float, y: NDArray[np.float64]) -> tuple[float, float]:
    """Return value and derivative of a signal."""
    b, state = system.breaker, unpacked_state(y)
    if index == GAP:
        return tool_gap(b, state)
    if index == LIFT:
        return float(state.body_rad), float(state.body_rad_per_s)
    if index == DEAD_CENTRE:
        return float(system.dead_centre_rad - state.crank_rad), -float(state.crank_rad_per_s)
    if index in (CRANK_GRIP, BODY_GRIP):
        held = torques_now(system, t, state)
        return held.crank_margin_nm if index == CRANK_GRIP else held.body_margin_nm, UNKNOWN
    if index == GEAR_TURNS:
        return gear_speed(b, state), UNKNOWN
    return force_signals(system, index, t, state)


@kernel
def tool_gap(b: Breaker, state: Any) -> tuple[float, float]:
    """Return how far the striker is from the tool (m), and how fast they part (m/s)."""
    travel, slope, _ = striker(b, state.crank_rad)
    gap = b.tool_radius_m * state.body_rad + state.tool_m - travel
    return gap, b.tool_radius_m * state.body_rad_per_s + state.tool_m_per_s - slope * state.crank_rad_per_s


@kernel
def gear_speed(b: Breaker, state: Any) -> float:
    """Return the speed of the crank against what carries the gear (rad/s): with its sign the gear's loss jumps."""
    return float(state.crank_rad_per_s - b.frame_drive * state.body_rad_per_s)


@kernel
def force_signals(system: Motion, index: int, t: float, state: Any) -> tuple[float, float]:
    """Return value and derivative of the signals that need the forces."""
    now, wall = forces_now(system, t, state), system.breaker.wall_force_n
    value, rate = now.collar_nm, UNKNOWN
    if index == COLLAR and rubs(system.breaker):
        value = torques_now(system, t, state).body_margin_nm
    if index == TOOL_MOTION:
        value, rate = float(state.tool_m_per_s), (now.tool_force_n - wall) / system.breaker.tool_mass_kg
    elif index == CRANK_MOTION:
        value, rate = float(state.crank_rad_per_s), now.crank
    elif index == CRANK_TURN:
        value, rate = system.senses.crank * float(state.crank_rad_per_s), system.senses.crank * now.crank
    elif index == BODY_TURN:
        value, rate = system.senses.body * float(state.body_rad_per_s), system.senses.body * now.body
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
