# SPDX-License-Identifier: Apache-2.0
"""Who else speaks on a running machine's topics is counted, reported once a window, never used, never fatal."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import rclpy
from bench_run import BenchRun
from catalogue import built
from command_line import mech_twin
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from mech_twin.engine.run import frames
from mech_twin.messages import scene
from mech_twin.messages.cdr import received_message
from mech_twin.messages.step_message import REVISION, SOURCE, set_stamp, step_index
from mech_twin.messages.step_message import body as body_messages
from mech_twin.messages.step_message import force as force_messages
from mech_twin.messages.step_message import linkage as linkage_messages
from mech_twin.messages.step_message import motor as motor_messages
from mech_twin.messages.topics import (
    DESCRIPTION,
    DIAGNOSTICS,
    REJOIN,
    REJOIN_BODY,
    REJOIN_DESCRIPTION,
    REJOIN_LINKAGE,
    REJOIN_MOTOR,
    SCENE,
    STEP_BODY,
    STEP_FORCES,
    STEP_LINKAGE,
    STEP_MOTOR,
    Topic,
)
from mech_twin.nodes.exchange.direct_exchange import HandOver
from mech_twin.nodes.roles.answering_nodes import ForceNode, MotorNode
from mech_twin.nodes.roles.linkage_node import LinkageNode
from mech_twin.nodes.roles.recorder_node import COPIED, RecorderNode
from mech_twin.nodes.roles.viewer_node import ViewerNode
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import machine_parameters
from mech_twin.recording.bag_reader import BagReader, open_bag
from mech_twin.recording.bag_writer import BagWriter
from mech_twin.recording.schemas import offered_qos
from mech_twin.samples import Drawing, MotorSample, Shape

pytestmark = pytest.mark.usefixtures("ros_domain")
DRUM = "winding_drum"
MOTOR = STEP_MOTOR.name


def assert_engine(run: BenchRun) -> None:
    """Hold the whole run so far against the engine, to the bit."""
    samples = run.samples
    expected = [frame.linkage for frame in frames(built(run.name), samples[-1].time_s)]
    assert samples == expected[: len(samples)]


def with_row(message: JointState, row: str, value: float) -> JointState:
    """Return the message with one more row."""
    message.name.append(row)
    for column, entry in ((message.position, value), (message.velocity, 0.0), (message.effort, 0.0)):
        column.append(entry)
    return message


def second_motor(run: BenchRun, change: Callable[[MotorSample], MotorSample], source: float | None) -> None:
    """Let the client answer every step, validly and with other numbers."""
    publisher = run.publisher(STEP_MOTOR)
    role = built(run.name).motor

    def answer(message: JointState) -> None:
        reply = motor_messages.to_message(change(role.respond(linkage_messages.from_message(message), 1.0)))
        publisher.publish(reply if source is None else with_row(reply, SOURCE, source))

    run.client.create_subscription(JointState, STEP_LINKAGE.name, answer, STEP_LINKAGE.qos)


def stronger(sample: MotorSample) -> MotorSample:
    return sample._replace(
        effort=tuple(value + 1000.0 for value in sample.effort), velocity=tuple(v + 1.0 for v in sample.velocity)
    )


@pytest.mark.parametrize("source", [None, 17.0])
def test_a_second_motor_with_valid_other_answers_is_never_used(source: float | None) -> None:
    with BenchRun(DRUM) as run:
        run.steps(20)
        second_motor(run, stronger, source)
        run.steps(300)
        total = run.linkage.statistics.total
        run.until(lambda: sum(total[MOTOR, kind] for kind in ("unknown_source", "conflicting", "late")) > 50)
        assert_engine(run)


def test_somebodys_own_motor_takes_over_when_ours_is_gone_and_ours_does_when_it_is() -> None:
    with BenchRun("vibration_crank", peer_timeout_s=0.2) as run:
        run.steps(20)
        second_motor(run, lambda sample: sample, None)
        run.kill("motor")
        run.steps(100)
        run.revive(MotorNode)
        run.steps(100)
        assert run.linkage.statistics.total[MOTOR, "timeout"] >= 1
        assert_engine(run)


def test_joints_in_another_order_are_matched_by_name() -> None:
    with BenchRun("vibration_crank") as run:
        run.steps(20)
        run.kill("motor")
        publisher = run.publisher(STEP_MOTOR)
        run.until(lambda: run.linkage.diagnostics.state.startswith("waiting"))
        role = built(run.name).motor

        def answer(message: JointState) -> None:
            good = role.respond(linkage_messages.from_message(message), 1.0)
            reply = motor_messages.to_message(
                good._replace(
                    **{
                        "joints": ("other", *good.joints),
                        **{column: (7.0, *getattr(good, column)) for column in ("position", "velocity", "effort")},
                    }
                )
            )
            for column in ("name", "position", "velocity", "effort"):
                setattr(reply, column, list(getattr(reply, column))[::-1])
            publisher.publish(reply)

        run.client.create_subscription(JointState, STEP_LINKAGE.name, answer, STEP_LINKAGE.qos)
        run.steps(50)
        assert_engine(run)


def test_duplicated_and_late_answers_are_counted_and_change_nothing() -> None:
    with BenchRun(DRUM) as run:
        publisher = run.publisher(STEP_MOTOR)
        heard: list[JointState] = []

        def twice(message: JointState) -> None:
            if len(heard) < 300:  # its own repetitions come back here
                heard.append(message)
                publisher.publish(message)
                publisher.publish(heard[len(heard) // 2])

        run.client.create_subscription(JointState, MOTOR, twice, STEP_LINKAGE.qos)
        run.steps(300)
        total = run.linkage.statistics.total
        run.until(lambda: total[MOTOR, "repeated"] + total[MOTOR, "late"] > 100)
        assert_engine(run)


def window_reports(run: BenchRun, role: str) -> list[str]:
    """Return, growing, the messages of a node's diagnostics."""
    messages: list[str] = []

    def take(array: DiagnosticArray) -> None:
        messages.extend(status.message for status in array.status if status.name.endswith(f"/{role}"))

    run.client.create_subscription(DiagnosticArray, DIAGNOSTICS.name, take, 100)
    return messages


