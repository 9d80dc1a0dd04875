# SPDX-License-Identifier: Apache-2.0
"""The machines that hidden runs are made of are those of the product, though they share no code with it."""

from __future__ import annotations

import numpy as np
import pytest
from studies.identification.independent_driven_machines import DRIVEN_BENCHES
from studies.identification.independent_machines import BENCHES, hidden_draw

from mech_twin.studies.named_rollouts import rollout

ROUNDING = 1e-9  # of the size of a column
EVERY = {**BENCHES, **DRIVEN_BENCHES}
COUPLED = {"roller_former": 1e-3, "mb10_breaker": 1e-3}  # the motor's torque is exchanged once a step
JUMPS = {
    "forces.drive_force_n": 0.06,
    "forces.dynamic_torque_nm": 1e-3,
    "linkage.drive.velocity": 0.01,
    "forces.coupling_moment_nm": 0.01,
}  # share of samples beside which it jumps


@pytest.mark.parametrize(
    "label", [pytest.param(label, marks=pytest.mark.slow) if label in COUPLED else label for label in EVERY]
)
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_the_reference_moves_as_the_machine_does(label: str, seed: int | None) -> None:
    bench = EVERY[label]
    rounding = COUPLED.get(label, ROUNDING)
    numbers = {**bench.configured, **({} if seed is None else hidden_draw(bench, seed).true)}
    names = [sensor.column for sensor in bench.sensors]
    changed = {**bench.settings, **{key: numbers[key] for key in bench.keys}}
    run = rollout(bench.machine, bench.duration_s, changed, columns=names)
    shown = bench.motion(numbers, bench.duration_s)
    for name in names:
        off = run[name] - shown(name, run["time_s"])
        if name.endswith("position"):
            off = off - 2.0 * np.pi * np.round(off / (2.0 * np.pi))
        beyond = np.abs(off) > rounding * np.ptp(run[name])
        assert np.mean(beyond) <= JUMPS.get(name, 0.0), name


def test_a_draw_is_the_same_again_and_tells_no_noise() -> None:
    first, again = (hidden_draw(BENCHES["vibration_crank"], 3) for _ in range(2))
    assert first.true == again.true
    assert all("sigma" not in channel for channel in first.map_tree()["channels"])
    assert max(abs(first.true[key] / first.bench.configured[key] - 1.0) for key in first.true) <= 0.5
