# SPDX-License-Identifier: Apache-2.0
"""A replay publishes what was recorded: in order, once, with its quality of service, and says what it leaves out."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from catalogue import NAMES, built
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from recordings import LATCHED_QOS, PLAIN_QOS, Entry, altered_bag, entries_of, simulated_bag, written_bag
from replay_bench import ReplayBench
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.replay.source import ReplaySource
from mech_twin.nodes.roles.answering_nodes import ForceNode
from mech_twin.nodes.run.domain import replay_arguments
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.errors import BagError

pytestmark = pytest.mark.usefixtures("ros_domain")
DRUM = "winding_drum"
STATES = f"/{DRUM}/step/linkage"
DESCRIPTION = f"/{DRUM}/description"
STRING = "std_msgs/msg/String"
MS = 1_000_000


def text(words: str) -> bytes:
    return bytes(serialize_message(String(data=words)))


def words(raw: bytes) -> str:
    return str(deserialize_message(raw, String).data)


def steps(raws: Iterable[bytes]) -> list[int]:
    stamps = [deserialize_message(raw, JointState).header.stamp for raw in raws]
    return [round((stamp.sec + stamp.nanosec * 1e-9) * 1e3) for stamp in stamps]


@pytest.fixture(scope="module")
def drum_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    bag = tmp_path_factory.mktemp("drum") / "bag"
    simulated_bag(DRUM, 0.5, bag)
    return bag


@pytest.fixture(scope="module")
def impact_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    bag = tmp_path_factory.mktemp("impact") / "bag"
    simulated_bag("impact_mass", 0.5, bag)
    return bag


@pytest.mark.parametrize("name", NAMES)
def test_every_message_is_heard_once_and_in_order(name: str, tmp_path: Path) -> None:
    frames = simulated_bag(name, 0.2, tmp_path / "bag")
    with ReplayBench(tmp_path / "bag", rate=2.0) as bench:
        bench.to_the_end()
        recorded = entries_of(tmp_path / "bag")
        for topic in bench.source.topics:
            assert bench.of(topic) == [entry.raw for entry in recorded if entry.topic == topic], topic
        assert len(bench.of(f"/{name}/step/linkage")) == len(frames)


def test_a_topic_is_offered_as_it_was_recorded(drum_bag: Path) -> None:
    with ReplayBench(drum_bag) as bench:
        description = bench.node.get_publishers_info_by_topic(DESCRIPTION)[0].qos_profile
        states = bench.node.get_publishers_info_by_topic(STATES)[0].qos_profile
        assert description.durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert states.durability == DurabilityPolicy.VOLATILE
        assert description.reliability == states.reliability == ReliabilityPolicy.RELIABLE


def test_only_the_topics_asked_for_are_replayed(drum_bag: Path) -> None:
    with ReplayBench(drum_bag, topics=("step/linkage", "/clock"), rate=10.0) as bench:
        bench.to_the_end()
        assert {heard.topic for heard in bench.heard} == {STATES, "/clock"}


def test_a_part_is_replayed_with_the_description_in_force(drum_bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is sent first; messages of two topics may be heard in another order than they were sent."""
    sent: list[str] = []
    with ReplayBench(drum_bag, start_s=0.2, duration_s=0.1, rate=2.0) as bench:
        for name, output in bench.node.outputs.items():

            def send(raw: bytes, name: str = name, send: Callable[[bytes], None] = output.send) -> None:
                sent.append(name)
                send(raw)

            monkeypatch.setattr(output, "send", send)
        bench.to_the_end()
        assert steps(bench.of(STATES)) == list(range(200, 301))
        assert len(bench.of(DESCRIPTION)) == 1
        assert sent[0] == DESCRIPTION


def latched_bag(directory: Path) -> Path:
    """Write a bag whose latched topics change on the way; one of them speaks late for the first time."""
    plain = [Entry("/steps", STRING, i * 10 * MS, text(str(i)), PLAIN_QOS) for i in range(20)]
    latched = [
        Entry("/name", STRING, 0, text("first"), LATCHED_QOS),
        Entry("/name", STRING, 100 * MS, text("second"), LATCHED_QOS),
        Entry("/late", STRING, 150 * MS, text("late"), LATCHED_QOS),
    ]
    return written_bag(directory, sorted([*plain, *latched], key=lambda entry: entry.log_time_ns))


def test_each_loop_begins_with_the_latched_messages_of_its_beginning(tmp_path: Path) -> None:
    with ReplayBench(latched_bag(tmp_path / "bag"), loop=True) as bench:
        bench.until(lambda: bench.node.loops >= 2)
        names = [words(raw) for raw in bench.of("/name")]
        assert names[:4] == ["first", "second", "first", "second"]


