# SPDX-License-Identifier: Apache-2.0
"""Messages recorded, read and recovered per second, beside the bare `mcap` writer and other readers, in turn.

Every writer gets the same joint states (12 joints, some 400 bytes) into zstd chunks of 256 KiB; ours also keeps
counters, hands every chunk to the operating system and can split.  ``python benchmarks/recording.py [--write]``.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from comparison import Table, Times, in_turn, measure, ratio
from mcap.reader import make_reader
from mcap.writer import Writer
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState

from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_writer import BagWriter
from mech_twin.recording.recovery import recover
from mech_twin.recording.schemas import message_schema

MESSAGES, ROUNDS = 50_000, 7
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


def read_ours(bag: Path) -> int:
    with BagReader(bag) as reader:
        return sum(1 for _ in reader.messages())


def read_mcap(bag: Path) -> int:
    with (bag / f"{bag.name}_0.mcap").open("rb") as stream:
        return sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())


def read_rosbags(bag: Path) -> int:
    with Reader(bag) as reader:
        return sum(1 for _ in reader.messages())


def emptied(write: Callable[[Path], None], place: Path) -> Callable[[], None]:
    """Return a task that writes into a place where nothing is."""

    def task() -> None:
        if place.is_dir():
            shutil.rmtree(place)
        write(place)

    return task


def counted(read: Callable[[Path], int], bag: Path) -> Callable[[], None]:
    """Return a task that reads a bag and ends the benchmark if messages are missing."""

    def task() -> None:
        found = read(bag)
        if found != MESSAGES:
            raise SystemExit(f"recording: {read.__name__} found {found} of {MESSAGES} messages")

    return task


def rows_of(times: Times, ours: str) -> list[tuple[object, ...]]:
    """Return a row for each task: messages a second of the best round, and its time over ours."""
    return [
        (name, f"{MESSAGES / min(spent):.0f}", "" if name == ours else ratio(times, name, ours))
        for name, spent in times.items()
    ]


def measured() -> list[Table]:
    """Return the tables of writing, and of reading and recovering."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        writers = {
            "ours": emptied(ours, place / "ours"),
            "bare `mcap` writer": emptied(bare, place / "bare.mcap"),
            "ours, every chunk forced to the disk": emptied(ours_forced, place / "forced"),
        }
        written = in_turn(writers, ROUNDS, time.perf_counter)
        readers = {"ours": read_ours, "`mcap` reader": read_mcap, "rosbags": read_rosbags}
        read = in_turn({name: counted(f, place / "ours") for name, f in readers.items()}, ROUNDS, time.perf_counter)
        cut = place / "ours" / "ours_0.mcap"
        cut.write_bytes(cut.read_bytes()[:-100])
        task = emptied(lambda out: recover(place / "ours", out), place / "recovered")
        recovered = in_turn({"recovery of a file without its end": task}, 3, time.perf_counter)
    how = f"{MESSAGES} messages, wall clock, {ROUNDS} rounds in turn; last column: its time over ours."
    columns = ("messages a second", "ratio (spread)")
    return [
        Table(f"Writing {how}", ("writer", *columns), rows_of(written, "ours")),
        Table(
            f"Reading {how}", ("reader", *columns), [*rows_of(read, "ours"), *rows_of(recovered, next(iter(recovered)))]
        ),
    ]


if __name__ == "__main__":
    measure("recording", measured)
