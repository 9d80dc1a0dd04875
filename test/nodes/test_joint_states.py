# SPDX-License-Identifier: Apache-2.0
"""Joint state topics hold joints and nothing else, at their rate, and are what the engine computed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from bench_run import BenchRun
from catalogue import NAMES, built
from recordings import decoded_messages, simulated_bag
from sensor_msgs.msg import JointState

from mech_twin.engine.run import frames
from mech_twin.messages.topics import EVERY, full_name, has_impact, joint_state_topics
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.run.composition import run_in_process
from mech_twin.samples import Frame

pytestmark = pytest.mark.usefixtures("ros_domain")
FIELDS = {
    "joint_states": "linkage",
    "motor/joint_states": "motor",
    "forces/joint_states": "forces",
    "body/joint_states": "body",
}
RUN_S = 0.3


def step_of(message: JointState, step_s: float) -> int:
    return round((message.header.stamp.sec + message.header.stamp.nanosec * 1e-9) / step_s)


def content(
    topic: str, frame: Frame
) -> tuple[tuple[str, ...], tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Return names and columns that a topic should show of a frame."""
    sample: Any = getattr(frame, FIELDS[topic])
    if topic != "forces/joint_states":
        return sample.joints, sample.position, sample.velocity, sample.effort
    names = [f"{pin}/{part}" for pin in sample.pins for part in ("force_x_n", "force_y_n", "moment_nm")]
    efforts = [number for wrench in sample.wrenches for number in wrench]
    zeros = (0.0,) * (len(efforts) + len(sample.quantities.values))
    return (*names, *sample.quantities.names), zeros, zeros, (*efforts, *sample.quantities.values)


class Listener:
    """A node that knows ROS 2 and nothing of the twin."""

    def __init__(self, run: BenchRun) -> None:
        self.heard: dict[str, list[JointState]] = {}
        for topic in joint_state_topics(built(run.name).body is not None):
            rows = self.heard.setdefault(topic.name, [])
            run.client.create_subscription(JointState, full_name(run.name, topic), rows.append, EVERY)

    def least(self) -> int:
        return min(map(len, self.heard.values()))


@pytest.mark.parametrize("name", NAMES)
def test_a_listener_sees_the_joints_of_the_engine_at_the_stream_s_rate(name: str) -> None:
    with BenchRun(name) as run:
        listener = Listener(run)
        run.until(lambda: listener.least() >= 20)
        step_s = built(name).coupling_step_s
        last = max(step_of(rows[-1], step_s) for rows in listener.heard.values())
        expected = list(frames(built(name), last * step_s))
        for topic, rows in listener.heard.items():
            steps = [step_of(message, step_s) for message in rows]
            assert steps == sorted(set(steps))
            begins = [step for step in steps if step % 10 == 0]
            assert begins == list(range(begins[0], begins[-1] + 1, 10))
            for step, message in zip(steps, rows, strict=True):
                columns = (tuple(message.name), *map(tuple, (message.position, message.velocity, message.effort)))
                assert columns == content(topic, expected[step])


def test_at_the_rate_of_the_steps_every_step_is_there() -> None:
    with BenchRun("winding_drum", stream_rate_hz=1000.0) as run:
        listener = Listener(run)
        run.until(lambda: listener.least() >= 50)
        for rows in listener.heard.values():
            steps = [step_of(message, 0.001) for message in rows]
            assert steps == list(range(steps[0], steps[0] + len(steps)))


@pytest.mark.parametrize("name", ["impact_mass", "mb10_breaker"])
def test_a_slow_stream_has_the_samples_on_both_sides_of_every_impact(name: str, tmp_path: Path) -> None:
    duration_s = 0.7
    options = RunOptions(pace="max", duration_s=duration_s, recorder=True, exclusive=False, stream_rate_hz=5.0)
    run_in_process(name, built(name).parameters, options, tmp_path / "bag", None)
    struck = [f.linkage.step for f in frames(built(name), duration_s) if has_impact(f.linkage.events)]
    assert struck
    for topic in joint_state_topics(built(name).body is not None):
        rows = decoded_messages(tmp_path / "bag", full_name(name, topic))
        steps = {step_of(message, 0.001) for message in rows}
        assert {step + side for step in struck for side in (-1, 0)} <= steps
        assert len(steps) < 650


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_run_and_a_simulation_record_the_same_joint_states(name: str, tmp_path: Path) -> None:
    options = RunOptions(pace="max", duration_s=RUN_S, recorder=True, exclusive=False)
    run_in_process(name, built(name).parameters, options, tmp_path / "run", None)
    simulated_bag(name, RUN_S, tmp_path / "simulated")
    for topic in joint_state_topics(built(name).body is not None):
        full = full_name(name, topic)
        run, simulated = (decoded_messages(tmp_path / bag, full) for bag in ("run", "simulated"))
        assert len(run) > 25
        assert run == simulated