def test_a_loop_leaves_no_stale_latched_message_behind(tmp_path: Path) -> None:
    with ReplayBench(latched_bag(tmp_path / "bag"), loop=True) as bench:
        bench.until(lambda: bench.node.loops == 1)
        assert bench.ask("pause").success
        before = Counter(heard.topic for heard in bench.heard)
        assert before["/late"] == 1
        bench.listen("/late", String, latched=True)
        bench.listen("/name", String, latched=True)
        bench.until(lambda: len(bench.of("/name")) > before["/name"])
        bench.for_a_while(0.3)
        assert words(bench.of("/name")[-1]) == "first"
        assert len(bench.of("/late")) == 1


def test_time_never_goes_back_unannounced(drum_bag: Path) -> None:
    with ReplayBench(drum_bag, loop=True, rate=4.0, topics=("step/linkage",)) as bench:
        bench.until(lambda: bench.node.loops >= 2 and len(bench.heard) > 1100)
        heard = steps(bench.of(STATES))  # what is heard may lag behind the loops, and what is told behind both
        falls = [i for i in range(1, len(heard)) if heard[i] < heard[i - 1]]
        assert len(falls) >= 2
        bench.until(lambda: sum("jumps back" in line for _, line in bench.announced) >= len(falls))
        assert sum("jumps back" in line for _, line in bench.announced) <= bench.node.loops
        assert all(heard[i - 1] == 500 and heard[i] == 0 for i in falls)


def test_a_recorded_clock_that_goes_back_by_itself_is_announced(tmp_path: Path) -> None:
    times = [0, 10, 20, 5, 15]
    clocks = [bytes(serialize_message(clock(milliseconds))) for milliseconds in times]
    entries = [Entry("/clock", "rosgraph_msgs/msg/Clock", i * 10 * MS, raw) for i, raw in enumerate(clocks)]
    with ReplayBench(written_bag(tmp_path / "bag", entries)) as bench:
        bench.to_the_end()
        bench.until(lambda: any("recorded clock jumps back" in line for _, line in bench.announced))


def clock(milliseconds: int) -> Clock:
    message = Clock()
    message.clock.nanosec = milliseconds * MS
    return message


def test_the_clock_told_in_place_of_the_recorded_one_runs_evenly(drum_bag: Path) -> None:
    with ReplayBench(drum_bag, clock=True, rate=2.0) as bench:
        assert "/clock" not in bench.source.topics
        bench.listen("/clock", Clock)
        bench.until(lambda: bench.node._clock_out.get_subscription_count() == 1)
        bench.to_the_end()
        bench.for_a_while(0.1)
        stamps = [deserialize_message(raw, Clock).clock for raw in bench.of("/clock")]
        times = [stamp.sec * 1000 * MS + stamp.nanosec for stamp in stamps]
        assert times == sorted(set(times))
        assert times[0] == 0
        assert times[-1] > 480 * MS
        assert max(b - a for a, b in itertools.pairwise(times)) < 120 * MS


def test_the_clock_told_in_place_of_the_recorded_one_does_not_wait_for_messages(tmp_path: Path) -> None:
    entries = [Entry("/sparse", STRING, at_s * 1000 * MS, text("here")) for at_s in (0, 10)]
    with ReplayBench(written_bag(tmp_path / "bag", entries), clock=True, rate=0.5) as bench:
        bench.until(lambda: len(bench.heard) == 1)
        assert bench.node.tick() <= 0.010 / 0.5


def test_it_stands_still_while_paused_and_loses_nothing(drum_bag: Path) -> None:
    with ReplayBench(drum_bag, topics=("step/linkage",)) as bench:
        bench.until(lambda: len(bench.heard) > 50)
        assert bench.ask("pause").success
        bench.for_a_while(0.1)
        position, number = bench.node.position_ns, len(bench.heard)
        bench.for_a_while(0.2)
        assert (bench.node.position_ns, len(bench.heard)) == (position, number)
        assert bench.ask("resume").success
        bench.to_the_end()
        assert steps(bench.of(STATES)) == list(range(501))


def test_it_goes_to_a_time_back_and_forth(drum_bag: Path) -> None:
    with ReplayBench(drum_bag, topics=("step/linkage",)) as bench:
        bench.until(lambda: len(bench.heard) > 20)
        bench.ask("pause")
        bench.for_a_while(0.1)
        played = len(bench.heard)
        assert bench.set_parameter("seek_s", 0.4).successful
        assert bench.node.position_s == pytest.approx(0.4, abs=1e-9)
        assert bench.set_parameter("seek_s", 0.3).successful
        bench.until(lambda: len(bench.announced) >= 2)
        lines = [line for _, line in bench.announced if "jumps" in line]
        assert "forward" in lines[0] and "back from 0.400000 s to 0.300000 s (seek)" in lines[1]
        bench.ask("resume")
        bench.to_the_end()
        assert steps(bench.of(STATES)[played:]) == list(range(300, 501))


def test_it_goes_from_impact_to_impact(impact_bag: Path) -> None:
    with ReplayBench(impact_bag) as bench:
        bench.ask("pause")
        times = sorted(
            {entry.log_time_ns for entry in entries_of(impact_bag) if entry.topic.endswith("/impacts") and blow(entry)}
        )
        bench.until(lambda: bench.node.tick() > 1.0)
        for expected in [time for time in times if time > 0][:3]:
            answer = bench.ask("next_impact")
            assert answer.success, answer.message
            assert bench.node.position_ns == expected
        bench.set_parameter("seek_s", 0.5)
        answer = bench.ask("next_impact")
        assert not answer.success
        assert answer.message == "no impact after 0.500000 s"


