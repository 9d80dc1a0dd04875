# SPDX-License-Identifier: Apache-2.0
"""What happens between striker and tool: the blow and its sequels, the tool's stop, its wall, its release."""

from __future__ import annotations

from typing import Any

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.accelerations import accelerations, moving, pushing
from mech_twin.machines.mb10_breaker.dynamics import (
    BLOCKED,
    FLIGHT,
    MOVING,
    PUSHED,
    REST,
    STANDING,
    Breaker,
    masses_at,
    striker,
)
from mech_twin.machines.mb10_breaker.event_rows import begin_row, log_knot, log_post, set_off
from mech_twin.machines.mb10_breaker.impacts import Blow, strike
from mech_twin.machines.mb10_breaker.motion import (
    COLLAR,
    CRANK_MOTION,
    TOOL_MOTION,
    WALL,
    Motion,
    drive_torque,
    force_signals,
    forces_now,
    going_on,
    senses_now,
)
from mech_twin.machines.mb10_breaker.state import (
    BLOW,
    CATCH_UP,
    OFF_COLLAR,
    PUSH_BEGINS,
    RELEASED,
    STALLED,
)
from mech_twin.machines.mb10_breaker.wave_blow import strike_as_wave

SETTLED_WITHIN_S = 1e-10  # the rest of a chatter series that is cut off as one plastic impact
TURNING_RAD_PER_S = 1e-6  # a crank slower than this stands
ROUNDED = 1e-15  # of two speeds: what their difference may be off by
SLOWEST_REBOUND_M_PER_S = 1e-6  # so is an impact that would part striker and tool, or a pushing body and collar, slower


@kernel
def project_contact(b: Breaker, state: Any, tool: int, rests: bool) -> None:
    """Take what rounding or the coupling left out of the contact between striker and tool."""
    if tool not in (PUSHED, BLOCKED):
        return
    travel, slope, _ = striker(b, state.crank_rad)
    state.tool_m = travel - b.tool_radius_m * state.body_rad
    if tool == PUSHED:
        state.tool_m_per_s = slope * state.crank_rad_per_s - b.tool_radius_m * state.body_rad_per_s
    elif not rests:
        state.body_rad_per_s = slope * state.crank_rad_per_s / b.tool_radius_m


@kernel
def approach(motion: Motion, state: Any, time: float, u: float, p: float, rests: bool) -> float:
    """Return the acceleration with which striker and moving tool would approach each other (m/s2)."""
    b = motion.breaker
    m = masses_at(b, state.crank_rad, state.body_rad)
    du, dp, _ = accelerations(b, m, u, state.body_rad, p, drive_torque(motion, time, u, p), rests, moving(u, p))
    _, slope, bend = striker(b, state.crank_rad)
    return slope * du - b.tool_radius_m * dp + bend * u * u + b.wall_force_n / b.tool_mass_kg


@kernel
def closing_speed(b: Breaker, state: Any) -> float:
    """Return the speed with which the striker approaches the tool (m/s)."""
    _, slope, _ = striker(b, state.crank_rad)
    return float(slope * state.crank_rad_per_s - b.tool_radius_m * state.body_rad_per_s - state.tool_m_per_s)


@kernel
def impact_on_tool(b: Breaker, state: Any, rests: bool, e: float, stays: bool) -> Blow:
    """Return the impact of the striker on the tool in a state; see `strike`."""
    q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    return strike(b, q, u, phi, p, state.tool_m_per_s, rests, e, stays)


@kernel
def tool_restitution(motion: Motion, state: Any, time: float, rests: bool, full: bool) -> float:
    """Return e_t, or 0 for an impact whose sequels are too slow or short to be told one by one (or the log is full)."""
    b, e = motion.breaker, motion.breaker.tool_restitution
    parting = e * closing_speed(b, state)
    hit = impact_on_tool(b, state, rests, e, False)
    towards = approach(motion, state, time, hit.u, hit.p, rests and hit.p <= 0.0)
    short = towards > 0.0 and 2.0 * parting <= towards * (1.0 - e) * SETTLED_WITHIN_S
    return 0.0 if full or short or (towards > 0.0 and parting <= SLOWEST_REBOUND_M_PER_S) else e


