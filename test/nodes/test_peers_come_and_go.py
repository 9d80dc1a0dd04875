# SPDX-License-Identifier: Apache-2.0
"""A peer that is gone is waited for, one that comes back rejoins, and the run is the same as if it had stayed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from bench_run import BenchRun
from catalogue import built
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.step_message import motor as motor_messages
from mech_twin.messages.step_message import set_stamp
from mech_twin.messages.topics import STEP_LINKAGE, STEP_MOTOR
from mech_twin.nodes.roles.answering_nodes import MotorNode
from mech_twin.nodes.roles.linkage_node import LinkageNode
from mech_twin.nodes.roles.recorder_node import RecorderNode
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_samples import BagSamples
from mech_twin.samples import LinkageSample

pytestmark = pytest.mark.usefixtures("ros_domain")


def by_step(samples: list[LinkageSample]) -> list[LinkageSample]:
    """Return the samples once each; a linkage that came back repeats its last."""
    return list({sample.step: sample for sample in samples}.values())


def test_a_run_over_the_middleware_goes_on_as_if_the_linkage_had_not_left() -> None:
    """The other roles, and every moment: `test_schedules`."""
    with BenchRun("winding_drum", peer_timeout_s=0.2) as run:
        run.steps(40)
        run.kill("linkage")
        run.revive(LinkageNode)
        run.steps(40)
        samples = by_step(run.samples)
        duration_s = samples[-1].time_s
        assert samples == [frame.linkage for frame in frames(built("winding_drum"), duration_s)][: len(samples)]


@pytest.mark.parametrize("name", ["mb10_breaker", "winding_drum"])
def test_a_run_whose_linkage_and_motor_end_together_begins_anew(name: str) -> None:
    """Also behind the force analysis, which passes steps on to the body and has not ended."""
    with BenchRun(name, peer_timeout_s=0.2) as run:
        run.steps(40)
        run.kill("motor")
        run.kill("linkage")
        run.samples.clear()
        run.revive(MotorNode)
        run.revive(LinkageNode)
        run.steps(40)
        assert run.samples == [frame.linkage for frame in frames(built(name), run.samples[-1].time_s)]


def test_a_recording_that_goes_on_through_a_new_run_keeps_the_first_one_whole(tmp_path: Path) -> None:
    """The steps of both lay one between the other, as the time of the recording began anew with the run."""
    drum = "winding_drum"
    with BenchRun(drum, peer_timeout_s=0.2, recorder=True) as run:
        run.add(recorder := RecorderNode(drum, tmp_path / "bag", built(drum).parameters, run.options))
        run.steps(40)
        run.kill("motor")
        run.kill("linkage")
        run.spin_for(0.3)
        steps = run.samples[-1].step + 1
        run.revive(MotorNode)
        run.revive(LinkageNode)
        run.steps(40)
        run.spin_for(0.3)
        assert not recorder.statistics.total["step/linkage", "late"]
    with BagReader(tmp_path / "bag") as reader:
        first = [step.linkage for step in BagSamples(reader).steps()]
        of_both = reader.topics[f"/{drum}/step/linkage"].message_count
    assert first == [frame.linkage for frame in frames(built(drum), 1.0)][:steps]
    assert of_both >= steps + 40


def test_the_linkage_holds_and_says_for_whom() -> None:
    with BenchRun("winding_drum", peer_timeout_s=0.2) as run:
        run.steps(10)
        run.kill("motor")
        run.until(lambda: run.linkage.diagnostics.state == "waiting for motor")
        held = len(run.samples)
        run.spin_for(0.3)
        assert len(run.samples) == held
        run.revive(MotorNode)
        run.steps(10)
        assert run.linkage.diagnostics.state.startswith("running")


def strange_motor(sample: LinkageSample, **changes: Any) -> JointState:
    joints = built("winding_drum").motor.joints
    zeros = (0.0,) * len(joints)
    message = JointState(name=list(joints), position=zeros, velocity=zeros, effort=zeros)
    set_stamp(message.header, sample.time_s)
    for key, value in changes.items():
        setattr(message, key, value)
    return message


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({"effort": [float("nan")]}, "malformed"),
        ({"effort": [float("inf")]}, "malformed"),
        ({"effort": []}, "malformed"),
        ({"name": ["somebody"]}, "malformed"),
        ({}, "late"),
    ],
)
def test_a_stranger_on_the_motor_topic_is_counted_and_changes_nothing(changes: dict[str, Any], kind: str) -> None:
    with BenchRun("winding_drum") as run:
        run.steps(50)
        publisher = run.publisher(STEP_MOTOR)
        publisher.publish(strange_motor(run.samples[10], **changes))
        run.until(lambda: run.linkage.statistics.total[STEP_MOTOR.name, kind] >= 1)
        run.steps(50)
        expected = [frame.linkage for frame in frames(built("winding_drum"), run.samples[-1].time_s)]
        assert run.samples == expected[: len(run.samples)]


def test_a_second_motor_is_noticed() -> None:
    kinds = ("unknown_source", "conflicting", "late")
    with BenchRun("winding_drum") as run:
        run.steps(20)
        publisher = run.publisher(STEP_MOTOR)
        run.steps(1)
        role = built("winding_drum").motor
        answer = role.respond(run.samples[-1], 1.0)
        other = answer._replace(effort=tuple(value + 1.0 for value in answer.effort))
        total = run.linkage.statistics.total
        before = sum(total[STEP_MOTOR.name, kind] for kind in kinds)
        publisher.publish(motor_messages.to_message(other._replace(step=run.samples[-1].step)))
        run.until(lambda: sum(total[STEP_MOTOR.name, kind] for kind in kinds) > before)


def test_joint_states_that_are_garbled_are_never_answered() -> None:
    with BenchRun("winding_drum") as run:
        run.steps(20)
        publisher = run.publisher(STEP_LINKAGE)
        for bad in (JointState(), JointState(name=["crank", "crank"]), JointState(name=["x"], position=[1.0])):
            publisher.publish(bad)
        motor = run.node("motor")
        run.until(lambda: motor.statistics.total[STEP_LINKAGE.name, "malformed"] >= 3)
        run.steps(20)
        expected = [frame.linkage for frame in frames(built("winding_drum"), run.samples[-1].time_s)]
        assert run.samples == expected[: len(run.samples)]
