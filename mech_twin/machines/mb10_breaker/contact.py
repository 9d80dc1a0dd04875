"""What an event does to the breaker: blows and their sequels on the tool, the body on its collar, dead centres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.errors import MotionError
from mech_twin.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import (
    BLOCKED,
    FLIGHT,
    MOVING,
    PHI,
    PUSHED,
    REST,
    STANDING,
    TOOL,
    TOOL_SPEED,
    TURN,
    Breaker,
    P,
    Q,
    U,
    accelerations,
    energies,
    masses_at,
    moving,
    pushing,
    striker,
)
from mech_twin.machines.mb10_breaker.impacts import strike, touchdown
from mech_twin.machines.mb10_breaker.motion import (
    COLLAR,
    CRANK_MOTION,
    DEAD_CENTRE,
    GAP,
    LIFT,
    TOOL_MOTION,
    WALL,
    Motion,
    drive_torque,
    going_on,
    senses_now,
    torques_now,
)
from mech_twin.machines.mb10_breaker.state import (
    BLOW,
    CATCH_UP,
    LIFT_OFF,
    MISSED,
    PUSH_BEGINS,
    PUSHING,
    RELEASED,
    SETTLED,
    STALLED,
    TOUCHDOWN,
    UNSEATED,
)

Array = NDArray[np.float64]
SETTLED_WITHIN_S = 1e-10  # the rest of a chatter series that is cut off as one plastic impact
TURNING_RAD_PER_S = 1e-6  # a crank slower than this stands
ROUNDED = 1e-15  # of two speeds: what their difference may be off by
SLOWEST_REBOUND_M_PER_S = 1e-6  # so is an impact that would part striker and tool, or a pushing body and collar, slower


@kernel
def log_pre(motion: Motion, row: Any, time: float, state: Array) -> None:
    """Write crank, body, tool and the torques on them before an event in its row."""
    row.pre_crank_rad, row.pre_crank_rad_per_s = state[Q], state[U]
    row.pre_body_rad, row.pre_body_rad_per_s = state[PHI], state[P]
    row.pre_tool_m, row.pre_tool_m_per_s = state[TOOL], state[TOOL_SPEED]
    now = torques_now(motion, time, state)
    row.pre_drive_torque_nm, row.pre_tool_force_n = now.drive_nm, now.tool_force_n
    row.pre_crank_friction_nm, row.pre_body_friction_nm = now.crank_nm, now.body_nm


@kernel
def log_post(motion: Motion, row: Any, time: float, state: Array, memory: Any, regime: int) -> None:
    """Write crank, body, tool and the torques on them after an event in its row, the bearings as they go on from it."""
    row.post_crank_rad, row.post_crank_rad_per_s = state[Q], state[U]
    row.post_body_rad, row.post_body_rad_per_s = state[PHI], state[P]
    row.post_tool_m, row.post_tool_m_per_s = state[TOOL], state[TOOL_SPEED]
    now = torques_now(set_off(motion, time, state, memory, regime), time, state)
    row.post_drive_torque_nm, row.post_tool_force_n = now.drive_nm, now.tool_force_n
    row.post_crank_friction_nm, row.post_body_friction_nm = now.crank_nm, now.body_nm


@kernel
def set_off(motion: Motion, time: float, state: Array, memory: Any, regime: int) -> Motion:
    """Keep in which senses crank and body go on from a state, and return the motion that then is."""
    rests, tool = regime != FLIGHT, int(memory.tool_regime)
    senses = senses_now(motion, time, state, rests, tool)
    memory.crank_sense, memory.body_sense = senses.crank, senses.body
    return going_on(motion, senses, rests, tool)


@kernel
def project_contact(b: Breaker, state: Array, tool: int, rests: bool) -> None:
    """Take what rounding or the coupling left out of the contact between striker and tool."""
    if tool not in (PUSHED, BLOCKED):
        return
    travel, slope, _ = striker(b, state[Q])
    state[TOOL] = travel - b.tool_radius_m * state[PHI]
    if tool == PUSHED:
        state[TOOL_SPEED] = slope * state[U] - b.tool_radius_m * state[P]
    elif not rests:
        state[P] = slope * state[U] / b.tool_radius_m


@kernel
def body_settles(motion: Motion, state: Array, time: float) -> bool:
    """Return whether the bounces still to come after this touchdown last too short to be told one by one."""
    b = motion.breaker
    u, p, _, _ = touchdown(b, state[Q], state[U], 0.0, state[P], b.collar_restitution)
    m = masses_at(b, state[Q], 0.0)
    _, sink, _ = accelerations(b, m, u, 0.0, p, drive_torque(motion, time, u, p), False, moving(u, p))
    return sink < 0.0 and 2.0 * p <= -sink * (1.0 - b.collar_restitution) * SETTLED_WITHIN_S


@kernel
def approach(motion: Motion, state: Array, time: float, u: float, p: float, rests: bool) -> float:
    """Return the acceleration with which striker and moving tool would approach each other (m/s2)."""
    b = motion.breaker
    m = masses_at(b, state[Q], state[PHI])
    du, dp, _ = accelerations(b, m, u, state[PHI], p, drive_torque(motion, time, u, p), rests, moving(u, p))
    _, slope, bend = striker(b, state[Q])
    return slope * du - b.tool_radius_m * dp + bend * u * u + b.wall_force_n / b.tool_mass_kg


@kernel
def tool_restitution(motion: Motion, state: Array, time: float, rests: bool, full: bool) -> float:
    """Return e_t, or 0 for an impact whose sequels are too slow or short to be told one by one (or the log is full)."""
    b, e = motion.breaker, motion.breaker.tool_restitution
    _, slope, _ = striker(b, state[Q])
    parting = e * (slope * state[U] - b.tool_radius_m * state[P] - state[TOOL_SPEED])
    hit = strike(b, state[Q], state[U], state[PHI], state[P], state[TOOL_SPEED], rests, e)
    towards = approach(motion, state, time, hit.u, hit.p, rests and hit.p <= 0.0)
    short = towards > 0.0 and 2.0 * parting <= towards * (1.0 - e) * SETTLED_WITHIN_S
    return 0.0 if full or short or (towards > 0.0 and parting <= SLOWEST_REBOUND_M_PER_S) else e


@kernel
def apply_strike(motion: Motion, state: Array, memory: Any, regime: int, row: Any, time: float, full: bool) -> int:
    """Apply an impact of the striker on the tool to the state, book it, and return the regime of the body after it."""
    b, rests = motion.breaker, regime != FLIGHT
    e = tool_restitution(motion, state, time, rests, full)
    _, slope, _ = striker(b, state[Q])
    speed = slope * state[U] - b.tool_radius_m * state[P] - state[TOOL_SPEED]
    hit = strike(b, state[Q], state[U], state[PHI], state[P], state[TOOL_SPEED], rests, e)
    if rests and e == 0.0 and 0.0 < b.tool_radius_m * hit.p <= SLOWEST_REBOUND_M_PER_S:
        # body and striker would meet collar and tool by turns, ever slower: the limit of that series has both at rest
        hit = strike(b, state[Q], state[U], state[PHI], state[P], state[TOOL_SPEED], rests, e, True)
    row.before_m_per_s, row.after_m_per_s, row.impulse_ns = speed, -e * speed, hit.impulse
    state[U], state[P] = hit.u, hit.p
    state[TOOL_SPEED] += hit.impulse / b.tool_mass_kg
    memory.blow_loss_j += hit.loss
    memory.impact_impulse_nms += b.tool_radius_m * hit.impulse + hit.collar_nms
    regime = FLIGHT if regime == REST and hit.p > 0.0 else regime
    memory.tool_regime = MOVING
    if e == 0.0:
        now = pushing(
            b, masses_at(b, state[Q], state[PHI]), state[Q], hit.u, state[PHI], hit.p,
            drive_torque(motion, time, hit.u, hit.p), regime != FLIGHT, moving(hit.u, hit.p),
        )  # fmt: skip
        if now.tool_force_n > 0.0:
            memory.tool_regime = PUSHED
            row.kind = PUSH_BEGINS if row.kind == CATCH_UP else row.kind
        else:  # they part from a common speed: rounding must not make them close again
            state[TOOL_SPEED] += ROUNDED * (abs(slope * hit.u) + abs(b.tool_radius_m * hit.p))
    return regime


@kernel
def apply_touchdown(motion: Motion, state: Array, memory: Any, row: Any, time: float, full: bool) -> int:
    """Apply a touchdown on the collar to the state, book it, and return the regime after it.

    A striker in contact with the tool is taken to leave it; it strikes it at once if it still closes.
    """
    b = motion.breaker
    final = full or body_settles(motion, state, time)
    if memory.tool_regime in (PUSHED, BLOCKED):
        memory.tool_regime = MOVING if state[TOOL_SPEED] > 0.0 else STANDING
        final = final or -b.collar_restitution * b.tool_radius_m * state[P] <= SLOWEST_REBOUND_M_PER_S
    before = energies(b, state[Q], state[U], state[PHI], state[P])
    state[PHI] = 0.0
    after = energies(b, state[Q], state[U], 0.0, state[P])
    memory.collar_loss_j -= after[0] + after[1] - before[0] - before[1]
    u, p, impulse, loss = touchdown(b, state[Q], state[U], 0.0, state[P], 0.0 if final else b.collar_restitution)
    row.before_m_per_s, row.after_m_per_s, row.impulse_ns = (
        b.tool_radius_m * state[P],
        b.tool_radius_m * p,
        impulse / b.tool_radius_m,
    )
    state[U], state[P] = u, p
    memory.collar_loss_j += loss
    memory.impact_impulse_nms += impulse
    if final:
        row.kind = SETTLED
        return REST
    return FLIGHT


@kernel
def reseat_tool(b: Breaker, state: Array, memory: Any) -> None:
    """Take the tool back to its seat for the next pass; its travel is the feed."""
    memory.reseating_loss_j += 0.5 * b.tool_mass_kg * state[TOOL_SPEED] * state[TOOL_SPEED]
    memory.feed_per_blow_m = state[TOOL]
    state[TOOL] = state[TOOL_SPEED] = 0.0
    memory.tool_regime, memory.pass_done = STANDING, 0.0


@kernel
def at_striking_extreme(b: Breaker, q: float) -> bool:
    """Return whether of both dead centres the striking one is the nearer."""
    striking, retreating = (b.striking_crank_rad - q) % TURN, (b.retreating_crank_rad - q) % TURN
    return min(striking, TURN - striking) < min(retreating, TURN - retreating)


@kernel
def begin_row(motion: Motion, state: Array, memory: Any, kind: int, time: float, row: Any) -> None:
    """Write an event's row but for what the event changes."""
    row.time_s, row.kind, row.cycle = time, kind, memory.cycle
    row.before_m_per_s = row.after_m_per_s = row.impulse_ns = 0.0
    log_pre(motion, row, time, state)


