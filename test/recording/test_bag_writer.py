# SPDX-License-Identifier: Apache-2.0
"""A recording loses a bounded, counted amount, overwrites nothing, and every split of it opens alone."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
import yaml
from bag_cases import CONFIGURATION, DESCRIPTION, JOINTS, NOTES, TYPES, counts, joint_state, raw_of, string_cdr, written
from mcap.reader import make_reader

from mech_twin.recording.bag_metadata import running_distro
from mech_twin.recording.bag_reader import BagReader, bag_info
from mech_twin.recording.bag_split import TopicCounters
from mech_twin.recording.bag_writer import BagWriter, WriterState
from mech_twin.recording.errors import BagExistsError, UnknownTypeError, UnwritableDirectoryError


class Clock:
    """A clock that a test turns."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def on_disk(bag: Path) -> int:
    return bag_info(bag).message_count


def test_age_alone_closes_a_chunk(tmp_path: Path) -> None:
    clock = Clock()
    writer = BagWriter(tmp_path / "bag", configuration="", max_loss_s=0.5, clock=clock)
    writer.add_topic(NOTES, TYPES[NOTES])
    writer.write(NOTES, string_cdr("slow"), 0, 0)
    assert on_disk(tmp_path / "bag") == 0
    clock.now = 0.29
    writer.tick()
    assert on_disk(tmp_path / "bag") == 0
    clock.now = 0.31
    writer.tick()
    assert on_disk(tmp_path / "bag") == 1
    writer.tick(0.9)
    writer.write(NOTES, string_cdr("second"), 1, 1)
    clock.now = 0.9
    writer.write(NOTES, string_cdr("third"), 2, 2)
    assert on_disk(tmp_path / "bag") == 3
    writer.close()


