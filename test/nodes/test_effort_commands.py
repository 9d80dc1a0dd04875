# SPDX-License-Identifier: Apache-2.0
"""Commands of effort and position over topics: obeyed, recorded, played back, computed again to the bit; or refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from bench_run import BenchRun
from catalogue import built
from std_msgs.msg import Float64, Float64MultiArray

from mech_twin.engine.coupling import effort_limit
from mech_twin.engine.run import frames
from mech_twin.messages.topics import EFFORT_COMMAND, POSITION_COMMAND, SPEED_COMMAND
from mech_twin.nodes.roles.answering_nodes import MotorNode
from mech_twin.nodes.roles.recorder_node import RecorderNode
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_samples import BagSamples
from mech_twin.samples import EffortCommand, LinkageSample
from mech_twin.studies.resimulation import ConfigurationHistory, resimulated

pytestmark = pytest.mark.usefixtures("ros_domain")


def asked_in(run: BenchRun) -> EffortCommand | float | None:
    return run.node("motor").target


@pytest.mark.parametrize("name", ["impact_mass", "mb10_breaker", "roller_former"])
def test_a_run_under_all_commands_is_recorded_and_computed_again_to_the_bit(name: str, tmp_path: Path) -> None:
    effort = 0.4 * effort_limit(built(name))
    held = (1.5, 3.0, 0.25)
    with BenchRun(name, recorder=True, stream_rate_hz=20.0) as run:
        run.add(RecorderNode(name, tmp_path / "bag", built(name).parameters, run.options))
        run.steps(20)
        run.publisher(EFFORT_COMMAND).publish(Float64(data=effort))
        run.until(lambda: asked_in(run) == EffortCommand(effort))
        run.steps(30)
        run.publisher(POSITION_COMMAND).publish(Float64MultiArray(data=list(held)))
        run.until(lambda: asked_in(run) == EffortCommand(0.0, *held))
        run.steps(30)
        run.publisher(SPEED_COMMAND).publish(Float64(data=0.5))
        run.until(lambda: asked_in(run) == 0.5)
        run.steps(30)
        run.linkage.done = True
        run.spin_for(0.2)
        samples: list[LinkageSample] = list(run.samples)
    with BagReader(tmp_path / "bag") as reader:
        bag = BagSamples(reader)
        history = ConfigurationHistory(bag.descriptions(), "bag")
        recorded = {step.step: step.motor for step in bag.steps()}
        verdict = resimulated(bag.steps(), history.machine_at)
        commands = {channel for channel in reader.topics if channel.endswith("_command")}
    assert verdict.identical and verdict.missing_steps == 0 and not verdict.taken_up
    assert commands == {f"/{name}/motor/{kind}_command" for kind in ("speed", "effort", "position")}
    told = {motor.asked for motor in recorded.values() if motor is not None}
    assert told == {None, EffortCommand(effort), EffortCommand(0.0, *held)}
    speeds = dict.fromkeys(recorded, 1.0)
    back = max(step for step, motor in recorded.items() if motor is not None and motor.asked is not None)
    speeds |= {step: 0.5 for step in recorded if step > back}

    def command(step: int) -> EffortCommand | float:
        motor = recorded.get(step)
        return speeds.get(step, 0.5) if motor is None or motor.asked is None else motor.asked

    alone = [frame.linkage for frame in frames(built(name), samples[-1].time_s, command)]
    assert samples == alone[: len(samples)]


def test_a_motor_that_comes_back_goes_on_with_the_effort_it_was_asked_for() -> None:
    with BenchRun("impact_mass", peer_timeout_s=0.3) as run:
        run.steps(20)
        run.publisher(EFFORT_COMMAND).publish(Float64(data=-3.0))
        run.until(lambda: asked_in(run) == EffortCommand(-3.0))
        run.steps(20)
        run.kill("motor")
        run.revive(MotorNode)
        run.steps(20)
        assert asked_in(run) == EffortCommand(-3.0)


@pytest.mark.parametrize(
    ("name", "topic", "message", "reason"),
    [
        ("winding_drum", EFFORT_COMMAND, Float64(data=1.0), "takes no effort command"),
        ("impact_mass", EFFORT_COMMAND, Float64(data=1e9), "an effort within"),
        ("impact_mass", POSITION_COMMAND, Float64MultiArray(data=[1e308, 1e308, 1e308]), "a position within"),
        ("impact_mass", EFFORT_COMMAND, Float64(data=float("nan")), "effort nan"),
        ("impact_mass", POSITION_COMMAND, Float64MultiArray(data=[1.0]), "position, stiffness, damping"),
        ("impact_mass", POSITION_COMMAND, Float64MultiArray(data=[1.0, -1.0, 0.0]), "stiffness and damping 0 to"),
    ],
)
def test_what_a_motor_cannot_give_is_counted_with_the_reason_and_not_used(
    name: str, topic: object, message: object, reason: str
) -> None:
    with BenchRun(name) as run:
        run.steps(5)
        motor, told = run.node("motor"), []
        count = motor.statistics.count
        motor.statistics.count = lambda *what: (told.append(what), count(*what))
        run.publisher(topic).publish(message)
        run.until(lambda: motor.statistics.total[topic.name, "malformed"] == 1)
        run.steps(20)
        assert reason in next(what[2] for what in told if what[0] == topic.name)
        assert asked_in(run) == 1.0
