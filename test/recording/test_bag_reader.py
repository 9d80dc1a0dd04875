# SPDX-License-Identifier: Apache-2.0
"""Bags are read in order with flat memory, and what is wrong with a bag is said in one line."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import pytest
import yaml
import zstandard
from bag_cases import CONFIGURATION, DESCRIPTION, FORCES, JOINTS, NOTES, TYPES, counts, string_cdr, written
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import CompressionType, IndexType, Writer

from mech_twin.recording import bag_reader
from mech_twin.recording.bag_contents import BagMessage, TopicInfo
from mech_twin.recording.bag_reader import BagReader, bag_info
from mech_twin.recording.errors import (
    BagBeyondLimitsError,
    BagError,
    DamagedBagError,
    DecodeError,
    ForeignFileError,
    MissingBagError,
    OutsideBagError,
    UnfinishedBagError,
)
from mech_twin.recording.message_decoder import MessageDecoder
from mech_twin.recording.recovery import recover
from mech_twin.recording.schemas import message_schema

STRING = message_schema("std_msgs/msg/String")


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return written(tmp_path / "bag", 100, chunk_bytes=4000)


def foreign(path: Path, times: list[int], **options: object) -> Path:
    """Write notes at these times with the bare writer."""
    with path.open("wb") as stream:
        writer = Writer(stream, **options)  # type: ignore[arg-type]
        writer.start(profile="ros2", library="other")
        schema = writer.register_schema(STRING.type_name, "ros2msg", STRING.definition.encode())
        channel = writer.register_channel("/note", "cdr", schema)
        for time in times:
            writer.add_message(channel, time, string_cdr(str(time)), time)
        writer.finish()
    return path


def times_of(path: Path, **selection: object) -> list[int]:
    with BagReader(path) as reader:
        return [message.log_time_ns for message in reader.messages(**selection)]  # type: ignore[arg-type]


def test_info_says_what_the_bag_holds(bag: Path) -> None:
    info = bag_info(bag)
    assert {name: topic.message_count for name, topic in info.topics.items()} == counts(100)
    assert {name: topic.type_name for name, topic in info.topics.items()} == TYPES | {DESCRIPTION: TYPES[NOTES]}
    assert {name: row["written"] for name, row in info.counters.items()} == counts(100)
    assert (info.start_ns, info.duration_s) == (0, pytest.approx(0.099))
    assert info.configuration == CONFIGURATION
    assert info.finished
    assert info.problems == ()
    assert [split.file.name for split in info.splits] == ["bag_0.mcap"]


def test_part_of_a_bag(bag: Path) -> None:
    with BagReader(bag) as reader:
        part = list(reader.messages(topics=[JOINTS, NOTES], start_s=0.02, duration_s=0.03))
    times = [message.log_time_ns for message in part if message.topic == JOINTS]
    assert times == [step * 1_000_000 for step in range(20, 51)]
    assert [m.log_time_ns // 1_000_000 for m in part if m.topic == NOTES] == [20, 30, 40, 50]
    assert {message.topic for message in part} == {JOINTS, NOTES}
    with BagReader(bag) as reader:
        assert list(reader.messages(topics=["/nothing"])) == []
        assert list(reader.messages(start_s=5.0)) == []


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"chunk_size": 300},
        {"chunk_size": 300, "compression": CompressionType.LZ4},
        {"chunk_size": 300, "compression": CompressionType.NONE, "index_types": IndexType.CHUNK},
        {"chunk_size": 300, "index_types": IndexType.NONE},
        {"use_chunking": False},
        {"use_statistics": False, "repeat_channels": False, "repeat_schemas": False},
        {"enable_crcs": False},
    ],
)
def test_foreign_files_are_put_in_order(tmp_path: Path, options: dict[str, object]) -> None:
    times = [(37 * number) % 101 for number in range(101)]
    path = foreign(tmp_path / "foreign.mcap", times, **options)
    assert times_of(path) == list(range(101))
    assert bag_info(path).message_count == 101


def test_an_empty_bag_is_a_bag(tmp_path: Path) -> None:
    assert times_of(written(tmp_path / "own", 0)) == []
    path = foreign(tmp_path / "foreign.mcap", [])
    assert times_of(path) == []
    info = bag_info(path)
    assert (info.message_count, info.start_ns, info.duration_s) == (0, None, 0.0)


def test_disorder_beyond_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = foreign(tmp_path / "foreign.mcap", [0, 1000] * 100, chunk_size=100)
    assert times_of(path) == [0] * 100 + [1000] * 100
    monkeypatch.setattr(bag_reader, "MAX_OPEN_BYTES", 5000)
    with pytest.raises(BagBeyondLimitsError, match="overlap in time"):
        times_of(path)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def flip_in_chunk(path: Path) -> None:
    data = bytearray(path.read_bytes())
    at = data.index(b"zstd") + 200
    data[at] ^= 0x10
    path.write_bytes(data)


def flip_in_summary(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[-60] ^= 0x10
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("harm", "error", "reason"),
    [
        (cut, UnfinishedBagError, "was truncated.*mech-twin recover"),
        (flip_in_chunk, DamagedBagError, "at byte [0-9]+: a chunk .*mech-twin recover"),
        (flip_in_summary, DamagedBagError, "its summary is damaged .*mech-twin recover"),
        (lambda path: path.write_bytes(b""), ForeignFileError, "is empty"),
        (lambda path: path.write_bytes(b"SQLite format 3\0" * 99), ForeignFileError, "is not an MCAP recording"),
    ],
)
def test_damage_is_said_in_one_line(bag: Path, harm: Callable[[Path], None], error: type, reason: str) -> None:
    written(bag.with_name("whole"), 1)
    shutil.copy(bag.with_name("whole") / "whole_0.mcap", bag / "bag_1.mcap")
    file = bag / "bag_0.mcap"
    harm(file)
    with pytest.raises(error, match=reason) as caught:
        times_of(bag)
    assert caught.value.file == file
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "error", "reason"),
    [
        ("{", DamagedBagError, "is not rosbag2 metadata"),
        ("[1, 2]", DamagedBagError, "is not rosbag2 metadata"),
        ("!!python/object/apply:os.system ['true']", DamagedBagError, "is not rosbag2 metadata"),
        ("[" * 5000, DamagedBagError, "is not rosbag2 metadata"),
        (" " * (2 << 20), DamagedBagError, "larger than"),
        ("rosbag2_bagfile_information: {storage_identifier: sqlite3, relative_file_paths: []}", ForeignFileError,
         "storage 'sqlite3'.*ros2 bag convert"),
        ("rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [../../x.mcap]}",
         DamagedBagError, "outside its directory"),
        ("rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [], compression_format: lzma}",
         ForeignFileError, "compression 'lzma': expected zstd"),
    ],
)  # fmt: skip
def test_bad_metadata_is_said_in_one_line(bag: Path, text: str, error: type, reason: str) -> None:
    (bag / "metadata.yaml").write_text(text)
    with pytest.raises(error, match=reason) as caught:
        BagReader(bag)
    assert "\n" not in str(caught.value)
    if error is DamagedBagError:
        assert f"mech-twin recover {bag} OUT" in str(caught.value)
        assert recover(bag, bag.with_name("salvaged")).messages["/twin/joint_states"] == 100


def test_a_missing_bag_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingBagError, match="there is no such bag"):
        BagReader(tmp_path / "none")
    with pytest.raises(MissingBagError, match=r"holds no \.mcap file"):
        BagReader(tmp_path)


def test_an_unfinished_bag_says_how_to_recover_it(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()
    with pytest.raises(UnfinishedBagError, match=f"mech-twin recover {bag} OUT"):
        BagReader(bag)
    info = bag_info(bag)
    assert not info.finished
    assert info.message_count == sum(counts(100).values())
    assert "never closed" in info.problems[0]
    with BagReader(bag, salvage=True) as reader:
        assert sum(1 for _ in reader.messages()) == sum(counts(100).values())


def test_a_damaged_bag_is_read_as_far_as_it_is_intact(bag: Path) -> None:
    flip_in_chunk(bag / "bag_0.mcap")
    with BagReader(bag, salvage=True) as reader:
        saved = list(reader.messages())
        assert 0 < len(saved) < sum(counts(100).values())
        assert {message.topic for message in saved} >= {JOINTS, FORCES}
        assert any("a chunk" in problem for problem in reader.info.problems)


def packed(size_said: int, data: bytes) -> bytes:
    """Return a file of one chunk that lies about its size."""
    builder = RecordBuilder()
    Chunk(compression="zstd", data=data, message_end_time=1, message_start_time=0, uncompressed_crc=0,
          uncompressed_size=size_said).write(builder)  # fmt: skip
    stream = BytesIO()
    writer = Writer(stream)
    writer.start(profile="ros2")
    head = stream.getvalue()
    writer.finish()
    return head + builder.end() + stream.getvalue()[len(head) :]


def test_a_chunk_cannot_unpack_to_more_than_it_says(tmp_path: Path) -> None:
    bomb = zstandard.compress(bytes(1 << 28), 19)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for number, said in enumerate((100, 1 << 28, (1 << 28) + 1, 1 << 40)):
        path = tmp_path / f"bomb_{number}.mcap"
        path.write_bytes(packed(said, bomb[: 1 << 20]))
        with BagReader(path, salvage=True) as reader:
            assert list(reader.messages()) == []
        if said != 1 << 28:
            report = recover(path, tmp_path / f"out_{number}")
            assert report.messages.total() == 0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 700_000


HUGE = 100_000_000_000
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.errors import BagError
from mech_twin.recording.recovery import recover
try:
    with BagReader(sys.argv[1]) as reader:
        list(reader.messages())
except BagError as error:
    print(error)
print(recover(sys.argv[1], sys.argv[2]).messages.total())
"""


