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

The rows of its events hold state and torques before and after each.
"""

import math
from typing import Any, NamedTuple

from mech_twin.engine.compiled_steps import fill_event
from mech_twin.engine.hybrid.laws import HIGH, HOLD, LOW, OPEN, Array, Equations, Indices, regime_of
from mech_twin.engine.sample_vectors import EVENT_WIDTH, SIDES
from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel
from mech_twin.machines.mb10_breaker.dynamics import TURN, Breaker, spring_moment, striker
from mech_twin.machines.mb10_breaker.state import (
    BODY,
    BODY_RATE,
    CRANK,
    CRANK_RATE,
    EVENT,
    FREEDOMS,
    LAW,
    LAWS,
    TOOL,
    TOOL_RATE,
    EventSide,
)

CONTACTS = ("collar", "tool", "crank_bearing", "body_pivot", "gear")
COLLAR_CONTACT, TOOL_CONTACT, BEARING_CONTACT, PIVOT_CONTACT, GEAR_CONTACT = range(5)
SIDE_WIDTH = 3 * len(EventSide._fields)


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
    return bool(b.held or regimes[LAW.collar] == HOLD)


@inline_kernel
def on_wall(regimes: Indices) -> bool:
    """Return whether the striker is in contact with a tool that the wall holds."""
    return bool(regimes[LAW.tool] == HOLD and regimes[LAW.wall] == HOLD)


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
    return regime if regime != OPEN else regime_of(speed if speed != 0.0 else sense)


@borrowing_kernel
def join_laws(b: Breaker, y: Array, regimes: Indices, crank_sense: float, body_sense: float) -> None:
    """Activate or merge the laws of bearings and gear according to the contacts of body and tool.

    The wall's law is active only under the striker: nothing else moves a tool at rest.
    """
    if regimes[LAW.wall] != LOW:
        regimes[LAW.wall] = HOLD if regimes[LAW.tool] == HOLD else OPEN
    rests, pressed, loses = on_collar(b, regimes), on_wall(regimes), b.efficiency < 1.0
    if rests and pressed:
        y[CRANK_RATE] = y[BODY_RATE] = 0.0
        regimes[LAW.crank] = regimes[LAW.pivot] = regimes[LAW.gear] = OPEN
        return
    u, p, rubs = y[CRANK_RATE], y[BODY_RATE], b.body_coulomb_nm > 0.0
    joined = rests or pressed or b.frame_drive == 0.0
    crank = b.crank_coulomb_nm > 0.0 or (loses and joined) or (pressed and rubs)
    regimes[LAW.crank] = law_at(crank, regimes[LAW.crank], u, crank_sense)
    regimes[LAW.pivot] = law_at(rubs and not rests and not pressed, regimes[LAW.pivot], p, body_sense)
    regimes[LAW.gear] = law_at(loses and not joined, regimes[LAW.gear], u - b.frame_drive * p, 0.0)


@inline_kernel
def sense_of(regime: int, speed: float) -> float:
    """Return the sliding direction, 0 while friction holds."""
    if speed != 0.0:
        return 1.0 if speed > 0.0 else -1.0
    return 1.0 if regime == LOW else -1.0 if regime == HIGH else 0.0


@borrowing_kernel
def senses(b: Breaker, y: Array, regimes: Indices) -> tuple[float, float]:
    """Return the sliding directions of crank and body: 1 for a joint without friction, 0 for a body on its collar."""
    crank = sense_of(regimes[LAW.crank], y[CRANK_RATE]) if b.crank_coulomb_nm > 0.0 else 1.0
    if b.body_coulomb_nm == 0.0:
        return crank, 1.0
    if on_collar(b, regimes):
        return crank, 0.0
    body = sense_of(regimes[LAW.pivot], y[BODY_RATE])
    if on_wall(regimes):
        body = sense_of(regimes[LAW.crank], y[CRANK_RATE]) * math.copysign(1.0, striker(b, y[CRANK])[1])
    return crank, body


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
    if regimes[LAW.wall] != HOLD:
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
        if law == LAW.tool:
            closing, closes = -approach, -parting
    return loss, turned, closing, closes


@borrowing_kernel
def reseat_tool(b: Breaker, y: Array, regimes: Indices, memory: Any) -> None:
    """Return the tool to its seat for the next pass; its travel is the feed (m)."""
    memory.reseating_loss_j += 0.5 * b.tool_mass_kg * y[TOOL_RATE] * y[TOOL_RATE]
    memory.feed_per_blow_m, memory.pass_done, y[TOOL], y[TOOL_RATE] = y[TOOL], 0.0, 0.0, 0.0
    regimes[LAW.wall] = regimes[LAW.tool] = OPEN
    join_laws(b, y, regimes, memory.crank_sense, memory.body_sense)


@inline_kernel
def within(force: float, bound: float) -> float:
    """Return a force clipped to plus or minus a bound."""
    return min(max(force, -bound), bound)


@inline_kernel
def reported_torques(
    b: Breaker, drive_nm: float, loss_nm: float, slope: float, regimes: Indices, forces: Array, low: Array
) -> Torques:
    """Return the torques of drive and friction and the tool force; ``drive_nm`` is without the gear's loss (N m)."""
    rests, thrust = on_collar(b, regimes), forces[LAW.tool]
    if rests and on_wall(regimes):  # the bearing takes what it can, the tool the rest
        steep = math.copysign(max(abs(slope), 1e-12), slope)
        crank = -within(steep * thrust, b.crank_coulomb_nm)
        return Torques(drive_nm, thrust + crank / steep, crank, 0.0)
    shares = crank_shares(b, loss_nm, slope, regimes)
    share = within(forces[LAW.crank] / shares.whole, 1.0) if shares.whole > 0.0 else 0.0
    gear = share * shares.gear + within(forces[LAW.gear], loss_nm)
    body = share * shares.pivot + within(forces[LAW.pivot], b.body_coulomb_nm)
    if rests:
        body = min(max(forces[LAW.collar] - low[LAW.collar], 0.0) - b.body_coulomb_nm, 0.0)
    return Torques(drive_nm + gear, thrust, share * shares.bearing, body)


