# SPDX-License-Identifier: Apache-2.0
"""What an event does to the breaker: the body on its collar, dead centres; the striker's are in `tool_contact`."""

from __future__ import annotations

from typing import Any

from mech_twin.engine.errors import MotionError
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.accelerations import accelerations, moving
from mech_twin.machines.mb10_breaker.dynamics import (
    BLOCKED,
    FLIGHT,
    MOVING,
    PUSHED,
    REST,
    STANDING,
    TURN,
    Breaker,
    energies,
    masses_at,
)
from mech_twin.machines.mb10_breaker.event_rows import begin_row, log_post
from mech_twin.machines.mb10_breaker.impacts import touchdown
from mech_twin.machines.mb10_breaker.motion import (
    COLLAR,
    DEAD_CENTRE,
    GAP,
    LIFT,
    Motion,
    drive_torque,
)
from mech_twin.machines.mb10_breaker.state import (
    LIFT_OFF,
    MISSED,
    SETTLED,
    TOUCHDOWN,
)
from mech_twin.machines.mb10_breaker.tool_contact import (
    SETTLED_WITHIN_S,
    SLOWEST_REBOUND_M_PER_S,
    apply_contact_event,
    apply_gap_closed,
    reseat_tool,
)


@kernel
def body_settles(motion: Motion, state: Any, time: float) -> bool:
    """Return whether the bounces still to come after this touchdown last too short to be told one by one."""
    b = motion.breaker
    q, e = state.crank_rad, b.collar_restitution
    u, p, _, _ = touchdown(b, q, state.crank_rad_per_s, 0.0, state.body_rad_per_s, e)
    m = masses_at(b, q, 0.0)
    _, sink, _ = accelerations(b, m, u, 0.0, p, drive_torque(motion, time, u, p), False, moving(u, p))
    return sink < 0.0 and 2.0 * p <= -sink * (1.0 - e) * SETTLED_WITHIN_S


@kernel
def apply_touchdown(motion: Motion, state: Any, memory: Any, row: Any, time: float, full: bool) -> int:
    """Apply a touchdown on the collar to the state, book it, and return the regime after it.

    A striker in contact with the tool is taken to leave it; it strikes it at once if it still closes.
    """
    b = motion.breaker
    final = full or body_settles(motion, state, time)
    if memory.tool_regime in (PUSHED, BLOCKED):
        memory.tool_regime = MOVING if state.tool_m_per_s > 0.0 else STANDING
        final = final or -b.collar_restitution * b.tool_radius_m * state.body_rad_per_s <= SLOWEST_REBOUND_M_PER_S
    q, u, p = state.crank_rad, state.crank_rad_per_s, state.body_rad_per_s
    before = energies(b, q, u, state.body_rad, p)
    state.body_rad = 0.0
    after = energies(b, q, u, 0.0, p)
    memory.collar_loss_j -= after[0] + after[1] - before[0] - before[1]
    state.crank_rad_per_s, state.body_rad_per_s, impulse, loss = touchdown(
        b, q, u, 0.0, p, 0.0 if final else b.collar_restitution
    )
    row.before_m_per_s, row.after_m_per_s = b.tool_radius_m * p, b.tool_radius_m * state.body_rad_per_s
    row.impulse_ns = impulse / b.tool_radius_m
    memory.collar_loss_j += loss
    memory.impact_impulse_nms += impulse
    if final:
        row.kind = SETTLED
        return REST
    return FLIGHT


@kernel
def apply_collar_event(
    motion: Motion, state: Any, memory: Any, which: int, time: float, log: Any, count: int
) -> tuple[int, int]:
    """Let the body touch its collar or leave it; return its regime and the number of events."""
    row = log[count]
    if which == COLLAR:
        begin_row(motion, state, memory, LIFT_OFF, time, row)
        regime = FLIGHT
    else:
        begin_row(motion, state, memory, TOUCHDOWN, time, row)
        regime = apply_touchdown(motion, state, memory, row, time, count + 8 > len(log))
    log_post(motion, row, time, state, memory, regime)
    return regime, count + 1


@kernel
def at_striking_extreme(b: Breaker, q: float) -> bool:
    """Return whether of both dead centres the striking one is the nearer."""
    striking, retreating = (b.striking_crank_rad - q) % TURN, (b.retreating_crank_rad - q) % TURN
    return min(striking, TURN - striking) < min(retreating, TURN - retreating)


@kernel
def apply_dead_centre(motion: Motion, state: Any, memory: Any, regime: int, time: float, log: Any, count: int) -> int:
    """Reseat the tool where the rocker begins its pass, or tell of a pass without a blow where it ends."""
    memory.stalled = 0.0
    if not at_striking_extreme(motion.breaker, state.crank_rad):
        reseat_tool(motion.breaker, state, memory)
        return count
    if memory.pass_done != 0.0:
        return count
    begin_row(motion, state, memory, MISSED, time, log[count])
    memory.pass_done = 1.0
    memory.cycle += 1.0
    log_post(motion, log[count], time, state, memory, regime)
    return count + 1


@kernel
def apply_event(
    motion: Motion, state: Any, memory: Any, regime: int, which: int, time: float, log: Any, count: int
) -> tuple[int, int]:
    """Apply the event of a signal to state, memory and log; return the regime of the body and the number of events."""
    if count + 3 > len(log):
        raise MotionError("mb10_breaker: more than 509 events in one step; shorten coupling.step_s")
    if which == GAP:
        return apply_gap_closed(motion, state, memory, regime, time, log, count)
    if which == DEAD_CENTRE:
        return regime, apply_dead_centre(motion, state, memory, regime, time, log, count)
    if which in (LIFT, COLLAR):
        return apply_collar_event(motion, state, memory, which, time, log, count)
    return regime, apply_contact_event(motion, state, memory, regime, which, time, log, count)
