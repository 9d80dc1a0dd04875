# SPDX-License-Identifier: Apache-2.0
"""No number of any machine's samples depends on the coupling step, samples after blows and stops included."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from catalogue import NAMES
from crank_drives import PRESS_KLOSS, VIBRATION_CRANK_KLOSS

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine
from mech_twin.samples import Frame

CASES = [(name, {}) for name in NAMES] + [
    ("mb10_breaker", {"drive_mount": "body", "tool.wall_force_n": 20e3}),
    ("vibration_crank", VIBRATION_CRANK_KLOSS),
    ("compaction_press", PRESS_KLOSS),
]
DURATION_S, WITHIN = 1.0, 1e-7  # of the largest value of a column
NEAR_EVENT_S = 1e-9  # a force that jumps just at a sample is told before or after the jump
# sums over the events or the time of one step
OF_A_STEP = {
    "blow_impulse_on_body_nms", "crank_bearing_impulse_ns", "rocker_bearing_impulse_ns", "collar_impulse_nms",
    "stop_loss_j", "stop_impulse_ns", "drive_work_j",
}  # fmt: skip


def columns(frame: Frame) -> dict[str, float]:
    """Return every number of a frame that belongs to its instant; a prescribed motor tells its next speed."""
    found = {"moment on the body": frame.forces.body_moment_nm}
    for role in ("linkage", "motor", "body"):
        sample = getattr(frame, role)
        for kind in ("position", "velocity", "effort") if sample is not None else ():
            for joint, value in zip(sample.joints, getattr(sample, kind), strict=True):
                found[f"{role} {joint} {kind}"] = value
    for pin, wrench in zip(frame.forces.pins, frame.forces.wrenches, strict=True):
        found |= {f"{pin} {name}": value for name, value in zip(wrench._fields, wrench, strict=True)}
    quantities = frame.forces.quantities.as_dict()
    return found | {name: value for name, value in quantities.items() if name not in OF_A_STEP}


@pytest.mark.parametrize(("name", "overrides"), CASES)
def test_half_the_step_gives_the_same_numbers(name, overrides):
    step_s = machine(name).coupling_step_s
    coarse = list(frames(machine(name, overrides=overrides), DURATION_S))
    fine = list(frames(machine(name, overrides={**overrides, "coupling.step_s": 0.5 * step_s}), DURATION_S))
    at_event = {
        round(event.time_s / step_s)
        for frame in fine
        for event in frame.linkage.events
        if abs(event.time_s / step_s - round(event.time_s / step_s)) * step_s < NEAR_EVENT_S
    }
    pairs = [
        (columns(a), columns(b)) for i, (a, b) in enumerate(zip(coarse, fine[::2], strict=True)) if i not in at_event
    ]
    assert len(pairs) > 0.9 * len(coarse)
    for column in pairs[0][0]:
        if name == "winding_drum" and column == "motor motor velocity":
            continue
        one, other = (np.array([pair[k][column] for pair in pairs]) for k in (0, 1))
        off = np.abs(one - other)
        if column.endswith("position"):
            off = np.minimum(off, np.abs(off - 2.0 * pi))
        assert off.max() <= WITHIN * np.abs(other).max(), column


@pytest.mark.parametrize("name", ["mb10_breaker", "roller_former", "vibration_crank", "config/pages/four_bar.yaml"])
def test_half_the_step_gives_the_same_motion_while_the_supply_rises(name):
    """Each step ends with the command that was told as it began: none is ahead of its time."""
    rising = {"supply.initial_fraction": 0.0, "supply.rate_per_s": 2.0}
    rising |= VIBRATION_CRANK_KLOSS if name == "vibration_crank" else {}
    angles = []
    for share in (1.0, 0.5):
        step_s = {"coupling.step_s": share * machine(name).coupling_step_s}
        *_, last = frames(machine(name, overrides=rising | step_s), 0.4)
        angles.append(np.array(last.linkage.position))
    off = np.abs(angles[0] - angles[1])
    assert np.minimum(off, np.abs(off - 2.0 * pi)).max() <= (
        1e-4 if name.endswith("yaml") else 1e-8
    )  # a page takes its mean
