# SPDX-License-Identifier: Apache-2.0
"""Steps have the same bits whoever sends them: nodes of one process, nodes elsewhere, a user's own, in any mixture."""

from __future__ import annotations

import signal
import subprocess
import threading
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import pytest
from bench_run import BenchRun
from catalogue import built
from command_line import mech_twin
from process_run import parameter_file, program
from sensor_msgs.msg import JointState
from step_samples import PARTS, recorded_samples

from mech_twin.engine.coupling import next_body
from mech_twin.engine.run import frames
from mech_twin.messages.step_message import body as body_messages
from mech_twin.messages.step_message import force as force_messages
from mech_twin.messages.step_message import linkage as linkage_messages
from mech_twin.messages.step_message import motor as motor_messages
from mech_twin.messages.topics import STEP_BODY, STEP_FORCES, STEP_LINKAGE, STEP_MOTOR, Topic, full_name
from mech_twin.nodes.exchange import spinner
from mech_twin.nodes.exchange.base_node import TwinNode
from mech_twin.nodes.roles.answering_nodes import BodyNode, ForceNode, MotorNode
from mech_twin.nodes.roles.linkage_node import LinkageNode
from mech_twin.nodes.roles.recorder_node import QUIET_S, RecorderNode
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_samples import BagSamples
from mech_twin.samples import Frame

pytestmark = pytest.mark.usefixtures("ros_domain")
NAME = "mb10_breaker"
STEPS = 150
UNDER_WAY = 2  # steps at the end of a run that not everybody has answered
STALL = {"repeated", "timeout", "late"}  # what is counted, and harmless, where the machine itself stalls
MAKERS: dict[str, Callable[..., Any]] = {
    "motor": MotorNode,
    "force_analysis": ForceNode,
    "body": BodyNode,
    "linkage": LinkageNode,
}
PART = {"motor": "motor", "force_analysis": "forces", "body": "body", "linkage": "linkage"}
STEP_OF = {"motor": STEP_MOTOR, "force_analysis": STEP_FORCES, "body": STEP_BODY, "linkage": STEP_LINKAGE}


class MixedRun(BenchRun):
    """Some roles of a machine on a bench, the others in processes of their own; a recorder here, there or nowhere."""

    limit_s = 60.0  # a process has to start

    def __init__(self, folder: Path, apart: Collection[str] = (), recorder: str = "") -> None:
        super().__init__(NAME, recorder=bool(recorder), peer_timeout_s=0.3, exclusive=False)
        self.folder, self.bag = folder, folder / "bag"
        self.heard: dict[str, list[Any]] = {role: [] for role in PART}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        for role in apart:
            self.kill(role)
        for node in self.nodes:
            self._watch(node)
        if recorder == "here":
            self.add(RecorderNode(NAME, self.bag, built(NAME).parameters, self.options))
        self._parameters = parameter_file(folder, built(NAME), self.options)
        for role in apart:
            self.start(role)
        if recorder == "elsewhere":
            self.start("recorder", "--directory", str(self.bag))

    def _watch(self, node: Any) -> None:
        if hasattr(self, "heard") and node.get_name() in PART:
            node.on_sample = self.heard[node.get_name()].append

    def start(self, role: str, *arguments: str) -> None:
        """Start a role in a process of its own."""
        self._processes[role] = subprocess.Popen(program(role, self._parameters, *arguments))

    def end(self, role: str) -> None:
        """End the process of a role as a power cut would, once it has sent its answers (docs/proof/reliability.md)."""
        process = self._processes.pop(role)
        time.sleep(0.05)  # one killed while it sends keeps a lock, on which a participant that ends soon may crash
        process.kill()
        process.wait()

    def stall(self, role: str) -> subprocess.Popen[bytes]:
        """Give the process of a role no time, once it has taken what it was sent; return it."""
        process = self._processes.pop(role)
        time.sleep(0.05)  # one that stands still with a lock keeps others from sending (docs/proof/reliability.md)
        process.send_signal(signal.SIGSTOP)
        return process

    def revive_here(self, role: str) -> None:
        """Bring a role back into this process."""
        self._watch(self.revive(MAKERS[role]))

    def steps_of(self, role: str, number: int = STEPS) -> None:
        """Spin until a role has taken so many further steps here."""
        goal = len(self.heard[role]) + number
        self.until(lambda: len(self.heard[role]) >= goal)

    def check(self) -> None:
        """Compare what every role here sent with the engine's, bit by bit."""
        last = max(samples[-1].time_s for samples in self.heard.values() if samples)
        expected = list(frames(built(NAME), last))
        for role, samples in self.heard.items():
            for sample in samples:
                assert sample == getattr(expected[sample.step], PART[role]), f"{role}, step {sample.step}"

    def __exit__(self, *error: object) -> None:
        for role in [*self._processes]:
            process = self._processes.pop(role)
            process.terminate()
            process.wait()
        super().__exit__(*error)