@kernel
def log_knot(motion: Motion, state: Array, memory: Any, regime: int, time: float, log: Any, count: int) -> int:
    """Log a state within the pushing of the tool, between which the moment on a free body is a line."""
    if regime != FLIGHT or count + 8 > len(log):
        return count
    begin_row(motion, state, memory, PUSHING, time, log[count])
    log_post(motion, log[count], time, state, memory, regime)
    return count + 1


@kernel
def apply_gap_closed(
    motion: Motion, state: Array, memory: Any, regime: int, time: float, log: Any, count: int
) -> tuple[int, int]:
    """Apply the blow of a pass, or a later impact on the tool; return regime and number of events."""
    first = memory.pass_done == 0.0
    _, slope, _ = striker(motion.breaker, state[Q])
    if slope * state[U] - motion.breaker.tool_radius_m * state[P] - state[TOOL_SPEED] < 0.0:
        return regime, count  # a touch within rounding that already opens
    if first and regime == FLIGHT:  # the body is off its collar: the tool is not pressed on the wall
        begin_row(motion, state, memory, UNSEATED, time, log[count])
        log_post(motion, log[count], time, state, memory, regime)
        count += 1
    row = log[count]
    begin_row(motion, state, memory, BLOW if first else CATCH_UP, time, row)
    regime = apply_strike(motion, state, memory, regime, row, time, count + 8 > len(log))
    memory.pass_done = 1.0
    memory.cycle += 1.0 if first else 0.0
    log_post(motion, row, time, state, memory, regime)
    return regime, count + 1


