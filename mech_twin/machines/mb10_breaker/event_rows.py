# SPDX-License-Identifier: Apache-2.0
"""Rows of the breaker's log of events: state and torques on both sides of an event."""

from __future__ import annotations

from typing import Any

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import (
    FLIGHT,
)
from mech_twin.machines.mb10_breaker.motion import (
    Motion,
    going_on,
    senses_now,
    torques_now,
)
from mech_twin.machines.mb10_breaker.state import (
    PUSHING,
)


@kernel
def log_pre(motion: Motion, row: Any, time: float, state: Any) -> None:
    """Write crank, body, tool and the torques on them before an event in its row."""
    row.pre_crank_rad, row.pre_crank_rad_per_s = state.crank_rad, state.crank_rad_per_s
    row.pre_body_rad, row.pre_body_rad_per_s = state.body_rad, state.body_rad_per_s
    row.pre_tool_m, row.pre_tool_m_per_s = state.tool_m, state.tool_m_per_s
    now = torques_now(motion, time, state)
    row.pre_drive_torque_nm, row.pre_tool_force_n = now.drive_nm, now.tool_force_n
    row.pre_crank_friction_nm, row.pre_body_friction_nm = now.crank_nm, now.body_nm


@kernel
def log_post(motion: Motion, row: Any, time: float, state: Any, memory: Any, regime: int) -> None:
    """Write crank, body, tool and the torques on them after an event in its row, the bearings as they go on from it."""
    row.post_crank_rad, row.post_crank_rad_per_s = state.crank_rad, state.crank_rad_per_s
    row.post_body_rad, row.post_body_rad_per_s = state.body_rad, state.body_rad_per_s
    row.post_tool_m, row.post_tool_m_per_s = state.tool_m, state.tool_m_per_s
    now = torques_now(set_off(motion, time, state, memory, regime), time, state)
    row.post_drive_torque_nm, row.post_tool_force_n = now.drive_nm, now.tool_force_n
    row.post_crank_friction_nm, row.post_body_friction_nm = now.crank_nm, now.body_nm


@kernel
def set_off(motion: Motion, time: float, state: Any, memory: Any, regime: int) -> Motion:
    """Keep in which senses crank and body go on from a state, and return the motion that then is."""
    rests, tool = regime != FLIGHT, int(memory.tool_regime)
    going = going_on(motion, time, state, senses_now(motion, time, state, rests, tool), rests, tool, True)
    memory.crank_sense, memory.body_sense = going.senses.crank, going.senses.body
    return going


@kernel
def begin_row(motion: Motion, state: Any, memory: Any, kind: int, time: float, row: Any) -> None:
    """Write an event's row but for what the event changes."""
    row.time_s, row.kind, row.cycle = time, kind, memory.cycle
    row.before_m_per_s = row.after_m_per_s = row.impulse_ns = 0.0
    log_pre(motion, row, time, state)


@kernel
def log_knot(motion: Motion, state: Any, memory: Any, regime: int, time: float, log: Any, count: int) -> int:
    """Log a state within the pushing of the tool, between which the moment on a free body is a line."""
    if regime != FLIGHT or count + 8 > len(log):
        return count
    begin_row(motion, state, memory, PUSHING, time, log[count])
    log_post(motion, log[count], time, state, memory, regime)
    return count + 1