def users_nodes(bag: Path) -> list[str]:
    """Return the topics on which a recording says that a node of the user's own answered."""
    with BagReader(bag) as reader:
        samples = BagSamples(reader)
        assert sum(1 for _ in samples.steps()) > 0
        return samples.users_nodes


def check_recording(bag: Path) -> None:
    """Compare a recording with the engine: from the first step, none missing, bit by bit."""
    found = recorded_samples(NAME, bag)
    last = max(sample.time_s for samples in found.values() for sample in samples)
    expected = list(frames(built(NAME), last))
    for topic, samples in found.items():
        steps = sorted({sample.step for sample in samples})  # one that was asked again stands there twice
        assert steps == list(range(len(steps))), topic
        assert len(steps) >= STEPS - UNDER_WAY
        for sample in samples:
            assert sample == getattr(expected[sample.step], PARTS[topic]), topic
    assert not users_nodes(bag)


@pytest.mark.parametrize("recorder", ["", "here", "elsewhere"], ids=["none", "here", "elsewhere"])
@pytest.mark.parametrize(
    "apart",
    [
        (),
        *(pytest.param((role,), marks=pytest.mark.slow) for role in ("motor", "force_analysis", "body", "linkage")),
        pytest.param(("motor", "body"), marks=pytest.mark.slow),
    ],
)
def test_each_role_and_the_recorder_may_be_elsewhere(apart: tuple[str, ...], recorder: str, tmp_path: Path) -> None:
    with MixedRun(tmp_path, apart, recorder) as run:
        run.steps_of(next(role for role in PART if role not in apart))
        run.check()
        faults = {
            (node.get_name(), *key): number
            for node in run.nodes
            for key, number in node.statistics.total.items()
            if number and key[1] not in STALL and key[0] in {topic.name for topic in STEP_OF.values()}
        }
        assert not faults
    if recorder:
        check_recording(tmp_path / "bag")


@pytest.mark.slow
@pytest.mark.parametrize("heard", [1, STEPS - 50])
def test_a_recorder_that_stalls_before_its_end_records_what_waits_for_it(heard: int, tmp_path: Path) -> None:
    with MixedRun(tmp_path, recorder="elsewhere") as run:
        run.steps_of("motor", heard)
        recorder = run.stall("recorder")
        run.steps_of("motor", STEPS - heard)
        run.spin_for(0.3)
        recorder.terminate()
        recorder.send_signal(signal.SIGCONT)
        recorder.wait()
    check_recording(tmp_path / "bag")


@pytest.mark.slow
def test_steps_that_a_recorder_has_not_taken_outlast_the_nodes_that_sent_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spinner, "ARRIVAL_LIMIT_S", 20.0)  # a busy machine
    with MixedRun(tmp_path, recorder="elsewhere") as run:
        run.steps_of("motor", 1)
        recorder = run.stall("recorder")
        run.steps_of("motor", STEPS)
        threading.Timer(0.5, recorder.send_signal, [signal.SIGCONT]).start()
        for role in PART:
            run.kill(role)
        recorder.terminate()
        recorder.wait()
    check_recording(tmp_path / "bag")


def test_a_topic_that_lacks_steps_at_the_end_has_missed_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record = RecorderNode._record_step

    def deaf(recorder: RecorderNode, of_topic: Any, stamp: Any, step: int, who: float, raw: bytes) -> None:
        if of_topic.topic != STEP_MOTOR or step < STEPS:
            record(recorder, of_topic, stamp, step, who, raw)

    monkeypatch.setattr(RecorderNode, "_record_step", deaf)
    with MixedRun(tmp_path, recorder="here") as run:
        run.steps_of("motor", 2 * STEPS)
    with BagReader(tmp_path / "bag") as reader:
        missed = {name: row["missed"] for name, row in reader.info.counters.items() if row["missed"]}
    assert [*missed] == [full_name(NAME, STEP_MOTOR)]
    assert missed[full_name(NAME, STEP_MOTOR)] >= STEPS - UNDER_WAY