@kernel
def apply_strike(motion: Motion, state: Any, memory: Any, regime: int, row: Any, time: float, full: bool) -> int:
    """Apply an impact of the striker on the tool to the state, book it, and return the regime of the body after it."""
    b, rests = motion.breaker, regime != FLIGHT
    e = tool_restitution(motion, state, time, rests, full)
    speed = closing_speed(b, state)
    hit = impact_on_tool(b, state, rests, e, False)
    if rests and e == 0.0 and 0.0 < b.tool_radius_m * hit.p <= SLOWEST_REBOUND_M_PER_S:
        # body and striker would meet collar and tool by turns, ever slower: the limit of that series has both at rest
        hit = impact_on_tool(b, state, rests, e, True)
    if b.waves and e > 0.0:
        seated = rests or state.tool_m_per_s > 0.0
        q, u, phi, p = state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
        hit = strike_as_wave(b, q, u, phi, p, state.tool_m_per_s, rests, seated)
    row.before_m_per_s, row.after_m_per_s, row.impulse_ns = speed, hit.closing, hit.impulse
    state.crank_rad_per_s, state.body_rad_per_s = hit.u, hit.p
    state.tool_m += hit.tool_travel
    state.tool_m_per_s = hit.tool_speed
    memory.blow_loss_j += hit.loss
    memory.impact_impulse_nms += b.tool_radius_m * hit.impulse + hit.collar_nms
    regime = FLIGHT if regime == REST and hit.p > 0.0 else regime
    memory.tool_regime = MOVING if state.tool_m_per_s > 0.0 or not b.waves else STANDING
    if hit.together:
        stay_together(motion, state, memory, regime, row, time)
    return regime


@kernel
def stay_together(motion: Motion, state: Any, memory: Any, regime: int, row: Any, time: float) -> None:
    """After an impact that leaves striker and tool one speed: let the striker push the tool, or part from it."""
    b, q, u, phi, p = motion.breaker, state.crank_rad, state.crank_rad_per_s, state.body_rad, state.body_rad_per_s
    drive = drive_torque(motion, time, u, p)
    if pushing(b, masses_at(b, q, phi), q, u, phi, p, drive, regime != FLIGHT, moving(u, p)).tool_force_n > 0.0:
        memory.tool_regime = PUSHED
        row.kind = PUSH_BEGINS if row.kind == CATCH_UP else row.kind
    else:  # they part from a common speed: rounding must not make them close again
        _, slope, _ = striker(b, q)
        state.tool_m_per_s += ROUNDED * (abs(slope * u) + abs(b.tool_radius_m * p))


@kernel
def comes_to_stand(motion: Motion, state: Any, regime: int, time: float) -> bool:
    """Return whether a striker that meets a standing tool this slowly stands there with the crank.

    Else striker and body would meet tool and collar by turns, each round a share of the one before: the limit of that
    series has all at rest, where the wall holds more than the crank pushes, and the collar still holds the body.
    """
    b, u = motion.breaker, state.crank_rad_per_s
    slow = 0.0 < closing_speed(b, state) <= SLOWEST_REBOUND_M_PER_S
    if regime != REST or state.tool_m_per_s != 0.0 or not slow:
        return False
    state.crank_rad_per_s = 0.0
    still = going_on(motion, time, state, senses_now(motion, time, state, True, BLOCKED), True, BLOCKED, True)
    thrust, collar = forces_now(still, time, state).tool_force_n, force_signals(still, COLLAR, time, state)[0]
    state.crank_rad_per_s = u
    return 0.0 < thrust < b.wall_force_n and collar > 0.0


@kernel
def apply_stand(b: Breaker, state: Any, memory: Any, row: Any) -> None:
    """Bring the crank to rest on a tool that its wall holds, the body on its collar, and book what that takes."""
    m, u = masses_at(b, state.crank_rad, state.body_rad), state.crank_rad_per_s
    speed = closing_speed(b, state)
    row.before_m_per_s, row.after_m_per_s, row.impulse_ns = speed, 0.0, m.m11 * u * u / speed
    state.crank_rad_per_s, memory.tool_regime = 0.0, BLOCKED
    memory.blow_loss_j += 0.5 * m.m11 * u * u
    memory.impact_impulse_nms -= m.m12 * u  # of tool and collar together