@kernel
def apply_stop(motion: Motion, state: Array, memory: Any, regime: int, time: float, log: Any, count: int) -> int:
    """Bring the crank to rest on the tool; told once a pass."""
    if regime != FLIGHT:
        state[U] = 0.0
    if memory.stalled == 0.0:
        begin_row(motion, state, memory, STALLED, time, log[count])
        log_post(motion, log[count], time, state, memory, regime)
        count += 1
    memory.stalled = 1.0
    return count


@kernel
def apply_tool_stop(motion: Motion, state: Array, memory: Any, regime: int, time: float, log: Any, count: int) -> int:
    """Bring the tool to rest: the wall holds it under the striker, unless that turns back at its extreme."""
    state[TOOL_SPEED] = 0.0
    if motion.tool != PUSHED:
        memory.tool_regime = STANDING
        return count
    if motion.rests and state[U] > TURNING_RAD_PER_S:
        memory.tool_regime = STANDING
        begin_row(motion, state, memory, RELEASED, time, log[count])
        log_post(motion, log[count], time, state, memory, regime)
        return count + 1
    memory.tool_regime = BLOCKED
    count = log_knot(motion, state, memory, regime, time, log, count)
    return apply_stop(motion, state, memory, regime, time, log, count) if motion.rests else count


@kernel
def apply_dead_centre(motion: Motion, state: Array, memory: Any, regime: int, time: float, log: Any, count: int) -> int:
    """Reseat the tool where the rocker begins its pass, or tell of a pass without a blow where it ends."""
    memory.stalled = 0.0
    if not at_striking_extreme(motion.breaker, state[Q]):
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
def apply_collar_event(
    motion: Motion, state: Array, memory: Any, which: int, time: float, log: Any, count: int
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
def apply_contact_event(
    motion: Motion, state: Array, memory: Any, regime: int, which: int, time: float, log: Any, count: int
) -> int:
    """Let crank or tool stop, the striker leave the tool, or the wall give way; return the number of events."""
    if which == TOOL_MOTION:
        return apply_tool_stop(motion, state, memory, regime, time, log, count)
    if which == CRANK_MOTION:
        return apply_stop(motion, state, memory, regime, time, log, count)
    if which == WALL:
        memory.tool_regime = PUSHED
        return log_knot(motion, state, memory, regime, time, log, count)
    memory.tool_regime = MOVING if state[TOOL_SPEED] > 0.0 else STANDING
    begin_row(motion, state, memory, RELEASED, time, log[count])
    log_post(motion, log[count], time, state, memory, regime)
    return count + 1


@kernel
def apply_event(
    motion: Motion, state: Array, memory: Any, regime: int, which: int, time: float, log: Any, count: int
) -> tuple[int, int]:
    """Apply the event of a signal to state, memory and log; return the regime of the body and the number of events."""
    if count + 3 > len(log):
        raise MotionError("mb10_breaker: the log of events of one step is full; shorten coupling.step_s")
    if which == GAP:
        return apply_gap_closed(motion, state, memory, regime, time, log, count)
    if which == DEAD_CENTRE:
        return regime, apply_dead_centre(motion, state, memory, regime, time, log, count)
    if which in (LIFT, COLLAR):
        return apply_collar_event(motion, state, memory, which, time, log, count)
    return regime, apply_contact_event(motion, state, memory, regime, which, time, log, count)
