# SPDX-License-Identifier: Apache-2.0
"""A run has the first frame and one for each step of its duration, every one from the frame before it."""

from dataclasses import replace
from itertools import pairwise

import pytest
from catalogue import built

from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.engine.run import frames, rated, steps_for, warm_up

STEP_S = 0.001  # of the vibration crank's coupling


@pytest.fixture(scope="module")
def crank():
    machine = built("vibration_crank")
    assert machine.coupling_step_s == STEP_S
    return machine


@pytest.mark.parametrize(("duration_s", "steps"), [(0.0, 0), (0.0004, 0), (0.0006, 1), (0.0494, 49), (1.0, 1000)])
def test_a_duration_is_the_nearest_whole_number_of_steps(crank, duration_s, steps):
    assert steps_for(crank, duration_s) == steps


def test_the_command_nobody_gives_is_rated_supply():
    assert [rated(step) for step in (0, 1, 1000)] == [1.0, 1.0, 1.0]


def test_a_run_begins_at_the_start_and_each_frame_follows_from_the_one_before(crank):
    run = list(frames(crank, 0.005))
    assert [frame.linkage.step for frame in run] == [0, 1, 2, 3, 4, 5]
    assert run[0] == complete_frame(crank, crank.linkage.start(), None, 1.0)
    for before, after in pairwise(run):
        assert after == next_frame(crank, before, 1.0)


def test_the_command_of_each_step_is_asked_for_by_its_number(crank):
    asked = []

    def target(step):
        asked.append(step)
        return 1.0 if step == 2 else 0.0

    commands = [frame.motor.command for frame in frames(crank, 0.004, target)]
    assert asked == [0, 1, 2, 3, 4]
    moved = [after - before for before, after in pairwise(commands)]
    assert moved[1] > 0.0 > moved[2]


def test_warming_up_leaves_a_run_as_it_was(crank):
    cold = list(frames(built("vibration_crank"), 0.003))
    warm_up(crank)
    assert list(frames(crank, 0.003)) == cold


def test_warming_up_takes_a_step_through_every_role():
    """What is compiled late is late in the first step of a run over topics."""

    class Counting:
        def __init__(self, role):
            self.role, self.calls = role, []

        def __getattr__(self, name):
            self.calls.append(name)
            return getattr(self.role, name)

    machine = built("mb10_breaker")
    names = ("linkage", "motor", "forces", "body")
    counted = {name: Counting(getattr(machine, name)) for name in names}
    warm_up(replace(machine, **counted))
    assert counted["linkage"].calls == ["start", "advance"]
    assert counted["motor"].calls == ["respond", "respond"]
    assert counted["forces"].calls == ["analyse", "analyse"]
    assert counted["body"].calls == ["start", "follow"]
