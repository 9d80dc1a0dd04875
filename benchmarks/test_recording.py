# SPDX-License-Identifier: Apache-2.0
"""Messages recorded and read per second, beside the bare `mcap` writer and other readers, in the same run.

Every writer gets the same joint states (12 joints, some 400 bytes) into zstd chunks of 256 KiB; ours also keeps
counters, hands every chunk to the operating system and can split.  Run `pytest benchmarks/test_recording.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from pytest_benchmark.fixture import BenchmarkFixture
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState

from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_writer import BagWriter
from mech_twin.recording.recovery import recover
from mech_twin.recording.schemas import message_schema

MESSAGES = 50_000
CHUNK_BYTES = 256 * 1024
JOINT_STATE = message_schema("sensor_msgs/msg/JointState")


def encoded() -> list[bytes]:
    """Return joint states that differ as those of a run do."""
    names = [f"joint_{number}" for number in range(12)]
    return [
        bytes(serialize_message(JointState(name=names, position=[0.001 * k * j for j in range(12)],
                                           velocity=[1.0 / (k + j + 1) for j in range(12)],
                                           effort=[float(k % (j + 7)) for j in range(12)])))
        for k in range(1000)
    ]  # fmt: skip


RAW = encoded()


def bare(path: Path) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK_BYTES)
        writer.start(profile="ros2")
        schema = writer.register_schema(JOINT_STATE.type_name, "ros2msg", JOINT_STATE.definition.encode())
        channel = writer.register_channel("/joints", "cdr", schema)
        for number in range(MESSAGES):
            writer.add_message(channel, number * 250_000, RAW[number % 1000], number * 250_000)
        writer.finish()


def ours(path: Path, *, fsync: bool = False) -> None:
    with BagWriter(path, configuration="a: 1", fsync=fsync) as writer:
        writer.add_topic("/joints", JOINT_STATE.type_name)
        for number in range(MESSAGES):
            writer.write("/joints", RAW[number % 1000], number * 250_000, number * 250_000)


def ours_forced(path: Path) -> None:
    ours(path, fsync=True)


@pytest.mark.benchmark(group=f"write {MESSAGES} messages")
@pytest.mark.parametrize("write", [bare, ours, ours_forced])
def test_write(benchmark: BenchmarkFixture, tmp_path: Path, write: Callable[[Path], None]) -> None:
    places = iter(tmp_path / f"bag_{number}" for number in range(1000))
    benchmark.pedantic(lambda: write(next(places)), rounds=5, warmup_rounds=1)


def read_ours(bag: Path) -> int:
    with BagReader(bag) as reader:
        return sum(1 for _ in reader.messages())


def read_mcap(bag: Path) -> int:
    with (bag / f"{bag.name}_0.mcap").open("rb") as stream:
        return sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())


def read_rosbags(bag: Path) -> int:
    with Reader(bag) as reader:
        return sum(1 for _ in reader.messages())


@pytest.mark.benchmark(group=f"read {MESSAGES} messages")
@pytest.mark.parametrize("read", [read_ours, read_mcap, read_rosbags])
def test_read(benchmark: BenchmarkFixture, tmp_path: Path, read: Callable[[Path], int]) -> None:
    ours(tmp_path / "bag")
    assert benchmark.pedantic(read, args=(tmp_path / "bag",), rounds=5, warmup_rounds=1) == MESSAGES


@pytest.mark.benchmark(group=f"recover {MESSAGES} messages")
def test_recover(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    ours(tmp_path / "bag")
    file = tmp_path / "bag" / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[:-100])
    places = iter(tmp_path / f"out_{number}" for number in range(1000))
    benchmark.pedantic(lambda: recover(tmp_path / "bag", next(places)), rounds=3)