@inline_kernel
def contact_of(kind: int) -> int:
    """Return the contact at which an event of this kind takes place."""
    if kind >= EVENT.gear_stopped:
        return GEAR_CONTACT
    if kind >= EVENT.crank_stopped:
        return PIVOT_CONTACT if kind >= EVENT.body_stopped else BEARING_CONTACT
    return COLLAR_CONTACT if kind in (EVENT.touchdown, EVENT.settled, EVENT.lift_off) else TOOL_CONTACT


@borrowing_kernel
def fill_side(b: Breaker, y: Array, now: Torques, row: Array, place: int) -> None:
    """Write the coordinates before or after an event into its row, in the order of `state.EventSide`."""
    q, u, phi, p = y[CRANK], y[CRANK_RATE], y[BODY], y[BODY_RATE]
    row[place], row[place + 1], row[place + 2] = q, u, now.drive_nm
    row[place + 3], row[place + 4], row[place + 5] = phi, p, -spring_moment(b, phi)
    row[place + 6], row[place + 7], row[place + 8] = y[TOOL], y[TOOL_RATE], now.tool_force_n
    row[place + 9], row[place + 10], row[place + 11] = q, u, now.crank_nm
    row[place + 12], row[place + 13], row[place + 14] = phi, p, now.body_nm


@borrowing_kernel
def begin_row(
    b: Breaker, time_s: float, kind: int, cycle: float, y: Array, before: Torques, log: Array, count: int
) -> None:
    """Write an event's row up to the coordinates before it."""
    fill_event(log, count, time_s, kind, contact_of(kind), 0.0, 0.0, 0.0, cycle)
    log[count, SIDES] = 1.0
    fill_side(b, y, before, log[count], EVENT_WIDTH)


