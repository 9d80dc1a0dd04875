# SPDX-License-Identifier: Apache-2.0
"""The programs of the page on own nodes run against a live machine, and mistakes are told in the words of that page."""

from __future__ import annotations

import ast
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import rclpy
from bench_run import BenchRun
from catalogue import built
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32

from mech_twin.machines.mb10_breaker.forces import FLYING, IN_CONTACT, after_load
from mech_twin.machines.mb10_breaker.state import KINDS
from mech_twin.messages.step_message import LOAD_COLUMNS, set_stamp
from mech_twin.messages.step_message import force as force_messages
from mech_twin.messages.step_message import motor as motor_messages
from mech_twin.messages.topics import (
    EFFORT_COMMAND,
    STEP_BODY,
    STEP_FORCES,
    STEP_LINKAGE,
    STEP_MOTOR,
    Topic,
    full_name,
    step_topics,
)
from mech_twin.nodes.exchange.counting import TopicStatistics
from mech_twin.samples import LinkageSample

pytestmark = pytest.mark.usefixtures("ros_domain")
PAGE = (Path(__file__).resolve().parents[2] / "docs" / "tutorials" / "own-node.md").read_text(encoding="utf-8")
PROGRAMS = dict(re.findall(r"^```python file=(\w+\.py)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
LONGEST_LINES = 20
REPLACED = {
    "own_motor.py": ("mb10_breaker", "motor", STEP_MOTOR),
    "own_body.py": ("mb10_breaker", "body", STEP_BODY),
    "own_forces.py": ("winding_drum", "force_analysis", STEP_FORCES),
}
INTERRUPTED = """
import os, signal, time
from rclpy.publisher import Publisher

publish = Publisher.publish


def interrupted(self, message):
    if "/step/" in self.topic_name:
        os.kill(os.getpid(), signal.{})
        time.sleep(0.2)  # for whoever else has heard the signal
    publish(self, message)


Publisher.publish = interrupted
"""
STEPS = 60
FORCE_MACHINE, BODY_MACHINE = "winding_drum", "mb10_breaker"


@pytest.mark.parametrize("program", REPLACED)
def test_a_node_of_ones_own_is_short_and_needs_nothing_of_ours(program: str) -> None:
    lines = [line for line in PROGRAMS[program].splitlines() if line.strip()]
    assert len(lines) <= LONGEST_LINES
    tree = ast.parse(PROGRAMS[program])
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported == {"rclpy", "rclpy.signals", "sensor_msgs.msg", "signal"}


@pytest.mark.slow
@pytest.mark.parametrize("program", REPLACED)
def test_a_node_of_ones_own_takes_the_place_of_ours(program: str, tmp_path: Path) -> None:
    name, role, topic = REPLACED[program]
    file = tmp_path / program
    file.write_text(PROGRAMS[program], encoding="utf-8")
    with ExitStack() as after_the_run, BenchRun(name) as run:
        run.steps(20)
        heard: list[JointState] = []
        run.client.create_subscription(JointState, topic.name, heard.append, topic.qos)
        run.kill(role)
        process = after_the_run.enter_context(subprocess.Popen([sys.executable, str(file)], stderr=subprocess.PIPE))
        after_the_run.callback(process.kill)
        run.steps(STEPS)
        total = run.linkage.statistics.total
        assert total[topic.name, "malformed"] == 0
        assert any("~source" not in message.name for message in heard), "only ours was heard"
        process.send_signal(signal.SIGINT)
        assert (process.communicate(timeout=20)[1], process.returncode) == (b"", 0)


@pytest.mark.slow
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("program", REPLACED)
def test_a_signal_in_the_midst_of_an_answer_ends_a_node_of_ones_own_quietly(
    program: str, number: str, tmp_path: Path
) -> None:
    name, role, _ = REPLACED[program]
    file = tmp_path / program
    file.write_text(INTERRUPTED.format(number) + PROGRAMS[program], encoding="utf-8")
    with BenchRun(name) as run:
        run.steps(20)
        run.kill(role)
        with subprocess.Popen([sys.executable, str(file)], stderr=subprocess.PIPE) as process:
            try:
                run.until(lambda: process.poll() is not None)
                assert (process.communicate()[1], process.returncode) == (b"", 0)
            finally:
                process.kill()


def test_the_page_names_each_event_that_moves_a_body_and_the_rows_that_tell_it() -> None:
    table = PAGE.partition("| KIND |")[2].partition("\n\n")[0]
    named = {
        kind for cells in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE) for kind in re.findall(r"`(\w+)`", cells)
    }
    moving = {kind for at, kind in enumerate(KINDS) if any(after_load(r, at, 1.0) != r for r in (IN_CONTACT, FLYING))}
    assert named == moving - {"body_started", "body_stopped"} | {"reset"}  # the page's body has no friction
    assert {*LOAD_COLUMNS, "body_angle_rad", "body_rate_rad_per_s"} <= set(re.findall(r"`(\w+)`", PAGE))


def test_the_page_names_the_topics_of_the_code() -> None:
    named = set(re.findall(r"`(step/\w+)`", PAGE)) | {
        word for text in PROGRAMS.values() for word in re.findall(r'"(step/\w+)"', text)
    }
    assert named == {topic.name for topic in step_topics(has_body=True)}
    cpp = PAGE.split("```cpp")[1]
    assert set(re.findall(r'"(step/\w+)"', cpp)) == {STEP_LINKAGE.name, STEP_MOTOR.name}


# -- mistakes ---------------------------------------------------------------------------------------------------------


class Told:
    """Every reason a node counts something for."""

    def __init__(self, statistics: TopicStatistics, monkeypatch: pytest.MonkeyPatch) -> None:
        self.said: list[tuple[str, str, str]] = []
        count = statistics.count

        def listening(topic: str, kind: str, reason: str = "", number: int = 1) -> None:
            self.said.append((topic, kind, reason))
            count(topic, kind, reason, number)

        monkeypatch.setattr(statistics, "count", listening)


@contextmanager
def waiting(name: str, role: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[BenchRun, Told]]:
    """Give a run that waits for one of its roles."""
    with BenchRun(name) as run:
        run.steps(20)
        run.kill(role)
        told = Told(run.linkage.statistics, monkeypatch)
        run.until(lambda: run.linkage.diagnostics.state == f"waiting for {role}")
        yield run, told


def tells(run: BenchRun, told: Told, topic: Topic, message: JointState, kind: str, text: str) -> None:
    """Publish a message until the linkage says what is wrong with it, and check that the page has those words."""
    publisher = run.publisher(topic)
    publisher.publish(message)
    wanted = re.compile(text)
    run.until(lambda: any(t == topic.name and k == kind and wanted.fullmatch(said) for t, k, said in told.said))
    plain = re.sub(r"\d+(\.\d+)?", "#", next(s for t, k, s in told.said if k == kind and wanted.fullmatch(s)))
    assert plain in re.sub(r"\d+(\.\d+)?", "#", PAGE), f"the page has no word of: {plain}"


def right_motor(sample: LinkageSample) -> JointState:
    return motor_messages.to_message(built(BODY_MACHINE).motor.respond(sample, 1.0))


def plain_motor(sample: LinkageSample) -> JointState:
    """Return an answer without a row that marks its step, as somebody's own program gives it."""
    right = right_motor(sample)
    return JointState(
        header=right.header,
        name=right.name[:1],
        position=right.position[:1],
        velocity=right.velocity[:1],
        effort=right.effort[:1],
    )


def changed(**columns: Any) -> Callable[[JointState], None]:
    def change(message: JointState) -> None:
        for column, value in columns.items():
            setattr(message, column, value)

    return change


def doubled(message: JointState) -> None:
    message.name = [message.name[0]] * 2
    message.position = message.velocity = message.effort = [0.0, 0.0]


def shifted(message: JointState) -> None:
    message.header.stamp.nanosec += 400_000


MISTAKES = {
    "column": (changed(effort=[]), r"column effort is empty, expected 1: one for each of rotor"),
    "length": (changed(velocity=[1.0, 2.0]), r"column velocity has 2 numbers, expected 1: one for each of rotor"),
    "names": (changed(name=[]), r"no rows: 'name' is empty"),
    "twice": (doubled, r"row name 'rotor' stands twice"),
    "joint": (changed(name=["shaft"]), r"joint rotor is missing; there are shaft"),
    "number": (changed(effort=[float("nan")]), r"effort of 'rotor' is nan, not finite"),
    "stamp": (shifted, r"stamp \d\.\d{9} s lies between steps of 0\.001 s; expected that of the step answered"),
}


def test_each_mistake_of_a_motor_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with waiting(BODY_MACHINE, "motor", monkeypatch) as (run, told):
        for make, text in MISTAKES.values():
            message = plain_motor(run.samples[-1])
            make(message)
            tells(run, told, STEP_MOTOR, message, "malformed", text)
        tells(run, told, STEP_MOTOR, plain_motor(run.samples[2]), "late", r"step \d+ at step \d+")
        early = plain_motor(run.samples[-1])
        set_stamp(early.header, run.samples[-1].time_s + 10 * run.linkage.machine.coupling_step_s)
        tells(run, told, STEP_MOTOR, early, "early", r"step \d+ at step \d+")
        before = len(run.samples)
        publisher = run.publisher(STEP_MOTOR)
        publisher.publish(plain_motor(run.samples[-1]))
        run.until(lambda: len(run.samples) > before)  # and the right answer is taken


def test_a_second_answer_to_a_step_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with waiting(BODY_MACHINE, "motor", monkeypatch) as (run, told):
        answered = run.samples[-1]
        publisher = run.publisher(STEP_MOTOR)
        publisher.publish(plain_motor(answered))
        run.until(lambda: len(run.samples) > 0 and run.samples[-1].step > answered.step)
        other = plain_motor(answered)
        other.effort = [other.effort[0] + 1.0]
        tells(run, told, STEP_MOTOR, other, "conflicting", r"another answer to step \d+")


def test_each_mistake_of_a_force_analysis_and_of_a_body_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with waiting(FORCE_MACHINE, "force_analysis", monkeypatch) as (run, told):
        right = force_messages.to_message(built(FORCE_MACHINE).forces.analyse(run.samples[-1]))
        for name, text in {
            "shaft/moment_nm": r"row 'shaft/moment_nm' is missing; a pin has force_x_n, force_y_n, moment_nm",
            "~body_moment_nm": r"row '~body_moment_nm' is missing",
        }.items():
            rows = [row for row, known in enumerate(right.name) if known != name]
            message = JointState(header=right.header, name=[right.name[row] for row in rows])
            for column in ("position", "velocity", "effort"):
                setattr(message, column, [getattr(right, column)[row] for row in rows])
            tells(run, told, STEP_FORCES, message, "malformed", text)
    with waiting(BODY_MACHINE, "body", monkeypatch) as (run, told):
        message = JointState(name=["body"], position=[0.0], velocity=[0.0], effort=[0.0])
        message.header.stamp = right_motor(run.samples[-1]).header.stamp
        tells(run, told, STEP_BODY, message, "malformed", r"row '~pressing_force_n' is missing")


def test_an_answer_beside_ours_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with BenchRun(BODY_MACHINE) as run:
        run.steps(20)
        told = Told(run.linkage.statistics, monkeypatch)
        publisher = run.publisher(STEP_MOTOR)
        before = len(run.samples)
        text = r"step \d+ from another publisher than the one that is followed"
        publisher.publish(plain_motor(run.samples[-1]))
        tells(run, told, STEP_MOTOR, plain_motor(run.samples[-1]), "unknown_source", text)
        run.until(lambda: len(run.samples) > before)  # and ours are taken


def test_every_mistake_of_the_page_is_tried() -> None:
    """The words of each row stand in this file: a row that is added to the page needs a test."""
    rows = re.findall(r"^\| [a-z ']+ \| (.+) \|$", PAGE.partition("## What a mistake says")[2], re.MULTILINE)
    tried = re.sub(r"\\d\+?|\\\.|\{9\}|\d", "#", Path(__file__).read_text(encoding="utf-8"))
    told = [word for row in rows for word in re.findall(r"`([^`]+)`", row)]
    assert len(told) > len(rows) > 10
    for word in told:
        longest = max(re.split(r"\d[\d.]*", word), key=len)
        assert longest.strip() in tried, word


def test_a_publisher_of_best_effort_and_one_beside_ours_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with BenchRun(BODY_MACHINE) as run:
        run.steps(20)
        told = Told(run.linkage.statistics, monkeypatch)
        loose = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        run.client.create_publisher(JointState, full_name(BODY_MACHINE, STEP_MOTOR), loose)
        run.until(lambda: any(kind == "incompatible" for _, kind, _ in told.said))
        reason = next(reason for _, kind, reason in told.said if kind == "incompatible")
        assert reason == "a publisher whose reliability does not fit is not connected"
        assert reason in PAGE


@pytest.mark.slow
def test_a_publisher_of_another_type_on_a_command_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    with BenchRun(BODY_MACHINE) as run:
        run.steps(20)
        told = Told(run.node("motor").statistics, monkeypatch)
        elsewhere = rclpy.Context()  # in one, the middleware refuses a second type
        rclpy.init(context=elsewhere)
        stranger = rclpy.create_node("stranger", context=elsewhere)
        stranger.create_publisher(Float32, full_name(BODY_MACHINE, EFFORT_COMMAND), 1)
        run.until(lambda: any(kind == "incompatible" for _, kind, _ in told.said))
        run.spin_for(2.5)
        stranger.destroy_node()
        elsewhere.destroy()
        reason = "publishes std_msgs/msg/Float32, which is not connected; expected std_msgs/msg/Float64"
        found = [each for each in told.said if each[1] == "incompatible"]
        assert found == [(EFFORT_COMMAND.name, "incompatible", f"stranger {reason}")]
        assert reason in PAGE
