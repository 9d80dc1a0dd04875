# SPDX-License-Identifier: Apache-2.0
"""However messages are delayed, doubled and overtaken, and whoever restarts or is replaced, a run has the same bits."""

from __future__ import annotations

import pytest
from scheduled_run import NAME, STEPS, ScheduledRun, run_schedules
from simulated_ros import simulated_ros

pytestmark = pytest.mark.usefixtures("ros_domain")
SCHEDULES, SEEDS = 40, 10


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [*((NAME, seed) for seed in range(SEEDS)), ("winding_drum", 0)])
def test_every_schedule_gives_the_engines_bits(name: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run_schedules(seed, SCHEDULES, monkeypatch, name) >= SCHEDULES * STEPS - 1


def test_a_seed_gives_the_same_schedules_again(monkeypatch: pytest.MonkeyPatch) -> None:
    clocks = []
    for _ in range(2):
        with simulated_ros(7, monkeypatch) as network:
            run = ScheduledRun(network)
            for _ in range(5):
                run.schedule()
            clocks.append((network.now_s, run.steps))
    assert clocks[0] == clocks[1]