@borrowing_kernel
def end_row(b: Breaker, y: Array, after: Torques, log: Array, row: int) -> None:
    """Write the coordinates after an event into its row."""
    fill_side(b, y, after, log[row], EVENT_WIDTH + SIDE_WIDTH)


@borrowing_kernel
def log_row(
    b: Breaker, time_s: float, kind: int, cycle: float, y: Array, before: Torques, after: Torques, log: Array,
    count: int,
) -> int:  # fmt: skip
    """Write an event without a jump of the state; return the number of events."""
    begin_row(b, time_s, kind, cycle, y, before, log, count)
    end_row(b, y, after, log, count)
    return count + 1


@inline_kernel
def change(before: float, after: float, stopped: int) -> int:
    """Return the kind of event of a changed sliding direction: ``stopped``, or the next two, started and reversed."""
    return stopped if after == 0.0 else stopped + 1 if before == 0.0 else stopped + 2


@borrowing_kernel
def log_contacts(
    b: Breaker, memory: Any, time_s: float, y: Array, past: Indices, regimes: Indices, was: Torques, now: Torques,
    log: Array, count: int,
) -> int:  # fmt: skip
    """Log contacts made or lost without an impact: collar, striker, and the wall as it yields or holds."""
    cycle, collar, tool = memory.cycle, regimes[LAW.collar], regimes[LAW.tool]
    if past[LAW.collar] != collar:
        count = log_row(b, time_s, EVENT.settled if collar == HOLD else EVENT.lift_off, cycle, y, was, now, log, count)
    if past[LAW.tool] == HOLD != tool:
        count = log_row(b, time_s, EVENT.released, cycle, y, was, now, log, count)
    elif tool == HOLD and past[LAW.wall] + past[LAW.tool] != regimes[LAW.wall] + tool and not on_collar(b, regimes):
        count = log_row(b, time_s, EVENT.pushing, cycle, y, was, now, log, count)
    return count


@borrowing_kernel
def log_bearings(
    b: Breaker, memory: Any, time_s: float, slides: bool, y: Array, past: Indices, regimes: Indices, was: Torques,
    now: Torques, log: Array, count: int,
) -> int:  # fmt: skip
    """Log a crank that stalls on the tool, changes of sliding direction at rest, and changes of the gear's regime.

    ``slides``: the changes are not due to an impact.
    """
    cycle, u, rests = memory.cycle, y[CRANK_RATE], on_collar(b, regimes)
    stops = rests and on_wall(regimes)
    stops = stops or (regimes[LAW.tool] == HOLD and u == 0.0 and past[LAW.crank] == LOW != regimes[LAW.crank])
    if stops and memory.stalled == 0.0:
        memory.stalled = 1.0
        count = log_row(b, time_s, EVENT.stalled, cycle, y, was, now, log, count)
    crank, body = senses(b, y, regimes)
    if u == 0.0 and b.crank_coulomb_nm > 0.0 and crank != memory.crank_sense:
        kind = change(memory.crank_sense, crank, EVENT.crank_stopped)
        count = log_row(b, time_s, kind, cycle, y, was, now, log, count)
    flies, turns = not rests and not on_collar(b, past), y[BODY_RATE] == 0.0 or on_wall(regimes)
    if flies and turns and b.body_coulomb_nm > 0.0 and body != memory.body_sense:
        count = log_row(b, time_s, change(memory.body_sense, body, EVENT.body_stopped), cycle, y, was, now, log, count)
    memory.crank_sense, memory.body_sense = crank, body
    alone = b.frame_drive == 0.0 and b.crank_coulomb_nm == 0.0
    before, after = (past[LAW.crank], regimes[LAW.crank]) if alone else (past[LAW.gear], regimes[LAW.gear])
    if slides and flies and before != after and OPEN not in (before, after) and not on_wall(regimes):
        kind = EVENT.gear_stopped if after == HOLD else EVENT.gear_started if before == HOLD else EVENT.gear_reversed
        count = log_row(b, time_s, kind, cycle, y, was, now, log, count)
    return count