def with_huge_chunk(bag: Path) -> Path:
    """Let the first chunk of a file say that it holds 100 GB."""
    file = bag / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    head = data.index(b"zstd") - 4 - 4 - 8  # before the name: its length, the checksum, the size
    data[head : head + 8] = HUGE.to_bytes(8, "little")
    file.write_bytes(data)
    return file


def with_huge_index(bag: Path) -> Path:
    """Let the summary say that every chunk holds 100 GB, its checksum in order."""
    file = bag / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    start = int.from_bytes(data[-8 - 20 : -8 - 12], "little")
    at = start
    while (at := data.find(b"\x04\x00\x00\x00zstd", at)) >= 0:
        data[at + 8 + 8 : at + 8 + 16] = HUGE.to_bytes(8, "little")
        at += 1
    data[-12:-8] = zlib.crc32(data[start:-12]).to_bytes(4, "little")
    file.write_bytes(data)
    return file


def with_huge_record(bag: Path) -> Path:
    """Let the first record say that it is 100 GB long."""
    file = bag / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    data[9:17] = HUGE.to_bytes(8, "little")
    file.write_bytes(data)
    return file


@pytest.mark.parametrize("harm", [with_huge_chunk, with_huge_index, with_huge_record])
def test_a_declared_size_of_100_gb_costs_one_line_and_no_memory(bag: Path, harm: Callable[[Path], Path]) -> None:
    harm(bag)
    words = [sys.executable, "-c", LIMITED, str(bag), str(bag.with_name("out"))]
    run = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert run.returncode == 0, run.stderr
    *complaints, saved = run.stdout.splitlines()
    assert len(complaints) <= 1
    assert int(saved) == sum(counts(100).values()) or harm is with_huge_chunk
    if harm is not with_huge_record:
        assert "100000000000 bytes, more than" in complaints[0]