@pytest.mark.slow
def test_a_fault_is_reported_once_a_window_with_its_number() -> None:
    with BenchRun(DRUM) as run:
        run.steps(20)
        messages = window_reports(run, "linkage")
        publisher = run.publisher(STEP_MOTOR)
        for _ in range(40):
            publisher.publish(JointState(name=["drum"], position=[0.0], velocity=[0.0], effort=[float("nan")]))
        run.until(lambda: run.linkage.statistics.total[MOTOR, "malformed"] == 40)
        run.until(lambda: any("malformed" in message for message in messages))
        run.spin_for(1.1)
        told = [message for message in messages if "malformed" in message]
        assert len(told) <= 2  # the forty may fall on both sides of a window's end
        assert any("40 malformed" in message or "not finite" in message for message in told)


QUALITIES = {
    "reliability": QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT),
    "durability": QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
}


def test_a_publisher_whose_quality_does_not_fit_is_noticed() -> None:
    with BenchRun(DRUM) as run:
        run.steps(5)
        told_apart = PublisherEventCallbacks(use_default_callbacks=False)
        run.client.create_publisher(JointState, MOTOR, QUALITIES["reliability"], event_callbacks=told_apart)
        run.until(lambda: run.linkage.statistics.total[MOTOR, "incompatible"] == 1)
        run.steps(50)
        assert_engine(run)


def test_a_subscriber_whose_quality_does_not_fit_is_noticed() -> None:
    with BenchRun(DRUM) as run:
        run.steps(5)
        told_apart = SubscriptionEventCallbacks(use_default_callbacks=False)
        run.client.create_subscription(
            JointState, STEP_LINKAGE.name, lambda message: None, QUALITIES["durability"], event_callbacks=told_apart
        )
        run.until(lambda: run.linkage.statistics.total[STEP_LINKAGE.name, "incompatible"] == 1)
        run.steps(50)
        assert_engine(run)


def garbled() -> list[JointState]:
    """Return step messages that are wrong in ways a careless program brings about."""
    plain = {"position": [0.0], "velocity": [0.0], "effort": [0.0]}
    far = JointState(name=["drum"], **plain)
    set_stamp(far.header, 1e6)
    return [
        JointState(name=["drum", REVISION], position=[0.0]),
        with_row(JointState(name=["drum"], **plain), REVISION, float("nan")),
        with_row(JointState(name=["drum"], **plain), REVISION, 1e300),
        with_row(JointState(name=["drum"], **plain), "~step", float("inf")),
        with_row(JointState(name=["drum"], **plain), "~step", -1e300),
        with_row(JointState(name=["drum"], **plain), "~event/²/kind/contact", 0.0),
        with_row(JointState(name=["drum"], **plain), "~event/0/kind/contact", 0.0),
        JointState(name=["drum/force_x_n"], **plain),
        far,
    ]