def blow(entry: Entry) -> bool:
    from geometry_msgs.msg import Vector3Stamped

    return bool(deserialize_message(entry.raw, Vector3Stamped).vector.z != 0.0)


def test_its_rate_changes_while_it_runs(drum_bag: Path) -> None:
    with ReplayBench(drum_bag, topics=("step/linkage",), rate=0.01) as bench:
        bench.until(lambda: len(bench.heard) >= 1)
        assert bench.set_parameter("rate", 50.0).successful
        bench.to_the_end()
        assert steps(bench.of(STATES)) == list(range(501))


@pytest.mark.parametrize(
    ("name", "value"), [("rate", 0.0), ("rate", float("nan")), ("rate", 1e9), ("seek_s", 0.6), ("seek_s", -0.1)]
)
def test_a_bad_rate_or_time_is_refused_with_a_reason(drum_bag: Path, name: str, value: float) -> None:
    with ReplayBench(drum_bag) as bench:
        result = bench.set_parameter(name, value)
        assert not result.successful
        assert result.reason
        assert bench.node.rate == 1.0


def test_garbage_is_skipped_and_counted(drum_bag: Path, tmp_path: Path) -> None:
    def damaged(entry: Entry) -> Iterable[Entry]:
        bad = entry.topic == STATES and entry.log_time_ns % (50 * MS) == 0
        return (entry._replace(raw=b"\x00\x01\x00\x00\xff\xff\xff\x7f\xff"),) if bad else (entry,)

    with ReplayBench(altered_bag(drum_bag, tmp_path / "bag", damaged), rate=4.0) as bench:
        bench.to_the_end()
        assert steps(bench.of(STATES)) == [step for step in range(501) if step % 50]
        assert bench.source.malformed == {STATES: 11}


def test_an_unknown_type_is_left_out_and_said(drum_bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mech_twin.recording import schemas
    from mech_twin.recording.errors import UnknownTypeError

    installed = schemas.message_schema

    def without_strings(type_name: str) -> object:
        if type_name == STRING:
            raise UnknownTypeError(f"type '{type_name}': not installed")
        return installed(type_name)

    monkeypatch.setattr(schemas, "message_schema", without_strings)
    with ReplayBench(drum_bag, rate=4.0) as bench:
        bench.to_the_end()
        reason = f"type '{STRING}': not installed"
        assert bench.source.unknown == {DESCRIPTION: reason, f"/{DRUM}/robot_description": reason}
        assert not bench.of(DESCRIPTION)
        assert len(bench.of(STATES)) == 501


def test_an_empty_part_is_refused(drum_bag: Path, tmp_path: Path) -> None:
    with BagReader(drum_bag) as reader:
        with pytest.raises(BagError, match=r"lasts 0\.5 s; --start 3 is beyond its end"):
            ReplaySource(reader, start_s=3.0)
        with pytest.raises(BagError, match="has no topic 'nonsense'"):
            ReplaySource(reader, ["nonsense"])
    with BagReader(written_bag(tmp_path / "empty", [])) as reader, pytest.raises(BagError, match="holds no messages"):
        ReplaySource(reader)


@pytest.mark.parametrize("space", ["", "/drum", "/hall/line_2/drum"])
def test_topics_are_named_and_moved_below_the_namespace_of_their_machine(
    drum_bag: Path, tmp_path: Path, space: str
) -> None:
    def moved(entry: Entry) -> list[Entry]:
        return [entry._replace(topic=entry.topic.replace(f"/{DRUM}", space))]

    with BagReader(altered_bag(drum_bag, tmp_path / "bag", moved)) as reader:
        source = ReplaySource(reader, ["step/linkage", "motor/joint_states", "/clock"])
        assert [*source.topics] == [f"{space}/step/linkage", f"{space}/motor/joint_states", "/clock"]
        rules = replay_arguments({name: source.below(name) for name in source.topics}, "other/place")[4::2]
        assert [rule.partition(":=")[2] for rule in rules] == [
            f"/other/place/{name}" for name in ("step/linkage", "motor/joint_states", "clock")
        ]


def test_the_force_analysis_alone_answers_a_replay_with_the_recorded_forces(tmp_path: Path) -> None:
    frames = simulated_bag(DRUM, 0.1, tmp_path / "bag")
    with ReplayBench(tmp_path / "bag", topics=("step/linkage", "description"), rate=0.5, listeners=2) as bench:
        options = RunOptions(discovery_limit_s=0.2)
        node = ForceNode(DRUM, built(DRUM).parameters, options)
        answers: list[object] = []
        node.on_sample = answers.append
        bench.add(node)
        bench.to_the_end()
        bench.until(lambda: len(answers) == len(frames))
        assert answers == [frame.forces for frame in frames]
