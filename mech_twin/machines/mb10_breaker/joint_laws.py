# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction of the breaker's bearings and loss of its gear as laws of the event loop, and their torques.

::

    crank's bearing, in the body    |T_q| <= c_q      speed u
    body's pivot, in the frame      |T_phi| <= c_phi  speed p
    gear                            |T_g| <= its loss speed u - f p, f = 1 with the drive on the frame, else 0

Laws along one direction are merged.  With the body on its collar only the crank moves: the gear's law is part of the
crank's, the pivot's of the collar's, [-c_phi, inf).  With the striker on a tool that the wall holds, crank and body
have one degree of freedom, p = lean u, and the crank's law contains all three.  With the body on its collar too they
have none, and nothing slides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.engine.hybrid.laws import HIGH, HOLD, LOW, OPEN, Array, Equations, Indices
from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel
from mech_twin.machines.mb10_breaker.dynamics import TURN, Breaker, striker
from mech_twin.machines.mb10_breaker.state import (
    BODY,
    BODY_RATE,
    BODY_SENSE,
    COLLAR_LAW,
    CRANK,
    CRANK_LAW,
    CRANK_RATE,
    CRANK_SENSE,
    FEED,
    FREEDOMS,
    GEAR_LAW,
    LAWS,
    PASS_DONE,
    PIVOT_LAW,
    RESEATING_LOSS,
    TOOL,
    TOOL_LAW,
    TOOL_RATE,
    WALL_LAW,
)


class Shares(NamedTuple):
    """What the crank's law is made of (N m): at the crank as it turns forward, with its sense at gear and pivot."""

    whole: float
    bearing: float
    gear: float
    pivot: float


class Torques(NamedTuple):
    """Torques (N m): of the drive on the crank, of friction on crank and body; the striker's force on the tool (N)."""

    drive_nm: float
    tool_force_n: float
    crank_nm: float
    body_nm: float


@inline_kernel
def on_collar(b: Breaker, regimes: Indices) -> bool:
    """Return whether the body is at rest on its collar, or held."""
    return bool(b.held or regimes[COLLAR_LAW] == HOLD)


@inline_kernel
def on_wall(regimes: Indices) -> bool:
    """Return whether the striker is in contact with a tool that the wall holds."""
    return bool(regimes[TOOL_LAW] == HOLD and regimes[WALL_LAW] == HOLD)


@inline_kernel
def crank_shares(b: Breaker, loss_nm: float, slope: float, regimes: Indices) -> Shares:
    """Return the parts (N m) of the crank's law, for a gear loss (N m) and a slope of the striker's travel (m/rad)."""
    rests, pressed, bearing = on_collar(b, regimes), on_wall(regimes), b.crank_coulomb_nm
    lean = 0.0 if rests or not pressed else slope / b.tool_radius_m
    along = 1.0 - b.frame_drive * lean
    gear = 0.0 if not (rests or pressed or b.frame_drive == 0.0) else loss_nm if along >= 0.0 else -loss_nm
    pivot = 0.0 if lean == 0.0 else b.body_coulomb_nm if lean > 0.0 else -b.body_coulomb_nm
    return Shares(bearing + gear * along + pivot * lean, bearing, gear, pivot)


@inline_kernel
def law_at(present: bool, regime: int, speed: float, sense: float) -> int:
    """Return the regime of a law that applies or not; one that starts to apply at rest gets the stored direction."""
    if not present:
        return OPEN
    if regime != OPEN:
        return regime
    moved = speed if speed != 0.0 else sense
    return LOW if moved > 0.0 else HIGH if moved < 0.0 else HOLD


@borrowing_kernel
def join_laws(b: Breaker, y: Array, regimes: Indices, crank_sense: float, body_sense: float) -> None:
    """Activate or merge the laws of bearings and gear according to the contacts of body and tool.

    The wall's law is active only under the striker: nothing else moves a tool at rest.
    """
    if regimes[WALL_LAW] != LOW:
        regimes[WALL_LAW] = HOLD if regimes[TOOL_LAW] == HOLD else OPEN
    rests, pressed, loses = on_collar(b, regimes), on_wall(regimes), b.efficiency < 1.0
    if rests and pressed:
        y[CRANK_RATE] = y[BODY_RATE] = 0.0
        regimes[CRANK_LAW] = regimes[PIVOT_LAW] = regimes[GEAR_LAW] = OPEN
        return
    u, p, rubs = y[CRANK_RATE], y[BODY_RATE], b.body_coulomb_nm > 0.0
    joined = rests or pressed or b.frame_drive == 0.0
    crank = b.crank_coulomb_nm > 0.0 or (loses and joined) or (pressed and rubs)
    regimes[CRANK_LAW] = law_at(crank, regimes[CRANK_LAW], u, crank_sense)
    regimes[PIVOT_LAW] = law_at(rubs and not rests and not pressed, regimes[PIVOT_LAW], p, body_sense)
    regimes[GEAR_LAW] = law_at(loses and not joined, regimes[GEAR_LAW], u - b.frame_drive * p, 0.0)


@inline_kernel
def sense_of(regime: int, speed: float) -> float:
    """Return the sliding direction, 0 while friction holds."""
    if speed != 0.0:
        return 1.0 if speed > 0.0 else -1.0
    return 1.0 if regime == LOW else -1.0 if regime == HIGH else 0.0


