# SPDX-License-Identifier: Apache-2.0
"""The breaker's state by name: integrated variables, memory of a linkage sample, kinds of events."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.records import record_at, record_of
from mech_twin.kernels.kernel import borrowing_kernel
from mech_twin.samples import Coordinate

# kinds of events, by the order of their names
BLOW, MISSED, TOUCHDOWN, SETTLED, LIFT_OFF, OFF_COLLAR, CATCH_UP, PUSH_BEGINS, PUSHING, RELEASED, STALLED = range(11)
CRANK_STOPPED, CRANK_STARTED, CRANK_REVERSED, BODY_STOPPED, BODY_STARTED, BODY_REVERSED = range(11, 17)
GEAR_STOPPED, GEAR_STARTED, GEAR_REVERSED = range(17, 20)
KINDS = (
    "blow",
    "missed",
    "touchdown",
    "settled",
    "lift_off",
    "off_collar",
    "catch_up",
    "push_begins",
    "pushing",
    "released",
    "stalled",
    "crank_stopped",
    "crank_started",
    "crank_reversed",
    "body_stopped",
    "body_started",
    "body_reversed",
    "gear_stopped",
    "gear_started",
    "gear_reversed",
)


# coordinates and velocities of the motion, and of its laws the places in the regimes
CRANK, BODY, TOOL, CRANK_RATE, BODY_RATE, TOOL_RATE = range(6)
DRIVE_WORK, DAMPING_LOSS, ANGULAR_IMPULSE, WALL_WORK = range(6, 10)
FREEDOMS = 3
COLLAR_LAW, WALL_LAW, TOOL_LAW, CRANK_LAW, PIVOT_LAW, GEAR_LAW = range(6)
LAWS = 6


class BreakerState(NamedTuple):
    """Integrated variables: crank, body and tool, and works and angular impulse since the start of the step."""

    crank_rad: float  # against the body
    body_rad: float
    tool_m: float  # into the wall
    crank_rad_per_s: float
    body_rad_per_s: float
    tool_m_per_s: float
    drive_work_j: float
    damping_loss_j: float
    angular_impulse_nms: float  # on everything
    wall_work_j: float


class BreakerMemory(NamedTuple):
    """State of the linkage besides its joints; fields of the balances are sums since the start."""

    turns: float = 0.0
    cycle: float = 0.0
    pass_done: float = 0.0  # 1 from the blow (or the missed one) to the rocker's return
    drive_work_j: float = 0.0
    damping_loss_j: float = 0.0
    angular_impulse_nms: float = 0.0
    blow_loss_j: float = 0.0
    collar_loss_j: float = 0.0
    reseating_loss_j: float = 0.0  # what a tool that is still moving when it is reseated takes with it
    wall_work_j: float = 0.0
    coupling_defect_j: float = 0.0  # by the angle of a body that somebody else moves in place of the one it was led to
    parameter_work_j: float = 0.0  # by changes of spring, preload and gravity while running
    impact_impulse_nms: float = 0.0
    coupling_defect_nms: float = 0.0
    energy_j: float = 0.0
    energy_error_j: float = 0.0  # sum over the steps of what each left open: does not grow with the sums above
    momentum_error_nms: float = 0.0
    tool_regime: float = 0.0
    tool_travel_m: float = 0.0
    tool_speed_m_per_s: float = 0.0
    tool_force_n: float = 0.0  # of the striker
    feed_per_blow_m: float = 0.0  # the tool's travel in the last pass, taken when it was reseated
    stalled: float = 0.0  # 1 from a stall to the next extreme of the rocker
    crank_sense: float = 0.0  # of sliding in the crank's bearing, +1 or -1, 0 where friction holds it; so for the body
    body_sense: float = 0.0
    crank_friction_nm: float = 0.0  # Coulomb friction as this step ended
    body_friction_nm: float = 0.0


class EventSide(NamedTuple):
    """Coordinates before or after an event, in the order of the linkage's events."""

    crank: Coordinate
    body: Coordinate
    tool: Coordinate
    crank_bearing: Coordinate
    body_pivot: Coordinate


# records, not plain structures: their fields are attributes in plain Python too
STATE = record_of(BreakerState)
STATES = len(BreakerState._fields)
MEMORY = record_of(BreakerMemory)
# places in the memory
(
    PASS_DONE, CYCLE, STALL_TOLD, BLOW_LOSS, COLLAR_LOSS, RESEATING_LOSS, IMPACT_IMPULSE, FEED, CRANK_SENSE, BODY_SENSE,
    TOOL_REGIME,
) = (
    BreakerMemory._fields.index(name)
    for name in (
        "pass_done", "cycle", "stalled", "blow_loss_j", "collar_loss_j", "reseating_loss_j", "impact_impulse_nms",
        "feed_per_blow_m", "crank_sense", "body_sense", "tool_regime",
    )
)  # fmt: skip


@borrowing_kernel
def named(y: NDArray[np.float64]) -> Any:
    """Return the numbers of a state (10,) by name: a record that shares them."""
    return record_at(y, 0, STATE)
