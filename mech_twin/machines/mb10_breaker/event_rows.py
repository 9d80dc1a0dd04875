# SPDX-License-Identifier: Apache-2.0
"""Rows of the breaker's events: state and torques before and after each."""

from __future__ import annotations

from mech_twin.engine.compiled_steps import fill_event
from mech_twin.engine.hybrid.laws import HOLD, LOW, OPEN, Array, Indices
from mech_twin.engine.sample_vectors import EVENT_WIDTH, SIDES
from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel
from mech_twin.machines.mb10_breaker.dynamics import Breaker, spring_moment
from mech_twin.machines.mb10_breaker.joint_laws import Torques, on_collar, on_wall, senses
from mech_twin.machines.mb10_breaker.state import (
    BODY,
    BODY_RATE,
    BODY_SENSE,
    BODY_STOPPED,
    COLLAR_LAW,
    CRANK,
    CRANK_LAW,
    CRANK_RATE,
    CRANK_SENSE,
    CRANK_STOPPED,
    CYCLE,
    GEAR_LAW,
    GEAR_REVERSED,
    GEAR_STARTED,
    GEAR_STOPPED,
    LIFT_OFF,
    PUSHING,
    RELEASED,
    SETTLED,
    STALL_TOLD,
    STALLED,
    TOOL,
    TOOL_LAW,
    TOOL_RATE,
    TOUCHDOWN,
    WALL_LAW,
    EventSide,
)

CONTACTS = ("collar", "tool", "crank_bearing", "body_pivot", "gear")
COLLAR_CONTACT, TOOL_CONTACT, BEARING_CONTACT, PIVOT_CONTACT, GEAR_CONTACT = range(5)
SIDE_WIDTH = 3 * len(EventSide._fields)


@inline_kernel
def contact_of(kind: int) -> int:
    """Return the contact at which an event of this kind takes place."""
    if kind >= GEAR_STOPPED:
        return GEAR_CONTACT
    if kind >= CRANK_STOPPED:
        return PIVOT_CONTACT if kind >= BODY_STOPPED else BEARING_CONTACT
    return COLLAR_CONTACT if kind in (TOUCHDOWN, SETTLED, LIFT_OFF) else TOOL_CONTACT


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
    b: Breaker, memory: Array, time_s: float, y: Array, past: Indices, regimes: Indices, was: Torques, now: Torques,
    log: Array, count: int,
) -> int:  # fmt: skip
    """Log contacts made or lost without an impact: collar, striker, and the wall as it yields or holds."""
    cycle, collar, tool = memory[CYCLE], regimes[COLLAR_LAW], regimes[TOOL_LAW]
    if past[COLLAR_LAW] != collar:
        count = log_row(b, time_s, SETTLED if collar == HOLD else LIFT_OFF, cycle, y, was, now, log, count)
    if past[TOOL_LAW] == HOLD != tool:
        count = log_row(b, time_s, RELEASED, cycle, y, was, now, log, count)
    elif tool == HOLD and past[WALL_LAW] + past[TOOL_LAW] != regimes[WALL_LAW] + tool and not on_collar(b, regimes):
        count = log_row(b, time_s, PUSHING, cycle, y, was, now, log, count)
    return count


@borrowing_kernel
def log_bearings(
    b: Breaker, memory: Array, time_s: float, slides: bool, y: Array, past: Indices, regimes: Indices, was: Torques,
    now: Torques, log: Array, count: int,
) -> int:  # fmt: skip
    """Log a crank that stalls on the tool, changes of sliding direction at rest, and changes of the gear's regime.

    ``slides``: the changes are not due to an impact.
    """
    cycle, u, rests = memory[CYCLE], y[CRANK_RATE], on_collar(b, regimes)
    stops = rests and on_wall(regimes)
    stops = stops or (regimes[TOOL_LAW] == HOLD and u == 0.0 and past[CRANK_LAW] == LOW != regimes[CRANK_LAW])
    if stops and memory[STALL_TOLD] == 0.0:
        memory[STALL_TOLD] = 1.0
        count = log_row(b, time_s, STALLED, cycle, y, was, now, log, count)
    crank, body = senses(b, y, regimes)
    if u == 0.0 and b.crank_coulomb_nm > 0.0 and crank != memory[CRANK_SENSE]:
        kind = change(memory[CRANK_SENSE], crank, CRANK_STOPPED)
        count = log_row(b, time_s, kind, cycle, y, was, now, log, count)
    flies, turns = not rests and not on_collar(b, past), y[BODY_RATE] == 0.0 or on_wall(regimes)
    if flies and turns and b.body_coulomb_nm > 0.0 and body != memory[BODY_SENSE]:
        count = log_row(b, time_s, change(memory[BODY_SENSE], body, BODY_STOPPED), cycle, y, was, now, log, count)
    memory[CRANK_SENSE], memory[BODY_SENSE] = crank, body
    alone = b.frame_drive == 0.0 and b.crank_coulomb_nm == 0.0
    before, after = (past[CRANK_LAW], regimes[CRANK_LAW]) if alone else (past[GEAR_LAW], regimes[GEAR_LAW])
    if slides and flies and before != after and OPEN not in (before, after) and not on_wall(regimes):
        kind = GEAR_STOPPED if after == HOLD else GEAR_STARTED if before == HOLD else GEAR_REVERSED
        count = log_row(b, time_s, kind, cycle, y, was, now, log, count)
    return count