@kernel
def reseat_tool(b: Breaker, state: Any, memory: Any) -> None:
    """Take the tool back to its seat for the next pass; its travel is the feed."""
    memory.reseating_loss_j += 0.5 * b.tool_mass_kg * state.tool_m_per_s * state.tool_m_per_s
    memory.feed_per_blow_m = state.tool_m
    state.tool_m = state.tool_m_per_s = 0.0
    memory.tool_regime, memory.pass_done = STANDING, 0.0


@kernel
def apply_gap_closed(
    motion: Motion, state: Any, memory: Any, regime: int, time: float, log: Any, count: int
) -> tuple[int, int]:
    """Apply the blow of a pass, or a later impact on the tool; return regime and number of events."""
    first = memory.pass_done == 0.0
    if closing_speed(motion.breaker, state) < 0.0:
        return regime, count  # a touch within rounding that already opens
    if first and regime == FLIGHT:  # the body is off its collar: the tool is not pressed on the wall
        begin_row(motion, state, memory, OFF_COLLAR, time, log[count])
        log_post(motion, log[count], time, state, memory, regime)
        count += 1
    row = log[count]
    begin_row(motion, state, memory, BLOW if first else CATCH_UP, time, row)
    stands = comes_to_stand(motion, state, regime, time)
    if stands:
        apply_stand(motion.breaker, state, memory, row)
    else:
        regime = apply_strike(motion, state, memory, regime, row, time, count + 8 > len(log))
    memory.pass_done = 1.0
    memory.cycle += 1.0 if first else 0.0
    log_post(motion, row, time, state, memory, regime)
    if stands:
        still = set_off(motion, time, state, memory, regime)
        return regime, apply_stop(still, state, memory, regime, time, log, count + 1)
    return regime, count + 1


@kernel
def apply_stop(motion: Motion, state: Any, memory: Any, regime: int, time: float, log: Any, count: int) -> int:
    """Bring the crank to rest on the tool; told once a pass."""
    if regime != FLIGHT:
        state.crank_rad_per_s = 0.0
    if memory.stalled == 0.0:
        begin_row(motion, state, memory, STALLED, time, log[count])
        log_post(motion, log[count], time, state, memory, regime)
        count += 1
    memory.stalled = 1.0
    return count


@kernel
def leaves_held_body(motion: Motion, state: Any, memory: Any, regime: int, time: float) -> bool:
    """Return whether a striker that turns back leaves a body which its pivot's friction held: it does not follow."""
    if motion.senses.body != 0.0:
        return False
    memory.tool_regime = BLOCKED
    return forces_now(set_off(motion, time, state, memory, regime), time, state).tool_force_n <= 0.0


@kernel
def apply_tool_stop(motion: Motion, state: Any, memory: Any, regime: int, time: float, log: Any, count: int) -> int:
    """Bring the tool to rest: the wall holds it under the striker, unless that turns back at its extreme."""
    state.tool_m_per_s = 0.0
    if motion.tool != PUSHED:
        memory.tool_regime = STANDING
        return count
    turns = abs(state.crank_rad_per_s) > TURNING_RAD_PER_S
    if turns and (motion.rests or leaves_held_body(motion, state, memory, regime, time)):
        memory.tool_regime = STANDING
        begin_row(motion, state, memory, RELEASED, time, log[count])
        log_post(motion, log[count], time, state, memory, regime)
        return count + 1
    memory.tool_regime = BLOCKED
    count = log_knot(motion, state, memory, regime, time, log, count)
    return apply_stop(motion, state, memory, regime, time, log, count) if motion.rests else count


@kernel
def apply_contact_event(
    motion: Motion, state: Any, memory: Any, regime: int, which: int, time: float, log: Any, count: int
) -> int:
    """Let crank or tool stop, the striker leave the tool, or the wall give way; return the number of events."""
    if which == TOOL_MOTION:
        return apply_tool_stop(motion, state, memory, regime, time, log, count)
    if which == CRANK_MOTION:
        return apply_stop(motion, state, memory, regime, time, log, count)
    if which == WALL:
        memory.tool_regime = PUSHED
        return log_knot(motion, state, memory, regime, time, log, count)
    memory.tool_regime = MOVING if state.tool_m_per_s > 0.0 else STANDING
    begin_row(motion, state, memory, RELEASED, time, log[count])
    log_post(motion, log[count], time, state, memory, regime)
    return count + 1