@pytest.mark.parametrize(
    "name", ["/etc/hostname", "../other/other_0.mcap", "sub/../../x.mcap", "", ".", "..", "sub/x.mcap"]
)
def test_a_path_in_the_metadata_never_leaves_the_bag(bag: Path, name: str) -> None:
    written(bag.with_name("other"), 1)
    page = yaml.safe_load((bag / "metadata.yaml").read_text())
    page["rosbag2_bagfile_information"]["relative_file_paths"] = [name]
    (bag / "metadata.yaml").write_text(yaml.safe_dump(page))
    with pytest.raises(BagError) as caught:
        BagReader(bag)
    assert "\n" not in str(caught.value)
    assert bag_info(bag).problems


def test_a_file_of_the_bag_is_not_a_link_out_of_it(bag: Path) -> None:
    file = bag / "bag_0.mcap"
    file.rename(bag.with_name("outside.mcap"))
    file.symlink_to(bag.with_name("outside.mcap"))
    for read in (BagReader, bag_info, lambda path: recover(path, path.with_name("out"))):
        with pytest.raises(OutsideBagError, match="leads out of the bag's directory"):
            read(bag)
    assert not bag.with_name("out").exists()


def test_a_link_to_a_whole_bag_and_a_link_within_it_are_followed(bag: Path) -> None:
    bag.with_name("link").symlink_to(bag)
    (bag / "bag_0.mcap").rename(bag / "renamed.mcap")
    (bag / "bag_0.mcap").symlink_to("renamed.mcap")
    with BagReader(bag.with_name("link")) as reader:
        assert sum(1 for _ in reader.messages()) == sum(counts(100).values())