@borrowing_kernel
def senses(b: Breaker, y: Array, regimes: Indices) -> tuple[float, float]:
    """Return the sliding directions of crank and body: 1 for a joint without friction, 0 for a body on its collar."""
    if b.crank_coulomb_nm == 0.0 and b.body_coulomb_nm == 0.0:
        return 1.0, 1.0
    crank = sense_of(regimes[CRANK_LAW], y[CRANK_RATE]) if b.crank_coulomb_nm > 0.0 else 1.0
    if on_collar(b, regimes):
        return crank, 0.0
    body = sense_of(regimes[PIVOT_LAW], y[BODY_RATE])
    if on_wall(regimes):
        body = sense_of(regimes[CRANK_LAW], y[CRANK_RATE]) * math.copysign(1.0, striker(b, y[CRANK])[1])
    return crank, body if b.body_coulomb_nm > 0.0 else 1.0


@inline_kernel
def to_dead_centre(b: Breaker, q: float) -> float:
    """Return the crank angle (rad, > 0) left to the rocker's next dead centre."""
    striking, retreating = (b.striking_crank_rad - q) % TURN, (b.retreating_crank_rad - q) % TURN
    striking = striking if striking > 1e-12 else TURN
    retreating = retreating if retreating > 1e-12 else TURN
    return min(striking, retreating)


@borrowing_kernel
def project_contact(b: Breaker, y: Array, regimes: Indices) -> None:
    """Project tool position and speeds onto the contact of striker and tool, removing drift."""
    travel, slope, _ = striker(b, y[CRANK])
    y[TOOL] = travel - b.tool_radius_m * y[BODY]
    if regimes[WALL_LAW] != HOLD:
        y[TOOL_RATE] = slope * y[CRANK_RATE] - b.tool_radius_m * y[BODY_RATE]
    elif not on_collar(b, regimes):
        y[BODY_RATE] = slope * y[CRANK_RATE] / b.tool_radius_m


@inline_kernel
def striking(b: Breaker, q: float) -> bool:
    """Return whether the nearer of the two dead centres is the striking one."""
    first, second = (b.striking_crank_rad - q) % TURN, (b.retreating_crank_rad - q) % TURN
    return min(first, TURN - first) < min(second, TURN - second)


@borrowing_kernel
def effect_of_impact(at: Equations, before: Array, y: Array) -> tuple[float, float, float, float]:
    """Return energy lost (J), angular impulse (N m s), and closing speed of striker and tool before and after (m/s)."""
    loss, turned, closing, closes = 0.0, 0.0, 0.0, 0.0
    for law in range(LAWS):
        impulse, approach, parting = at.multiplier[law], 0.0, 0.0
        for k in range(FREEDOMS):
            approach += at.directions[law, k] * before[FREEDOMS + k]
            parting += at.directions[law, k] * y[FREEDOMS + k]
        loss, turned = loss - 0.5 * impulse * (approach + parting), turned + impulse * at.directions[law, 1]
        if law == TOOL_LAW:
            closing, closes = -approach, -parting
    return loss, turned, closing, closes


@borrowing_kernel
def reseat_tool(b: Breaker, y: Array, regimes: Indices, memory: Array) -> None:
    """Return the tool to its seat for the next pass; its travel is the feed (m)."""
    memory[RESEATING_LOSS] += 0.5 * b.tool_mass_kg * y[TOOL_RATE] * y[TOOL_RATE]
    memory[FEED], memory[PASS_DONE], y[TOOL], y[TOOL_RATE] = y[TOOL], 0.0, 0.0, 0.0
    regimes[WALL_LAW] = regimes[TOOL_LAW] = OPEN
    join_laws(b, y, regimes, memory[CRANK_SENSE], memory[BODY_SENSE])


@inline_kernel
def within(force: float, bound: float) -> float:
    """Return a force clipped to plus or minus a bound."""
    return min(max(force, -bound), bound)


@inline_kernel
def reported_torques(
    b: Breaker, drive_nm: float, loss_nm: float, slope: float, regimes: Indices, forces: Array, low: Array
) -> Torques:
    """Return the torques of drive and friction and the tool force; ``drive_nm`` is without the gear's loss (N m)."""
    rests, thrust = on_collar(b, regimes), forces[TOOL_LAW]
    if rests and on_wall(regimes):  # the bearing takes what it can, the tool the rest
        steep = math.copysign(max(abs(slope), 1e-12), slope)
        crank = -within(steep * thrust, b.crank_coulomb_nm)
        return Torques(drive_nm, thrust + crank / steep, crank, 0.0)
    shares = crank_shares(b, loss_nm, slope, regimes)
    share = within(forces[CRANK_LAW] / shares.whole, 1.0) if shares.whole > 0.0 else 0.0
    gear = share * shares.gear + within(forces[GEAR_LAW], loss_nm)
    body = share * shares.pivot + within(forces[PIVOT_LAW], b.body_coulomb_nm)
    if rests:
        body = min(max(forces[COLLAR_LAW] - low[COLLAR_LAW], 0.0) - b.body_coulomb_nm, 0.0)
    return Torques(drive_nm + gear, thrust, share * shares.bearing, body)
