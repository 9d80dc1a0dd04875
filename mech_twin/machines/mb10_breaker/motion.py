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
from mech_twin.kernels.kernel import inline_kernel, kernel
from mech_twin.machines.mb10_breaker.accelerations import (
    Accelerations,
    contact_accelerations,
    rates_of_state,
    standing_gear,
)
from mech_twin.machines.mb10_breaker.bearing_friction import (
    HOLDS_BEYOND,
    BearingTorques,
    Instant,
    bearing_torques,
    rubs,
    senses_at,
    sign,
)
from mech_twin.machines.mb10_breaker.dynamics import BLOCKED, Breaker, Senses, crank_torque, masses_at, striker
from mech_twin.machines.mb10_breaker.state import STATES, BreakerState, pack_state, unpacked_state
from mech_twin.parts.gear import gear_torque

# signals, each falling through zero at its event: striker from tool, body from collar, collar's moment, way to the
# rocker's next dead centre, speed of the tool, force of the striker on it, what more the wall can hold, crank speed;
# of crank and body their speeds in the sense in which they slide, and what more their friction can hold at rest;
# speed of the gear (of either sign), and what more its loss can hold while its shaft stands
GAP, LIFT, COLLAR, DEAD_CENTRE, TOOL_MOTION, THRUST, WALL, CRANK_MOTION = range(8)
CRANK_TURN, CRANK_GRIP, BODY_TURN, BODY_GRIP, GEAR_TURNS, GEAR_GRIP = range(8, 14)
SINGLE_STEP_RAD = 0.04  # longest turn of the crank in one substep: truncation below 1e-13
# while the tool is pushed: a stiff wall stops the crank within less, and the moment on a free body is a line between
# knots of this distance
PUSHING_SUBSTEP_S = 1e-4
MISSED_BETWEEN_KNOTS_RAD_PER_S = 1e-5  # of the body's rate, by the line
BODY_RATE = BreakerState._fields.index("body_rad_per_s")
MIDDLE, LAST = 8, 10  # stages of the method in the middle and at the end of its step
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
    gear_stands: bool  # its shaft stands while the body flies, held by its loss


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
    b = system.breaker
    m, at = masses_at(b, state.crank_rad, state.body_rad), instant(system, t, state)
    drive = at.drive_nm
    if system.gear_stands:
        drive, _ = standing_gear(b, m, at.q, at.u, at.phi, at.p, at.tool, system.senses)
    elif system.gear_sense * gear_speed(b, state) < 0.0 or (at.gear_low_nm == at.gear_high_nm and not at.rests):
        drive = drive_torque(system, t, at.u, at.p)  # as in the piece that ends or begins where the gear's speed is 0
    at = Instant(at.q, at.u, at.phi, at.p, drive, at.gear_low_nm, at.gear_high_nm, at.rests, at.tool)
    return bearing_torques(b, m, at, system.senses)


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
def may_stand(b: Breaker, state: Any, rests: bool, tool: int) -> bool:
    """Return whether the gear's loss may hold its shaft, which stands: u = p (drive on the frame) or u = 0.

    The body flies; with friction in its bearing a crank that stands in the body is `bearing_friction`'s.
    """
    free = not rests and tool != BLOCKED and (b.frame_drive > 0.0 or b.crank_coulomb_nm == 0.0)
    return free and b.efficiency < 1.0 and gear_speed(b, state) == 0.0


@kernel
def standing_senses(b: Breaker, state: Any, tool: int, senses: Senses) -> Senses:
    """Return the senses of crank and body with the gear's shaft standing; of the crank 0 where there are none.

    ``senses`` are those of what moves; from rest both set off together, in the sense that is borne out.
    """
    q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    if p != 0.0 or senses.crank == 0.0 or senses.body == 0.0 or not rubs(b):
        return senses
    m = masses_at(b, q, phi)
    for along in (1.0, -1.0):
        tried = Senses(along if b.crank_coulomb_nm > 0.0 else 1.0, along if b.body_coulomb_nm > 0.0 else 1.0)
        if along * standing_gear(b, m, q, u, phi, p, tool, tried)[1] > 0.0:
            return tried
    return Senses(0.0, 0.0)