@pytest.mark.parametrize(
    "topic",
    [
        STEP_LINKAGE,
        STEP_MOTOR,
        STEP_FORCES,
        REJOIN_LINKAGE,
        REJOIN_MOTOR,
        REJOIN_BODY,
    ],
)
def test_garbled_messages_end_nothing(topic: Topic) -> None:
    with BenchRun(DRUM) as run:
        run.steps(20)
        publisher = run.client.create_publisher(topic.type, topic.name, topic.qos)
        run.spin_for(0.1)
        for message in garbled():
            publisher.publish(message)
        run.steps(200)
        assert_engine(run)


WORDS = (
    "", "linkage", "[", "machine: nothing", "/**: {ros__parameters: {machine: drum}}", "\0",
    f"machine: {DRUM}\nrevision: 1\n/**: {{ros__parameters: {{package_radius_m: 0x{'f' * 5000}}}}}",
    f"machine: {DRUM}\nrevision: {'1:' * 400}1.5\n/**: {{ros__parameters: {{package_radius_m: 0.3}}}}",
)  # fmt: skip


@pytest.mark.parametrize("topic", [DESCRIPTION, REJOIN, REJOIN_DESCRIPTION])
def test_garbled_words_end_nothing(topic: Topic) -> None:
    with BenchRun(DRUM) as run:
        run.steps(10)
        publisher = run.client.create_publisher(String, topic.name, topic.qos)
        run.spin_for(0.1)
        for text in WORDS:
            publisher.publish(String(data=text))
            run.steps(30)
        assert_engine(run)


def other_descriptions() -> list[str]:
    """Return what a stranger may say the configuration is: other parameters, absurd revisions, an older bag's."""
    parameters = machine_parameters(DRUM, overrides={"package_radius_m": 0.4})
    signed_one = description_text(DRUM, parameters, 1, 0, 17.0)
    return [
        description_text(DRUM, parameters),
        description_text(DRUM, parameters, 1),
        signed_one,
        description_text(DRUM, parameters, 2**53, 0, 17.0),
        description_text(DRUM, parameters, 0, 0, 17.0),
        signed_one.replace("revision: 1", "revision: .inf"),
        signed_one.replace("revision: 1", "revision: " + "9" * 400),
        signed_one.replace("revision: 1", "revision: -1"),
        signed_one.replace("source: 17", "source: .nan"),
    ]


def test_a_strangers_description_never_reaches_a_running_role() -> None:
    with BenchRun(DRUM) as run:
        run.steps(20)
        publisher = run.client.create_publisher(String, DESCRIPTION.name, DESCRIPTION.qos)
        run.until(lambda: publisher.get_subscription_count() >= 2)
        for text in other_descriptions():
            publisher.publish(String(data=text))
            run.steps(30)
        total = run.node("motor").statistics.total
        run.until(lambda: total[DESCRIPTION.name, "unknown_source"] + total[DESCRIPTION.name, "malformed"] >= 9)
        assert total[DESCRIPTION.name, "malformed"] == 4
        run.kill("force_analysis")  # one that comes back while the stranger's is the newest on the topic
        run.revive(ForceNode)
        run.steps(100)
        assert_engine(run)
        for role in ("motor", "force_analysis", "linkage"):
            assert run.node(role).machine.parameters == built(DRUM).parameters


def test_a_second_linkage_is_not_followed() -> None:
    with BenchRun(DRUM) as run:
        run.steps(50)
        publisher = run.publisher(STEP_LINKAGE)
        ahead = run.samples[-1]._replace(step=10**6, time_s=1e3)
        for i in range(20):
            other: Any = ahead._replace(step=ahead.step + i, time_s=(ahead.step + i) * 0.001)
            publisher.publish(with_row(linkage_messages.to_message(other), SOURCE, 5.0))
        run.until(lambda: run.node("motor").statistics.total[STEP_LINKAGE.name, "unknown_source"] >= 20)
        run.steps(100)
        assert_engine(run)


def a_step_ahead(machine: str, steps: int) -> list[tuple[Topic, JointState]]:
    """Return the messages of one whole step, moved so many steps ahead, signed by a stranger."""
    frame = list(frames(built(machine), 0.05))[-1]
    encoded: list[tuple[Topic, Any, Any]] = [
        (STEP_LINKAGE, linkage_messages.to_message, frame.linkage),
        (STEP_MOTOR, motor_messages.to_message, frame.motor),
        (STEP_FORCES, force_messages.to_message, frame.forces),
        (STEP_BODY, body_messages.to_message, frame.body),
    ]
    return [
        (topic, with_row(encode(sample._replace(step=steps, time_s=1e3)), SOURCE, 5.0))
        for topic, encode, sample in encoded
        if sample is not None
    ]


