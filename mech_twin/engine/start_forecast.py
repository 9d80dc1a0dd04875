# SPDX-License-Identifier: Apache-2.0
"""Forecast of whether a machine starts when it is switched on: its roles simulated ahead."""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.roles import Machine
from mech_twin.samples import LinkageSample

LOOK_AHEAD_S = 3.0
STANDING_S = 1.0
STANDING_REACH = 1e-3  # rad or m of the drive within the standing time


class StartForecast(NamedTuple):
    """Whether the drive turns at the end of the look-ahead, and its position then (rad or m)."""

    turns: bool
    position: float


def start_forecast(machine: Machine, linkage: LinkageSample, target: float) -> StartForecast:
    """Return whether a machine switched on at a sample starts.

    A drive that stays within `STANDING_REACH` for the last `STANDING_S` of `LOOK_AHEAD_S` does not turn.  One that
    rests at times in normal operation (`Machine.rests_when_supplied`) always counts as turning.

    Parameters
    ----------
    machine : Machine
        The machine; its body starts at rest on its stop.
    linkage : LinkageSample
        State of the linkage at switching on.
    target : float
        Required fraction of rated supply frequency.
    """
    frame = complete_frame(machine, linkage, None, target)
    steps = round(LOOK_AHEAD_S / machine.coupling_step_s)
    judged_from = steps - round(STANDING_S / machine.coupling_step_s)
    lowest = highest = frame.motor.position[0]
    for step in range(1, steps + 1):
        frame = next_frame(machine, frame, target)
        position = frame.motor.position[0]
        if step <= judged_from:
            lowest = highest = position
        lowest, highest = min(lowest, position), max(highest, position)
    return StartForecast(machine.rests_when_supplied or highest - lowest > STANDING_REACH, position)
