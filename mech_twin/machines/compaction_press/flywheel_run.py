# SPDX-License-Identifier: Apache-2.0
"""Time run of the press under a constant torque with a flywheel: the proof of the flywheel's size."""

from __future__ import annotations

from math import copysign, pi
from typing import NamedTuple

from mech_twin.engine.crank_state import Transmission
from mech_twin.machines.compaction_press.cycle import (
    WORK_POSITIONS,
    mean_torque,
    press_cycle,
)
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.machines.compaction_press.roles import press_linkage
from mech_twin.parts.flywheel import start_speed
from mech_twin.samples import MotorSample


class FlywheelRun(NamedTuple):
    """What a time run shows: non-uniformity (1), smallest and largest speed (rad/s), drift of speed over a turn (1)."""

    non_uniformity: float
    speed_min_rad_per_s: float
    speed_max_rad_per_s: float
    drift: float


def flywheel_run(parameters: CompactionPress, inertia_kg_m2: float, step_s: float = 1e-4) -> FlywheelRun:
    """Return the speed's range over one turn under the constant mean torque with this flywheel (kg m2).

    The run is integrated in time by the same kernels as the twin's, and starts on the energy curve that just touches
    w_m (1 + delta/2); nothing of the sizing's closed form enters it but that first speed.
    """
    press, stroke = press_constants(parameters, fitted=False)
    speed, delta = parameters.drive.speed_rad_per_s, parameters.flywheel.non_uniformity
    cycle = press_cycle(press, stroke, speed, WORK_POSITIONS)
    first = start_speed(cycle.work_j, cycle.inertia_kg_m2, delta, abs(speed), inertia_kg_m2)
    linkage = press_linkage(
        press,
        stroke,
        step_s,
        copysign(first, speed),
        1.0,
        speed,
        "contact",
        Transmission(1.0, 1.0, inertia_kg_m2),
    )
    torque = mean_torque(press, stroke, speed)
    sample = linkage.start()
    crank = sample.joint("crank")
    speeds = [abs(crank.velocity)]
    while abs(crank.position) < 2.0 * pi:
        before = crank
        motor = MotorSample(sample.step, sample.time_s, ("motor",), (0.0,), (0.0,), (torque,), 1.0)
        sample = linkage.advance(sample, motor, None)
        crank = sample.joint("crank")
        speeds.append(abs(crank.velocity))
        speeds += [abs(at_event.velocity) for event in sample.events for at_event in event.pre]
    share = (2.0 * pi - abs(before.position)) / (abs(crank.position) - abs(before.position))
    end = abs(before.velocity) + share * (abs(crank.velocity) - abs(before.velocity))
    low, high = min(speeds), max(speeds)
    return FlywheelRun(2.0 * (high - low) / (high + low), low, high, end / first - 1.0)