@kernel
def gear_hold(system: Motion, t: float, state: Any, tool: int, senses: Senses) -> tuple[float, float, float]:
    """Return the crank torque (N m) with which the gear's shaft goes on standing, and the bounds its loss sets it."""
    b, motor = system.breaker, system.torque_nm + system.slope_nm_per_s * t
    q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    needed, _ = standing_gear(b, masses_at(b, q, phi), q, u, phi, p, tool, senses)
    forward, backward = gear_torque(b.ratio, b.efficiency, motor, 1.0), gear_torque(b.ratio, b.efficiency, motor, -1.0)
    return needed, forward + system.compensation_nm, backward + system.compensation_nm


@kernel
def going_on(system: Motion, t: float, state: Any, senses: Senses, rests: bool, tool: int, lands: bool) -> Motion:
    """Return the motion as it goes on from a state with body, tool and bearings in these regimes.

    ``lands``: the gear keeps its sense through the piece, which ends where that turns.  A shaft that stands is held
    where that takes less than its loss can (by more than rounding), else it sets off in the sense that this asks for.
    """
    speed, stands = gear_speed(system.breaker, state), False
    sense = sign(speed) if lands else 0.0
    if lands and may_stand(system.breaker, state, rests, tool):
        still = standing_senses(system.breaker, state, tool, senses)
        if still.crank != 0.0:
            needed, low, high = gear_hold(system, t, state, tool, still)
            least = HOLDS_BEYOND * (abs(needed) + abs(low) + abs(high))
            stands, sense = min(needed - low, high - needed) > least, 1.0 if needed - low < high - needed else -1.0
            senses = still if stands else senses
    return Motion(
        system.breaker,
        system.torque_nm,
        system.slope_nm_per_s,
        system.compensation_nm,
        rests,
        tool,
        system.dead_centre_rad,
        senses,
        sense,
        stands,
    )


@kernel
def torque_of_standing_gear(system: Motion, state: Any) -> float:
    """Return the torque on the crank (N m) with which the gear's shaft goes on standing."""
    q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    return standing_gear(system.breaker, masses_at(system.breaker, q, phi), q, u, phi, p, system.tool, system.senses)[0]


@rates_of(Motion, COOPER_VERNER_8)
def motion_rates(system: Motion, t: float, y: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Fill the derivatives of the state."""
    state = unpacked_state(y)
    drive = drive_torque(system, t, state.crank_rad_per_s, state.body_rad_per_s)
    if system.gear_stands:
        drive = torque_of_standing_gear(system, state)
    pack_state(rates_of_state(system.breaker, state, drive, system.rests, system.tool, system.senses), out)


@kernel
def forces_now(system: Motion, t: float, state: Any) -> Accelerations:
    """Return accelerations, collar moment and force on the tool in a state."""
    q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    b, drive = system.breaker, drive_torque(system, t, u, p)
    if system.gear_stands:
        drive = torque_of_standing_gear(system, state)
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
    if index in (CRANK_GRIP, BODY_GRIP, GEAR_TURNS, GEAR_GRIP):
        return grip_signal(system, index, t, state), UNKNOWN
    return force_signals(system, index, t, state)


@kernel
def grip_signal(system: Motion, index: int, t: float, state: Any) -> float:
    """Return what more friction can hold at rest, or the speed of the gear."""
    if index == GEAR_TURNS:
        return gear_speed(system.breaker, state)
    if index == GEAR_GRIP:
        needed, low, high = gear_hold(system, t, state, system.tool, system.senses)
        return min(needed - low, high - needed)
    held = torques_now(system, t, state)
    return held.crank_margin_nm if index == CRANK_GRIP else held.body_margin_nm


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
def between_knots(span: float, work: Workspace) -> float:
    """Return the length (s) of a piece that ends in a knot, from the step of ``span`` just taken: it or a shorter one.

    Between knots the moment on the body is a line.  Of p' at both ends and in the middle what the line misses of the
    body's rate is h (p'_0 - 2 p'_1/2 + p'_1)/3, which falls as h^3; a wall that stops a light crank bends it much.
    """
    first, middle, last = work.rates[0, BODY_RATE], work.rates[MIDDLE, BODY_RATE], work.rates[LAST, BODY_RATE]
    missed = span * abs(first - 2.0 * middle + last) / 3.0
    if missed <= MISSED_BETWEEN_KNOTS_RAD_PER_S:
        return span
    return float(span * (MISSED_BETWEEN_KNOTS_RAD_PER_S / missed) ** (1.0 / 3.0))


@kernel
def workspace_of_motion() -> Workspace:
    """Return room for the steps of one coupling step."""
    return Workspace(np.empty((len(COOPER_VERNER_8.nodes), STATES)), np.empty(STATES), np.empty(STATES))
