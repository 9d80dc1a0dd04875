# SPDX-License-Identifier: Apache-2.0
"""Nothing but the steady clock is read: a stopped, jumping or foreign clock has no effect on a run."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from bench_run import BenchRun
from builtin_interfaces.msg import Time
from catalogue import built
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from process_run import ProcessRun
from rclpy.clock import ClockType
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

import mech_twin
from mech_twin.engine.run import frames
from mech_twin.messages.topics import CLOCK, DIAGNOSTICS, JOINT_STATES, STEP_LINKAGE, STEP_MOTOR, Topic
from mech_twin.nodes.exchange.peers import other_publishers
from mech_twin.nodes.roles.answering_nodes import MotorNode
from mech_twin.nodes.roles.recorder_node import RecorderNode
from mech_twin.recording.bag_reader import BagReader

DRUM = "winding_drum"
PURE = ("samples", "roles", "declarations", "kernels/kernel", "parts", "engine", "machines", "studies")
WALL = {"time", "time_ns", "ctime", "localtime", "gmtime", "strftime", "now", "today", "utcnow"}
ONLY_NAMES = {"bench_hall.py", "executables.py", "run.py"}  # the wall clock names a recording directory there


def wall_clock_reads(file: Path) -> list[str]:
    """Return the calls of a file that read the wall clock: ``time.time()``, ``datetime.now()`` and their like."""
    calls = [node for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Call)]
    return [
        ast.unparse(call)
        for call in calls
        if isinstance(call.func, ast.Attribute)
        and call.func.attr in WALL
        and ast.unparse(call.func.value) in ("time", "datetime", "date", "datetime.datetime")
    ]


@pytest.mark.slow
def test_no_node_and_no_physics_reads_the_wall_clock() -> None:
    root = Path(mech_twin.__file__).parent
    rooms = [root / "nodes", root / "messages", *(root / room for room in PURE)]
    files = [f for room in rooms for f in (sorted(room.rglob("*.py")) if room.is_dir() else [room.with_suffix(".py")])]
    assert len(files) > 50
    found = {str(file.relative_to(root)): wall_clock_reads(file) for file in files if file.name not in ONLY_NAMES}
    assert {name: calls for name, calls in found.items() if calls} == {}


@pytest.mark.usefixtures("ros_domain")
def test_every_timer_of_a_node_runs_on_the_steady_clock() -> None:
    with BenchRun("mb10_breaker") as run:
        timers = [timer for node in run.nodes for timer in node.timers]
        assert len(timers) > 8
        assert {timer.clock.clock_type for timer in timers} == {ClockType.STEADY_TIME}


@pytest.mark.usefixtures("ros_domain")
def test_a_foreign_clock_that_stops_and_jumps_changes_nothing() -> None:
    with BenchRun(DRUM, peer_timeout_s=0.2) as run:
        publisher = run.client.create_publisher(CLOCK.type, CLOCK.name, CLOCK.qos)
        run.steps(50)
        for second in (10**6, 5, 0, 2**31 - 1, 7):
            publisher.publish(Clock(clock=Time(sec=second)))
            run.steps(30)
        run.kill("motor")  # what waits and retries does so in spite of it, too
        run.until(lambda: run.linkage.diagnostics.state == "waiting for motor")
        run.revive(MotorNode)
        run.steps(50)
        expected = [frame.linkage for frame in frames(built(DRUM), run.samples[-1].time_s)]
        assert run.samples == expected[: len(run.samples)]


@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain")
def test_nodes_that_were_told_to_use_sim_time_run_all_the_same(tmp_path: Path) -> None:
    """The ROS clock of such nodes is this foreign clock, which stands still and then jumps back."""
    with ProcessRun(DRUM, tmp_path, pace="max", peer_timeout_s=0.3) as run:
        publisher = run.witness.create_publisher(Clock, CLOCK.name, CLOCK.qos)
        run.sim_time = True
        run.start_all()
        publisher.publish(Clock(clock=Time(sec=10**6)))
        run.steps(300)
        publisher.publish(Clock(clock=Time(sec=3)))
        run.steps(300)
        run.kill("motor")
        run.until(lambda: run.said("linkage", "waiting for motor"))
        run.start("motor")
        run.steps(100)
        assert run.checked() > 600


@pytest.mark.usefixtures("ros_domain")
def test_a_foreign_clock_does_not_move_the_time_of_a_recording(tmp_path: Path) -> None:
    with BenchRun(DRUM, recorder=True) as run:
        recorder = run.revive(
            lambda name, parameters, options: RecorderNode(name, tmp_path / "bag", parameters, options)
        )
        publisher = run.client.create_publisher(CLOCK.type, CLOCK.name, CLOCK.qos)
        run.steps(50)
        for second in (10**6, 0):
            publisher.publish(Clock(clock=Time(sec=second)))
            run.steps(30)
        run.spin_for(0.2)
        assert isinstance(recorder, RecorderNode)
        recorder.close()
        end_s = run.samples[-1].time_s
    with BagReader(tmp_path / "bag") as reader:
        times = [row.log_time_ns for row in reader.messages()]
    assert max(times) <= round(end_s * 1e9)


@pytest.mark.usefixtures("ros_domain")
def test_diagnostics_of_another_machine_have_its_own_times(tmp_path: Path) -> None:
    with BenchRun(DRUM, recorder=True) as run:
        recorder = run.revive(
            lambda name, parameters, options: RecorderNode(name, tmp_path / "bag", parameters, options)
        )
        other = run.client.create_publisher(DiagnosticArray, DIAGNOSTICS.name, DIAGNOSTICS.qos)
        run.until(lambda: other.get_subscription_count() > 0)
        run.steps(50)
        for machine in ("another", DRUM):
            message = DiagnosticArray(status=[DiagnosticStatus(name=f"/{machine}/motor")])
            message.header.stamp = Time(sec=3600)
            other.publish(message)
        run.until(lambda: recorder.statistics.total[DIAGNOSTICS.name, "unknown_source"] > 0)
        run.spin_for(0.3)
        assert recorder.statistics.total[DIAGNOSTICS.name, "unknown_source"] == 1
        recorder.close()


@pytest.mark.usefixtures("ros_domain")
def test_who_publishes_the_shared_clock_before_or_after_a_run_begins_has_it_alone() -> None:
    with BenchRun(DRUM) as run:
        heard: list[Clock] = []
        run.client.create_subscription(Clock, f"/{DRUM}/clock", heard.append, 100)
        run.steps(50)
        assert run.linkage.count_publishers(CLOCK.name) == 1
        run.client.create_publisher(CLOCK.type, CLOCK.name, CLOCK.qos)
        run.until(lambda: run.linkage.diagnostic_values()["clock"] == f"/{DRUM}/clock")
        run.until(lambda: other_publishers(run.client, CLOCK.name) == set())
        before = len(heard)
        run.steps(50)
        run.until(lambda: len(heard) > before)


def strangers_on(run: BenchRun, joint_states: Topic) -> None:
    """Publish what any other node may: wall, negative and absurd stamps, on a step topic and on diagnostics."""
    steps = run.client.create_publisher(JointState, joint_states.name, joint_states.qos)
    diagnostics = run.client.create_publisher(DiagnosticArray, DIAGNOSTICS.name, DIAGNOSTICS.qos)
    run.until(lambda: steps.get_subscription_count() > 0 and diagnostics.get_subscription_count() > 0)
    for second in (1_790_000_000, -5, 2**31 - 1, -(2**31), 3600):
        message = JointState(name=["somebody"], position=[0.0], velocity=[0.0], effort=[0.0])
        message.header.stamp = Time(sec=second)
        steps.publish(message)
        diagnostics.publish(DiagnosticArray(header=message.header))
        run.steps(30)


@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("topic", [STEP_LINKAGE, STEP_MOTOR, JOINT_STATES], ids=lambda topic: topic.name)
def test_no_strangers_stamp_rules_time_splits_or_gaps_of_a_recording(topic: Topic, tmp_path: Path) -> None:
    with BenchRun(DRUM, recorder=True, split_s=1000.0) as run:
        recorder = run.revive(
            lambda name, parameters, options: RecorderNode(name, tmp_path / "bag", parameters, options)
        )
        run.steps(50)
        strangers_on(run, topic)
        run.steps(50)
        run.spin_for(0.3)
        total = recorder.statistics.total
        assert total[topic.name, "unknown_source"] == 5
        assert total[DIAGNOSTICS.name, "unknown_source"] == 5
        assert not [key for key in total if key[1] in ("missing", "late", "repeated")]
        recorder.close()
        end_s = run.samples[-1].time_s
    with BagReader(tmp_path / "bag") as reader:
        times = [row.log_time_ns for row in reader.messages()]
        counters = reader.info.counters
    assert 0 <= min(times) <= max(times) <= round(end_s * 1e9)
    assert all(row["missed"] == 0 for row in counters.values())
    assert len(list((tmp_path / "bag").glob("*.mcap"))) == 1
