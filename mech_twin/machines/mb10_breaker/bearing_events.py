# SPDX-License-Identifier: Apache-2.0
"""What happens in the breaker's bearings: crank and body come to rest, stay held, are let go, turn back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.bearing_friction import rubs, sign
from mech_twin.machines.mb10_breaker.dynamics import BLOCKED, FLIGHT, PUSHED, Breaker, Senses
from mech_twin.machines.mb10_breaker.event_rows import begin_row, log_post, set_off
from mech_twin.machines.mb10_breaker.motion import (
    BODY_GRIP,
    BODY_TURN,
    CRANK_GRIP,
    CRANK_MOTION,
    CRANK_TURN,
    WALL,
    Motion,
)
from mech_twin.machines.mb10_breaker.state import (
    BODY_STOPPED,
    CRANK_STOPPED,
)


@kernel
def starting(b: Breaker, state: Any, memory: Any, rests: bool, tool: int) -> Senses:
    """Return, and keep, the senses with which a coupling step begins: of what moves its own, else the last one's."""
    if not rubs(b):
        memory.crank_sense = memory.body_sense = 1.0
    elif tool != BLOCKED or rests:
        crank = sign(state.crank_rad_per_s) if state.crank_rad_per_s != 0.0 else memory.crank_sense
        body = sign(state.body_rad_per_s) if state.body_rad_per_s != 0.0 else memory.body_sense
        memory.crank_sense = crank if b.crank_coulomb_nm > 0.0 else 1.0
        memory.body_sense = 0.0 if rests else body if b.body_coulomb_nm > 0.0 else 1.0
    return Senses(memory.crank_sense, memory.body_sense)


@kernel
def watch_bearings(motion: Motion, state: Any, last: int, watches: NDArray[np.int64], count: int) -> int:
    """Add what can happen in the bearings: what slides comes to rest, what is held is let go; return the number."""
    b, senses, u = motion.breaker, motion.senses, state.crank_rad_per_s
    blocked, standing = motion.tool == BLOCKED, motion.tool == BLOCKED and motion.rests
    pushes = motion.tool in (PUSHED, BLOCKED)
    if senses.crank == 0.0 and not standing:
        watches[count, 0] = CRANK_GRIP
        count += 1
    elif (b.crank_coulomb_nm > 0.0 or blocked) and not standing and not (pushes and (u > 0.0 or last == WALL)):
        watches[count, 0], watches[count, 2] = CRANK_TURN, 1 if u == 0.0 else 0
        count += 1
    if not motion.rests and b.body_coulomb_nm > 0.0 and (not blocked or (u < 0.0 and senses.body != 0.0)):
        watches[count, 0] = BODY_GRIP if senses.body == 0.0 else BODY_TURN
        watches[count, 2] = 1 if senses.body != 0.0 and state.body_rad_per_s == 0.0 else 0
        count += 1
    return count


@kernel
def is_bearing_event(which: int) -> bool:
    """Return whether an event changes nothing but the sense of sliding."""
    return which in (CRANK_TURN, CRANK_GRIP, BODY_TURN, BODY_GRIP)


@kernel
def apply_bearing_event(motion: Motion, state: Any, which: int, rests: bool) -> None:
    """Bring to rest what has come to rest within rounding."""
    stops = which == CRANK_TURN or (which == CRANK_MOTION and rubs(motion.breaker))
    if stops:
        state.crank_rad_per_s = 0.0
    if which == BODY_TURN or (stops and (motion.gear_stands or (motion.tool == BLOCKED and not rests))):
        state.body_rad_per_s = 0.0
    if which == BODY_TURN and motion.gear_stands:
        state.crank_rad_per_s = 0.0


@kernel
def change(before: float, after: float, stopped: int) -> int:
    """Return the kind of event in which a joint at rest changes its sense, ``stopped`` being the first of its three."""
    return stopped if after == 0.0 else stopped + 1 if before == 0.0 else stopped + 2


@kernel
def log_bearings(motion: Motion, state: Any, memory: Any, regime: int, time: float, log: Any, count: int) -> int:
    """Let the joints that stand after an event go on in the senses that are borne out, and log what changes so."""
    b, before = motion.breaker, motion.senses
    if not rubs(b):
        return count
    set_off(motion, time, state, memory, regime)
    crank = state.crank_rad_per_s == 0.0 and b.crank_coulomb_nm > 0.0
    if crank and memory.crank_sense != before.crank and count + 3 <= len(log):
        begin_row(motion, state, memory, change(before.crank, memory.crank_sense, CRANK_STOPPED), time, log[count])
        log_post(motion, log[count], time, state, memory, regime)
        count += 1
    flying = regime == FLIGHT and not motion.rests
    turns = state.body_rad_per_s == 0.0 or (motion.tool == BLOCKED and int(memory.tool_regime) == BLOCKED)
    if flying and turns and memory.body_sense != before.body and b.body_coulomb_nm > 0.0 and count + 3 <= len(log):
        begin_row(motion, state, memory, change(before.body, memory.body_sense, BODY_STOPPED), time, log[count])
        log_post(motion, log[count], time, state, memory, regime)
        count += 1
    return count