def test_size_closes_a_chunk(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", configuration="", chunk_bytes=1000, clock=Clock())
    writer.add_topic(JOINTS, TYPES[JOINTS])
    for number in range(20):
        writer.write(JOINTS, joint_state(number), number, number)
    assert on_disk(tmp_path / "bag") >= 14
    writer.close()


def test_counters_are_in_the_file_with_each_chunk(tmp_path: Path) -> None:
    clock = Clock()
    writer = BagWriter(tmp_path / "bag", configuration="", clock=clock)
    writer.add_topic(NOTES, TYPES[NOTES])
    writer.write(NOTES, string_cdr("one"), 0, 0)
    writer.count_missed(NOTES, 3)
    writer.count_late(NOTES, 2)
    writer.count_publishers(NOTES, 2)
    writer.count_publishers(NOTES, 1)
    clock.now = 1.0
    writer.tick()
    expected = {"received": 1, "written": 1, "dropped": 0, "missed": 3, "late": 2, "publishers": 2}
    assert bag_info(tmp_path / "bag").counters == {NOTES: expected}
    writer.count_missed(NOTES, 1)
    clock.now = 2.0
    writer.tick()
    assert bag_info(tmp_path / "bag").counters == {NOTES: expected | {"missed": 4}}
    writer.close()
    assert bag_info(tmp_path / "bag").counters == {NOTES: expected | {"missed": 4}}
    assert writer.counters == {NOTES: TopicCounters(1, 1, 0, 4, 2, 2)}


def test_every_split_by_size_opens_alone(tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 2000, split_bytes=20_000, chunk_bytes=8_000)
    files = sorted(bag.glob("*.mcap"))
    assert len(files) > 3
    for file in files:
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            first = next(channel.topic for _, channel, _ in reader.iter_messages())
            assert first == DESCRIPTION
            assert {schema.name for schema in reader.get_summary().schemas.values()} == set(TYPES.values())
            assert [a.data.decode() for a in reader.iter_attachments()] == [CONFIGURATION]
        with BagReader(file) as alone:
            assert alone.topics[DESCRIPTION].message_count == 1
    with BagReader(bag) as whole:
        assert {name: topic.message_count for name, topic in whole.topics.items()} == counts(2000)
        assert sum(1 for _ in whole.messages()) == sum(counts(2000).values())


def test_splits_by_duration_are_all_listed(tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 1000, split_duration_s=0.3)
    text = (bag / "metadata.yaml").read_text()
    assert "&" not in text
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert information["version"] == 9
    assert information["relative_file_paths"] == [f"bag_{number}.mcap" for number in range(4)]
    assert [file["starting_time"]["nanoseconds_since_epoch"] for file in information["files"]] == [
        0, 300_000_000, 600_000_000, 900_000_000,
    ]  # fmt: skip
    assert [file["duration"]["nanoseconds"] for file in information["files"]] == [299_000_000] * 3 + [99_000_000]
    assert information["duration"]["nanoseconds"] == 999_000_000
    assert information["message_count"] == sum(counts(1000).values()) + 3  # the description, repeated
    assert sum(file["message_count"] for file in information["files"]) == information["message_count"]
    assert information["ros_distro"] == running_distro()
    assert information["custom_data"]["mech_twin.finished"] == "true"


def test_latched_messages_are_repeated_as_they_last_were(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", configuration="", split_duration_s=1.0) as writer:
        writer.add_topic(NOTES, TYPES[NOTES])
        writer.add_topic(JOINTS, TYPES[JOINTS])
        for text in ("old", "new"):
            writer.write(NOTES, string_cdr(text), 0, 0, latched=True)
        raw = joint_state(1)  # once: its padding holds stale bytes
        writer.write(JOINTS, joint_state(0), 0, 0)
        writer.write(JOINTS, raw, 2_000_000_000, 2_000_000_000)
    with BagReader(tmp_path / "bag" / "bag_1.mcap") as alone:
        assert [(m.topic, m.raw, m.log_time_ns) for m in alone.messages()] == [
            (NOTES, string_cdr("new"), 2_000_000_000),
            (JOINTS, raw, 2_000_000_000),
        ]
    with BagReader(tmp_path / "bag") as whole:
        assert [m.topic for m in whole.messages()] == [NOTES, NOTES, JOINTS, JOINTS]


@pytest.mark.parametrize("finished", [True, False])
def test_nothing_is_overwritten(tmp_path: Path, finished: bool) -> None:
    bag = written(tmp_path / "bag", 5)
    if not finished:
        (bag / "metadata.yaml").unlink()
    before = {path: path.read_bytes() for path in bag.iterdir()}
    with pytest.raises(BagExistsError, match="nothing is overwritten"):
        BagWriter(bag, configuration="")
    assert {path: path.read_bytes() for path in bag.iterdir()} == before


def test_an_empty_directory_is_used(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with BagWriter(tmp_path / "bag", configuration="a: 1"):
        pass
    info = bag_info(tmp_path / "bag")
    assert (info.message_count, info.finished, info.configuration) == (0, True, "a: 1")


@pytest.mark.parametrize("place", ["file/bag", "/proc/bag", "/proc/deep/bag"])
def test_an_unwritable_directory_is_named(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UnwritableDirectoryError) as caught:
        BagWriter(tmp_path / place, configuration="")
    assert str(tmp_path / place) in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_failed_start_leaves_no_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(UnwritableDirectoryError, match="No space left"):
        BagWriter(tmp_path / "deep" / "bag", configuration="")
    assert list(tmp_path.iterdir()) == []


def test_misuse_is_refused_by_name(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", configuration="") as writer:
        writer.add_topic(NOTES, TYPES[NOTES])
        writer.add_topic(NOTES, TYPES[NOTES])
        with pytest.raises(ValueError, match="is of std_msgs/msg/String"):
            writer.add_topic(NOTES, TYPES[JOINTS])
        with pytest.raises(UnknownTypeError):
            writer.add_topic("/x", "no_msgs/msg/None")
        with pytest.raises(ValueError, match="/y was not added"):
            writer.write("/y", b"", 0, 0)
    assert writer.state is WriterState.CLOSED
    with pytest.raises(ValueError, match="is closed"):
        writer.write(NOTES, b"", 0, 0)
    writer.close()


def test_topics_may_come_at_any_time(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", configuration="", chunk_bytes=2000) as writer:
        for number, topic in enumerate(TYPES):
            writer.add_topic(topic, TYPES[topic])
            for step in range(30):
                writer.write(topic, raw_of(topic, step), 100 * number + step, 0)
    with BagReader(tmp_path / "bag") as reader:
        assert {name: topic.message_count for name, topic in reader.topics.items()} == dict.fromkeys(TYPES, 30)


def test_threads_share_a_writer(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", configuration="", chunk_bytes=4000, split_bytes=20_000) as writer:
        for topic, type_name in TYPES.items():
            writer.add_topic(topic, type_name)

        def feed(topic: str) -> None:
            for number in range(500):
                writer.write(topic, raw_of(topic, number), number, number)
                writer.tick()

        threads = [threading.Thread(target=feed, args=(topic,)) for topic in TYPES]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    with BagReader(tmp_path / "bag") as reader:
        assert {name: topic.message_count for name, topic in reader.topics.items()} == dict.fromkeys(TYPES, 500)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
@pytest.mark.parametrize("fsync", [True, False])
def test_storage_options(tmp_path: Path, compression: str, fsync: bool) -> None:
    bag = written(tmp_path / "bag", 50, compression=compression, fsync=fsync, chunk_bytes=4000)
    with BagReader(bag) as reader:
        assert sum(1 for _ in reader.messages()) == sum(counts(50).values())


def test_a_recording_of_nothing_but_latched_messages_is_deleted_on_request(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a" / "bag", configuration="a: 1") as writer:
        writer.add_topic(NOTES, TYPES[NOTES])
        writer.write(NOTES, string_cdr("latched"), 0, 0, latched=True)
        writer.close(discard_empty=True)
        assert writer.state is WriterState.CLOSED
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "bag").mkdir()
    with BagWriter(tmp_path / "bag", configuration="a: 1") as writer:
        writer.add_topic(NOTES, TYPES[NOTES])
        writer.close(discard_empty=True)
    assert list((tmp_path / "bag").iterdir()) == []


def test_one_message_is_enough_to_keep_a_recording(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", configuration="a: 1") as writer:
        writer.add_topic(NOTES, TYPES[NOTES])
        writer.write(NOTES, string_cdr("x"), 0, 0)
        writer.close(discard_empty=True)
    with BagReader(tmp_path / "bag") as reader:
        assert reader.info.message_count == 1


def test_a_recording_is_not_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "bag").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BagExistsError):
        BagWriter(tmp_path / "bag", configuration="")
    assert list((tmp_path / "elsewhere").iterdir()) == []
