# SPDX-License-Identifier: Apache-2.0
"""What happens in the breaker's gear while the body flies: its shaft comes to stand, is let go, turns back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.events import FALLING, RISING
from mech_twin.engine.integration import SHORTEST_S
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import BLOCKED
from mech_twin.machines.mb10_breaker.event_rows import begin_row, log_post, set_off
from mech_twin.machines.mb10_breaker.motion import GEAR_GRIP, GEAR_TURNS, Motion, gear_speed
from mech_twin.machines.mb10_breaker.state import GEAR_REVERSED, GEAR_STARTED, GEAR_STOPPED

SMALL_KINK = 1e-5  # of the crank's momentum


@kernel
def watch_gear(motion: Motion, state: Any, end: Any, watches: NDArray[np.int64], count: int) -> int:
    """Add the gear to what is watched: letting go where it stands, else where its speed has changed sign."""
    before, after = gear_speed(motion.breaker, state), gear_speed(motion.breaker, end)
    if motion.gear_stands:
        watches[count, 0], watches[count, 1], watches[count, 2] = GEAR_GRIP, FALLING, 0
        return count + 1
    if motion.breaker.efficiency < 1.0 and before * after < 0.0:
        watches[count, 0], watches[count, 1], watches[count, 2] = GEAR_TURNS, FALLING if before > 0.0 else RISING, 0
        return count + 1
    return count


@kernel
def until_torque_turns(motion: Motion, time: float, u: float, span: float) -> float:
    """Return the length (s) of a substep, which ends where the motor's torque passes zero and with it the gear's loss.

    There the torque on the crank has a kink, whose impulse a method of order 8 misses in part; a kink of next to no
    impulse beside the crank's momentum is let be.
    """
    b, left = motion.breaker, -1.0
    if motion.slope_nm_per_s != 0.0 and b.efficiency < 1.0:
        left = -motion.torque_nm / motion.slope_nm_per_s - time
    bent = b.ratio * abs(motion.slope_nm_per_s) * (1.0 / b.efficiency - b.efficiency) * span * span / 8.0
    sharp = bent > SMALL_KINK * (b.crank.inertia_kg_m2 + b.rotor_11_kg_m2) * abs(u)
    return left if SHORTEST_S < left < span and sharp else span


@kernel
def project_gear(motion: Motion, state: Any) -> None:
    """Take what rounding left out of the speed of a gear that stands."""
    if motion.gear_stands:
        state.crank_rad_per_s = motion.breaker.frame_drive * state.body_rad_per_s


@kernel
def log_gear(
    motion: Motion, state: Any, memory: Any, regime: int, which: int, time: float, log: Any, count: int
) -> int:
    """Let the gear stand where its loss holds it, and log what the moment on a flying body makes of that."""
    if motion.rests or motion.tool == BLOCKED or count + 3 > len(log):
        return count
    begin_row(motion, state, memory, GEAR_STARTED if which == GEAR_GRIP else GEAR_REVERSED, time, log[count])
    if which == GEAR_TURNS:
        turning = state.crank_rad_per_s
        state.crank_rad_per_s = motion.breaker.frame_drive * state.body_rad_per_s
        if set_off(motion, time, state, memory, regime).gear_stands:
            log[count].kind = GEAR_STOPPED
        else:
            state.crank_rad_per_s = turning
    log_post(motion, log[count], time, state, memory, regime)
    return count + 1
