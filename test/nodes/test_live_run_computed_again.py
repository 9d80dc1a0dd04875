# SPDX-License-Identifier: Apache-2.0
"""A live run, with all that a user does to it, comes out the same when its recording is computed again."""

from __future__ import annotations

from pathlib import Path

import pytest
from bench_run import BenchRun
from catalogue import NAMES, built
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from mech_twin.messages.topics import SPEED_COMMAND
from mech_twin.nodes.roles.recorder_node import RecorderNode
from mech_twin.parameters.errors import keys
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_samples import BagSamples
from mech_twin.studies.resimulation import ConfigurationHistory, Verdict, analysed, resimulated

pytestmark = pytest.mark.usefixtures("ros_domain")


def recorded_run(name: str, directory: Path) -> None:
    """Record a run whose supply is turned down, whose parameters change twice, and which is reset."""
    with BenchRun(name, recorder=True, stream_rate_hz=20.0) as run:
        run.add(RecorderNode(name, directory, built(name).parameters, run.options))
        run.steps(30)
        run.publisher(SPEED_COMMAND).publish(Float64(data=0.7))
        run.steps(30)
        live = next(key for key in keys(built(name).parameters) if key.live and isinstance(key.value, float))
        for factor in (0.99, 0.98):
            results = run.set_parameters("linkage", **{live.name.replace(".", "__"): live.value * factor})
            assert results[0].successful, results[0].reason
            run.steps(30)
        assert run.call(Trigger, "reset", Trigger.Request()).success
        run.until(lambda: any(event.kind == "reset" for sample in run.samples for event in sample.events))
        run.steps(30)
        run.linkage.done = True
        run.spin_for(0.2)


def computed_again(bag: Path) -> tuple[Verdict, Verdict, ConfigurationHistory]:
    with BagReader(bag) as reader:
        samples = BagSamples(reader)
        history = ConfigurationHistory(samples.descriptions(), str(bag))
        forces = analysed(samples.steps(), history.machine_at)
        return resimulated(samples.steps(), history.machine_at), forces, history


@pytest.mark.parametrize("name", NAMES)
def test_a_live_run_computed_again_is_identical(name: str, tmp_path: Path) -> None:
    recorded_run(name, tmp_path / "bag")
    run, forces, history = computed_again(tmp_path / "bag")
    assert run.first is None
    assert run.identical and forces.identical
    assert (history.changes, run.resets, run.missing_steps, run.taken_up) == (2, 1, 0, [])
    assert run.steps >= 150