@pytest.mark.timeout(20)
def test_a_pipe_in_place_of_a_file_does_not_wait_for_a_writer(bag: Path) -> None:
    (bag / "bag_0.mcap").unlink()
    os.mkfifo(bag / "bag_0.mcap")
    for salvage in (False, True):
        with pytest.raises(BagError):
            BagReader(bag, salvage=salvage)


LARGE = """
import resource, sys
from mech_twin.recording.bag_reader import BagReader
with BagReader(sys.argv[1]) as reader:
    count = sum(len(message.raw) for message in reader.messages())
print(count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_bag(tmp_path: Path) -> None:
    used = []
    for megabytes in (50, 4000):
        path = tmp_path / f"{megabytes}.mcap"
        with path.open("wb") as stream:
            writer = Writer(stream)
            writer.start(profile="ros2")
            channel = writer.register_channel("/x", "cdr", writer.register_schema("x/msg/X", "ros2msg", b""))
            block = bytes(100_000)
            for number in range(megabytes * 10):
                writer.add_message(channel, number, block, number)
            writer.finish()
        run = subprocess.run([sys.executable, "-c", LARGE, str(path)], capture_output=True, text=True, check=True)
        total, peak_kib = map(int, run.stdout.split())
        assert total == megabytes * 1_000_000
        used.append(peak_kib)
    assert used[1] - used[0] < 20_000


def topic(definition: str, name: str = "x_msgs/msg/X") -> TopicInfo:
    return TopicInfo("/x", name, 1, "", "", definition, "ros2msg", "cdr")


@pytest.mark.parametrize(
    ("definition", "raw", "complaint"),
    [
        (STRING.definition, b"", "not a"),
        ("float64[] values", b"\0\1\0\0\xff\xff\xff\x7f", "not a"),
        ("no such text )(", b"", "cannot be read"),
        ("A[] a\n" + "=" * 80 + "\nMSG: x_msgs/A\nint32 ONE=1\n", b"\0\1\0\0\xff\xff\xff\xff", "without fields"),
    ],
)
def test_bytes_of_another_type_are_refused(definition: str, raw: bytes, complaint: str) -> None:
    with pytest.raises(DecodeError, match=complaint):
        MessageDecoder({"/x": topic(definition)}).decode(BagMessage("/x", "x_msgs/msg/X", 0, 0, raw))


def test_errors_are_of_one_family() -> None:
    error = DamagedBagError(Path("a.mcap"), "two\nlines")
    assert isinstance(error, BagError)
    assert str(error).startswith("a.mcap: two lines; salvage the intact part")