def strange_drawings() -> list[MarkerArray]:
    """Return pictures of nothing: places that are none, times of another run, more than a picture has."""
    line = Shape("line", "line", ((0.0, 0.0), (0.1, 0.1)), (10, 20, 30), 0.01, "")
    far = [line._replace(points_m=((0.0, 0.0), (x, 0.0))) for x in (math.nan, math.inf, 1e300, -1e9)]
    shapes = [*far, line._replace(width_m=1e12), line._replace(kind="arrow", points_m=((0.0, 0.0),) * 3)]
    many = [(line,) * 3000, (line._replace(points_m=((0.0, 0.0),) * 200_000),)]
    pictures = [Drawing(0, 1e6, (line,)), *(Drawing(0, 0.1, (shape,)) for shape in shapes)]
    every = [*pictures, *(Drawing(0, 0.1, shapes) for shapes in many)]
    return [deserialize_message(scene.to_bytes(picture), MarkerArray) for picture in every]


@pytest.mark.parametrize("machine", [DRUM, pytest.param("mb10_breaker", marks=pytest.mark.slow)])
def test_a_view_shows_the_machine_whatever_strangers_say(machine: str, tmp_path: Path) -> None:
    with BenchRun(machine) as run:
        viewer = run.revive(lambda name, *known: ViewerNode(name, str(tmp_path / "run.rrd"), *known))
        assert isinstance(viewer, ViewerNode)
        run.until(lambda: viewer.run_metrics.frames > 20)
        for topic, message in a_step_ahead(machine, 10**7):
            run.publisher(topic).publish(message)
        drawings, drawn = strange_drawings(), run.publisher(SCENE)
        for message in drawings:
            drawn.publish(message)
        total = viewer.statistics.total
        run.until(lambda: total[SCENE.name, "malformed"] == len(drawings) - 1)
        run.until(lambda: total[SCENE.name, "unknown_source"] == 1)
        run.until(lambda: total[STEP_LINKAGE.name, "unknown_source"] == 1)
        before = viewer.run_metrics.frames
        run.until(lambda: viewer.run_metrics.frames > before + 100)
        last = viewer.run_metrics.last
        assert last is not None
        assert last.linkage == run.samples[last.linkage.step]
        assert_engine(run)


def test_a_view_goes_on_with_the_run_that_takes_the_place_of_one_that_is_gone(tmp_path: Path) -> None:
    with BenchRun(DRUM, peer_timeout_s=0.3) as run:
        viewer = run.revive(lambda name, *known: ViewerNode(name, str(tmp_path / "run.rrd"), *known))
        assert isinstance(viewer, ViewerNode)
        run.until(lambda: viewer.run_metrics.frames > 200)
        for role in ("linkage", "motor", "force_analysis"):
            run.kill(role)
        run.spin_for(0.6)
        for make in (MotorNode, ForceNode, LinkageNode):
            run.revive(make)
        run.until(lambda: viewer.newest_step < 100)
        run.until(lambda: viewer.run_metrics.frames > 50)


def test_a_stranger_who_signs_as_the_motor_is_not_used_and_the_run_computed_again_is_identical(tmp_path: Path) -> None:
    with BenchRun(DRUM, recorder=True) as run:
        recorder = run.revive(lambda name, *known: RecorderNode(name, tmp_path / "bag", *known))
        run.steps(20)
        second_motor(run, stronger, run.node("motor").source)
        run.steps(300)
        used, recorded = run.linkage.statistics.total, recorder.statistics.total
        kinds = ("unknown_source", "conflicting", "late")
        run.until(lambda: sum(used[MOTOR, kind] for kind in kinds) > 50 and recorded[MOTOR, "unknown_source"] > 50)
        run.linkage.done = True
        run.spin_for(0.3)
        recorder.close()
        assert_engine(run)
    found = json.loads(mech_twin("replay", tmp_path / "bag", "--resimulate", "--json").out)
    assert found["identical"] is True and "contradicting" not in found["unused_samples"], found
    with open_bag(tmp_path / "bag") as reader:
        assert reader.topics[f"/{DRUM}/{MOTOR}/copied_source"].message_count == recorded[MOTOR, "unknown_source"]


