# SPDX-License-Identifier: Apache-2.0
"""The roll-out of the next moments: with the values in force it is what the run then does."""

from __future__ import annotations

import asyncio
import base64
import json
import re
from itertools import islice
from multiprocessing import active_children

import numpy as np
import pytest

from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.engine.run import continued, frames
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.nodes.run.bench_process import SPAN_S, Trials, rolled_out
from mech_twin.parameters.load import machine as load
from mech_twin.samples import EffortCommand
from mech_twin.view.bench.bench_page import OrderError
from mech_twin.view.bench.scene import framed, listed

BEFORE, AFTER = 150, 100


def sent(frame):
    """Return a frame as it reaches the bench."""
    return json.loads(json.dumps(listed(frame)))


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_a_run_goes_on_from_a_frame_told_to_the_bench_as_it_does_itself_to_the_bit(name):
    machine = load(name)
    run = frames(machine, (BEFORE + AFTER) * machine.coupling_step_s)
    at = next(islice(run, BEFORE, None))
    itself = list(run)
    told = list(continued(machine, framed(sent(at)), AFTER * machine.coupling_step_s, 1.0))
    assert len(told) == AFTER
    assert told == itself[:AFTER]


def test_a_trial_takes_its_values_begins_at_the_present_and_leaves_the_run_as_it_is():
    name = "mb10_breaker"
    machine = load(name)
    at = next(islice(frames(machine, 1.0), 600, None))
    tree = configuration_tree(machine.parameters)
    before = json.dumps(tree)
    same = rolled_out(name, tree, sent(at))
    heavier = rolled_out(name, tree | {"body": tree["body"] | {"preload_deflection_m": 0.02}}, sent(at))
    assert same["from_s"] == at.linkage.time_s
    assert same["to_s"] == pytest.approx(at.linkage.time_s + SPAN_S)
    assert same["curves"]["pins/magnitude"] == rolled_out(name, tree, sent(at))["curves"]["pins/magnitude"]
    assert same["curves"]["body/pressing_force"] != heavier["curves"]["body/pressing_force"]
    assert json.dumps(tree) == before


def test_a_trial_goes_on_with_an_effort_that_is_commanded():
    machine, effort = load("mb10_breaker"), EffortCommand(effort=12.0)
    at = next(islice(frames(machine, 1.0, lambda step: effort), 600, None))
    trial = rolled_out("mb10_breaker", configuration_tree(machine.parameters), sent(at))
    torque_nm = np.frombuffer(base64.b64decode(trial["curves"]["motor/torque"][1]), "<f4")
    assert len(torque_nm) > 10
    assert np.all(torque_nm == effort.effort)


@pytest.mark.slow
def test_a_trial_of_a_value_the_machine_refuses_is_refused_in_its_words():
    machine = load("mb10_breaker")

    async def tried():
        trials = Trials("mb10_breaker", configuration_tree(machine.parameters))
        with pytest.raises(OrderError, match="nothing runs yet"):
            await trials.tried({})
        trials.frame = sent(next(frames(machine, 0.1)))
        try:
            return [json.loads(await trials.tried({"tool.restitution": value})) for value in (7.0, 0.3)]
        finally:
            await trials.close()

    refused, answer = asyncio.run(tried())
    assert re.search(r"tool\.restitution.*7", refused["refused"])
    assert "refused" not in answer
    assert answer["cards"]


@pytest.mark.slow
def test_a_trial_whose_process_is_lost_is_refused_the_next_is_answered_and_none_outlives_the_bench():
    machine = load("mb10_breaker")

    async def tried():
        trials = Trials("mb10_breaker", configuration_tree(machine.parameters))
        trials.frame = sent(next(frames(machine, 0.1)))
        lost = asyncio.create_task(trials.tried({"tool.restitution": 0.3}))
        while not active_children():
            await asyncio.sleep(0.01)
        for process in active_children():
            process.kill()
        with pytest.raises(OrderError, match="the trial was ended"):
            await lost
        answer = json.loads(await trials.tried({"tool.restitution": 0.3}))
        await trials.close()
        return answer, active_children()

    answer, left = asyncio.run(tried())
    assert answer["cards"]
    assert left == []