def test_a_users_node_that_numbers_no_step_has_missed_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record = RecorderNode._record_step

    def plain(recorder: RecorderNode, of_topic: Any, stamp: Any, step: int, who: float, raw: bytes) -> None:
        record(recorder, of_topic, stamp, None if of_topic.topic == STEP_MOTOR else step, who, raw)

    monkeypatch.setattr(RecorderNode, "_record_step", plain)
    with MixedRun(tmp_path, recorder="here") as run:
        run.steps_of("motor")
    with BagReader(tmp_path / "bag") as reader:
        assert not any(row["missed"] for row in reader.info.counters.values())


def test_a_recorder_at_its_end_waits_for_repairs_as_long_as_publishers_live(tmp_path: Path) -> None:
    with MixedRun(tmp_path, recorder="here") as run:
        run.steps_of("motor", 1)
        recorder = run.node("recorder")
        run.kill("motor")  # without its answers no role sends another step
        recorder.flush()
        run.spin_for(2.0 * QUIET_S)
        assert not recorder.settled()
        for role in ("linkage", "force_analysis", "body"):
            run.kill(role)
        recorder.flush()
        run.spin_for(2.0 * QUIET_S)
        assert recorder.settled()


@pytest.mark.slow
@pytest.mark.parametrize("role", PART)
def test_a_role_may_go_elsewhere_and_come_back(role: str, tmp_path: Path) -> None:
    other = "motor" if role != "motor" else "linkage"
    with MixedRun(tmp_path, recorder="here") as run:
        run.steps_of(other)
        run.kill(role)
        run.start(role)
        run.steps_of(other)
        run.end(role)
        run.revive_here(role)
        run.steps_of(other)
        assert len(run.heard[role]) > STEPS
        run.check()


class UsersNode:
    """A node of somebody's own that does what ours does, and signs nothing."""

    def __init__(self, run: MixedRun, role: str, last: Frame) -> None:
        machine, self._client = built(NAME), run.client
        self._body = last.body
        asked, decode = (
            (STEP_FORCES, force_messages.from_message)
            if role == "body"
            else (STEP_LINKAGE, linkage_messages.from_message)
        )

        def answer(message: JointState) -> None:
            question = decode(message)
            if role == "motor":
                made = motor_messages.to_message(machine.motor.respond(question, 1.0))
            elif role == "force_analysis":
                made = force_messages.to_message(machine.forces.analyse(question))
            else:
                assert self._body is not None
                assert machine.body is not None
                if question.step == self._body.step + 1:
                    self._body = next_body(machine.body, self._body, question)
                made = body_messages.to_message(self._body)
            self.answers += 1
            self._out.publish(made)

        self.answers = 0
        self._out = self._client.create_publisher(JointState, full_name(NAME, STEP_OF[role]), asked.qos)
        self._in = self._client.create_subscription(JointState, full_name(NAME, asked), answer, asked.qos)

    def end(self, run: MixedRun) -> None:
        self._client.destroy_subscription(self._in)
        run.spin_for(0.05)  # what the executor still holds for it is answered
        self._client.destroy_publisher(self._out)


@pytest.mark.slow
@pytest.mark.parametrize("role", ["motor", "force_analysis", "body"])
def test_a_users_node_may_take_a_place_and_leave_it(role: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with MixedRun(tmp_path, recorder="here") as run:
        run.steps_of("linkage")
        run.kill(role)
        last = [*frames(built(NAME), run.heard["linkage"][-1].time_s)]
        newest = run.heard[role][-1].step
        users = UsersNode(run, role, last[newest])
        run.steps_of("linkage")
        assert users.answers >= STEPS
        users.end(run)
        run.revive_here(role)
        run.steps_of("linkage")
        only_by_hand(run.nodes, monkeypatch)
        run.steps_of("linkage")
        run.check()
    topic = full_name(NAME, STEP_OF[role])
    assert users_nodes(run.bag) == [topic]
    assert f"{topic}: answered by a node of your own" in mech_twin("replay", run.bag, "--resimulate").err


def only_by_hand(nodes: list[TwinNode], monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every publishing of a step's bytes fail from now on."""

    def refuse(topic: Topic) -> Callable[[bytes], None]:
        def publish(raw: bytes) -> None:
            raise AssertionError(f"bytes of {topic.name} published, though all who listen are here")

        return publish

    names = {topic.name: topic for topic in STEP_OF.values()}
    for node in nodes:
        for output in node.outputs:
            if output.name in names:
                monkeypatch.setattr(output._publisher, "publish", refuse(names[output.name]))


def test_nodes_of_one_process_publish_no_bytes_for_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with MixedRun(tmp_path, recorder="here") as run:
        run.steps_of("linkage", 1)
        only_by_hand(run.nodes, monkeypatch)
        run.steps_of("linkage")
        run.check()