def shared_by_two(bag: Path, apart: tuple[str, ...]) -> None:
    """Record a run beside a stranger who signs as the motor; nodes that are apart hear bytes, as in another process."""
    with BenchRun(DRUM, recorder=True) as run:
        recorder = run.revive(lambda name, *known: RecorderNode(name, bag, *known))
        nodes = [recorder if role == "recorder" else run.node(role) for role in apart]
        for node in nodes:
            node.leave()
        run.steps(20)
        second_motor(run, stronger, run.node("motor").source)
        run.steps(300)
        run.until(lambda: recorder.statistics.total[MOTOR, "unknown_source"] > 50)
        run.linkage.done = True
        run.spin_for(0.3)
        recorder.close()
        assert_engine(run)
        for node in nodes:
            node.join(HandOver())


@pytest.mark.parametrize("apart", [("recorder",), ("linkage", "force_analysis", "motor", "recorder")])
def test_over_processes_a_stranger_who_signs_as_the_motor_is_told_apart_by_the_numbers_of_the_middleware(
    tmp_path: Path, apart: tuple[str, ...]
) -> None:
    shared_by_two(tmp_path / "bag", apart)
    told = mech_twin("replay", tmp_path / "bag", "--resimulate", "--json")
    found = json.loads(told.out)
    assert found["identical"] is True and "contradicting" not in found["unused_samples"], found
    assert f"/{DRUM}/{MOTOR}: 2 publishers at once" in told.err
    assert f"/{DRUM}/{MOTOR}: 2 publishers at once" in mech_twin("info", tmp_path / "bag").err


def test_a_recording_in_which_two_publishers_were_not_told_apart_is_not_called_different(tmp_path: Path) -> None:
    """As one of a middleware without numbers has it: the copies are among the steps."""
    shared_by_two(tmp_path / "bag", ("recorder",))
    step = f"/{DRUM}/{MOTOR}"
    with (
        BagReader(tmp_path / "bag") as reader,
        BagWriter(tmp_path / "mixed", configuration=reader.info.configuration or "") as writer,
    ):
        for name, topic in reader.topics.items():
            writer.add_topic(name, topic.type_name, offered_qos(durability="volatile", depth=1))
        copies = {step_index(received_message(each.raw)): each.raw for each in reader.messages([f"{step}/{COPIED}"])}
        for message in reader.messages(set(reader.topics) - {f"{step}/{COPIED}"}):
            at_ns = message.log_time_ns
            if message.topic == step and (copy := copies.pop(step_index(received_message(message.raw)), None)):
                writer.write(step, copy, at_ns, at_ns)
            writer.write(message.topic, message.raw, at_ns, at_ns)
        writer.count_publishers(step, 2)
    told = mech_twin("replay", tmp_path / "mixed", "--resimulate", "--json")
    found = json.loads(told.out)
    assert found["unused_samples"]["contradicting"] > 0
    assert found["identical"] is None and f"{step}: 2 publishers at once" in told.err, found


def test_a_second_publisher_of_steps_is_named(tmp_path: Path) -> None:
    with BenchRun(DRUM, recorder=True) as run:
        recorder = run.revive(
            lambda name, parameters, options: RecorderNode(name, tmp_path / "bag", parameters, options)
        )
        run.steps(20)
        run.publisher(STEP_MOTOR)
        told: list[DiagnosticStatus] = []
        run.client.create_subscription(DiagnosticArray, DIAGNOSTICS.name, lambda m: told.extend(m.status), 100)
        words = f"{MOTOR} is published by /{DRUM}/client, /{DRUM}/motor"
        run.until(lambda: any(words in each.message and each.level == DiagnosticStatus.WARN for each in told))
        recorder.close()


def test_of_a_message_rclpy_tells_the_number_its_publisher_gave_it_and_not_its_publisher() -> None:
    rclpy.init(args=[])
    node = rclpy.create_node("apart")
    heard: list[tuple[str, int]] = []
    keys: set[str] = set()

    def hear(message: String, info: dict[str, int]) -> None:
        heard.append((message.data, info["publication_sequence_number"]))
        keys.update(info)

    node.create_subscription(String, "whose", hear, 10)
    speakers = [node.create_publisher(String, "whose", 10) for _ in range(2)]
    end = time.monotonic() + 20.0
    while any(speaker.get_subscription_count() < 1 for speaker in speakers) and time.monotonic() < end:
        time.sleep(0.05)
    for word, speaker in zip("aaba", [*speakers[:1] * 2, speakers[1], speakers[0]], strict=True):
        speaker.publish(String(data=word))
    while len(heard) < 4 and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    rclpy.shutdown()
    assert heard == [("a", 1), ("a", 2), ("b", 1), ("a", 3)]
    assert {key.rpartition("_")[2] for key in keys} == {"timestamp", "number"}, "bind sources to what it tells now"
