# SPDX-License-Identifier: Apache-2.0
"""What a user does to a running machine: commands, services, live parameters."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Literal, get_args, get_origin

import pytest
from bench_run import BenchRun
from catalogue import NAMES, built
from rcl_interfaces.srv import DescribeParameters
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from mech_twin.engine.run import frames
from mech_twin.messages.topics import SPEED_COMMAND
from mech_twin.nodes.roles.answering_nodes import MotorNode
from mech_twin.nodes.roles.recorder_node import RecorderNode
from mech_twin.parameters.description import description
from mech_twin.parameters.errors import keys
from mech_twin.recording.bag_reader import BagReader

pytestmark = pytest.mark.usefixtures("ros_domain")
CRANK = "vibration_crank"


def test_the_speed_command_is_followed_at_its_rate() -> None:
    with BenchRun(CRANK) as run:
        run.steps(20)
        run.publisher(SPEED_COMMAND).publish(Float64(data=0.5))
        run.until(lambda: math.isclose(run.samples[-1].command, 0.5))
        commands = [sample.command for sample in run.samples]
        step_s = built(CRANK).coupling_step_s
        rate = built(CRANK).parameters.supply.rate_per_s
        assert max(abs(b - a) for a, b in itertools.pairwise(commands)) <= rate * step_s * (1 + 1e-12)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -0.1, 1.0 + 1e-9, 1.2])
def test_a_command_outside_its_range_is_counted_and_not_used(bad: float) -> None:
    with BenchRun(CRANK) as run:
        run.steps(5)
        run.publisher(SPEED_COMMAND).publish(Float64(data=bad))
        motor = run.node("motor")
        run.until(lambda: motor.statistics.total[SPEED_COMMAND.name, "malformed"] == 1)
        run.steps(50)
        assert run.samples[-1].command == 1.0


def test_stop_takes_the_supply_away_and_start_gives_it_back() -> None:
    with BenchRun(CRANK) as run:
        run.steps(5)
        assert run.call(Trigger, "stop", Trigger.Request()).success
        run.until(lambda: run.samples[-1].command == 0.0)
        assert run.call(Trigger, "start", Trigger.Request()).success
        run.until(lambda: run.samples[-1].command == 1.0)


def test_a_motor_that_comes_back_stopped_starts_at_the_last_command() -> None:
    with BenchRun(CRANK, peer_timeout_s=0.3) as run:
        run.steps(5)
        run.publisher(SPEED_COMMAND).publish(Float64(data=0.5))
        run.until(lambda: run.node("motor").target == 0.5)
        assert run.call(Trigger, "stop", Trigger.Request()).success
        run.steps(20)
        run.kill("motor")
        run.revive(MotorNode)
        run.steps(20)
        assert run.node("motor").target == 0.0
        assert run.call(Trigger, "start", Trigger.Request()).success
        assert run.node("motor").target == 0.5


def test_reset_begins_anew_while_time_goes_on() -> None:
    with BenchRun(CRANK) as run:
        run.steps(50)
        assert run.call(Trigger, "reset", Trigger.Request()).success
        run.until(lambda: any(event.kind == "reset" for sample in run.samples for event in sample.events))
        at = next(i for i, sample in enumerate(run.samples) if sample.events and sample.events[0].kind == "reset")
        run.steps(30)
        fresh = [frame.linkage for frame in frames(built(CRANK), 0.02)]
        for offset, expected in enumerate(fresh[:20]):
            again = run.samples[at + offset]
            assert again.position == expected.position
            assert again.step == run.samples[at].step + offset


@pytest.mark.slow
def test_a_pause_takes_no_step_and_leaves_the_run_as_it_would_have_been() -> None:
    with BenchRun(CRANK) as run:
        run.steps(20)
        assert run.call(SetBool, "pause", SetBool.Request(data=True)).message == "paused"
        taken = len(run.samples)
        run.spin_for(1.0)  # longer than a peer may be silent
        assert len(run.samples) == taken
        assert run.linkage.diagnostics.state == "paused"
        assert not any(kind == "timeout" for node in run.nodes for _, kind in node.statistics.total)
        assert run.call(SetBool, "pause", SetBool.Request(data=False)).success
        run.steps(20)
        alone = [frame.linkage for frame in frames(built(CRANK), 0.05)]
        for sample in run.samples[: len(alone)]:
            assert sample.position == alone[sample.step].position


def test_a_recording_of_a_paused_run_counts_nothing_as_late(tmp_path: Path) -> None:
    with BenchRun(CRANK, recorder=True) as run:
        recorder = RecorderNode(CRANK, tmp_path / "bag", built(CRANK).parameters, run.options)
        run.add(recorder)
        run.steps(20)
        assert run.call(SetBool, "pause", SetBool.Request(data=True)).success
        run.until(lambda: recorder.statistics.total["step/linkage", "repeated"] > 0)  # a waiting run repeats its step
        assert run.call(SetBool, "pause", SetBool.Request(data=False)).success
        run.steps(20)
        run.linkage.done = True
        run.spin_for(0.2)
    with BagReader(tmp_path / "bag") as reader:
        counters = reader.info.counters
        assert {(row["late"], row["missed"], row["dropped"]) for row in counters.values()} == {(0, 0, 0)}


def test_a_live_parameter_takes_effect_at_the_next_step_in_all_roles() -> None:
    with BenchRun("impact_mass") as run:
        run.steps(20)
        assert run.set_parameters("linkage", restitution=0.5)[0].successful
        run.until(lambda: run.linkage.revision == 2)
        run.steps(20)
        described = description(run.linkage.description)
        assert described.revision == 2
        assert described.parameters.restitution == 0.5
        for role in ("motor", "force_analysis"):
            node = run.node(role)
            assert node.machine.parameters == described.parameters
            assert node.get_parameter("restitution").value == 0.5


def test_a_bad_value_is_refused_with_a_reason_and_changes_nothing() -> None:
    with BenchRun("impact_mass") as run:
        run.steps(5)
        result = run.set_parameters("linkage", restitution=1.5)[0]
        assert not result.successful
        assert "restitution" in result.reason
        assert run.linkage.get_parameter("restitution").value == built("impact_mass").parameters.restitution


def test_a_parameter_is_changed_on_the_linkage_only() -> None:
    with BenchRun("impact_mass") as run:
        run.steps(5)
        result = run.set_parameters("motor", restitution=0.5)[0]
        assert not result.successful
        assert "linkage" in result.reason


def test_a_parameter_that_is_not_live_is_read_only() -> None:
    with BenchRun("impact_mass") as run:
        run.steps(5)
        assert not run.set_parameters("linkage", period_s=1.0)[0].successful


@pytest.mark.parametrize("name", NAMES)
def test_every_parameter_is_described_with_its_unit(name: str) -> None:
    with BenchRun(name) as run:
        known = {key.name: key for key in keys(built(name).parameters) if key.value is not None}
        request = DescribeParameters.Request(names=list(known))
        for described in run.call(DescribeParameters, "linkage/describe_parameters", request).descriptors:
            key = known[described.name]
            assert described.description
            assert described.read_only is not key.live
            if isinstance(key.value, float):
                assert described.description.endswith("]"), described.name
            bounds = [f"{bound.ge:g}" for bound in key.field.metadata if hasattr(bound, "ge")]
            assert all(f">= {bound}" in described.additional_constraints for bound in bounds), described.name


@pytest.mark.parametrize("node", ["linkage", "motor"])
def test_simulation_time_may_be_asked_for_while_running_and_changes_nothing(node: str) -> None:
    with BenchRun(CRANK) as run:
        run.steps(10)
        for wanted in (True, False):
            assert run.set_parameters(node, use_sim_time=wanted)[0].successful
            run.steps(30)
        assert run.linkage.revision == 1
        expected = [frame.linkage for frame in frames(built(CRANK), run.samples[-1].time_s)]
        assert run.samples == expected[: len(run.samples)]


def test_a_parameter_of_ros_beside_a_live_one_is_no_reason_to_refuse_it() -> None:
    with BenchRun("impact_mass") as run:
        run.steps(10)
        results = run.set_parameters("linkage", use_sim_time=True, restitution=0.5)
        assert [result.successful for result in results] == [True, True]
        run.until(lambda: run.linkage.machine.parameters.restitution == 0.5)


@pytest.mark.parametrize("name", NAMES)
def test_the_words_a_parameter_may_have_stand_in_its_description(name: str) -> None:
    with BenchRun(name) as run:
        every = [*keys(built(name).parameters), *(key for key in keys(run.options, "run."))]
        words = {
            key.name: get_args(key.field.annotation) for key in every if get_origin(key.field.annotation) is Literal
        }
        assert "run.pace" in words
        request = DescribeParameters.Request(names=list(words))
        for described in run.call(DescribeParameters, "linkage/describe_parameters", request).descriptors:
            for word in words[described.name]:
                assert str(word) in described.description
                assert str(word) in described.additional_constraints
