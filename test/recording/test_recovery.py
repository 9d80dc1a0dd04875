# SPDX-License-Identifier: Apache-2.0
"""Whatever happens to a file, what is intact of it comes back, and what is lost is said."""

from __future__ import annotations

import random
import shutil
from collections import Counter
from pathlib import Path

import pytest
from bag_cases import CONFIGURATION, DESCRIPTION, FORCES, JOINTS, NOTES, TYPES, counts, string_cdr, written
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader

from mech_twin.files.input_file import UnboundedYamlError, bounded_yaml
from mech_twin.recording.bag_reader import BagReader, bag_info
from mech_twin.recording.bag_writer import BagWriter
from mech_twin.recording.errors import (
    BagExistsError,
    DamagedBagError,
    ForeignFileError,
    MissingBagError,
    UnfinishedBagError,
    UnwritableDirectoryError,
)
from mech_twin.recording.record_file import RecordFile
from mech_twin.recording.recovery import RecoveryReport, recover

_ONE_BIT_FROM_A_MESSAGE = {Opcode.HEADER, Opcode.CHANNEL, Opcode.MESSAGE_INDEX, Opcode.METADATA_INDEX}


class Sound:
    """A sound bag of small chunks, and where its records lie."""

    def __init__(self, directory: Path, steps: int, chunk_bytes: int) -> None:
        self.bag = written(directory / "bag", steps, chunk_bytes=chunk_bytes)
        self.file = self.bag / "bag_0.mcap"
        self.data = self.file.read_bytes()
        with self.file.open("rb") as stream:
            summary = SeekingReader(stream).get_summary()
        assert summary is not None
        self.chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
        with BagReader(self.bag) as reader:
            self.messages = [(m.topic, m.log_time_ns, m.raw) for m in reader.messages()]

    def whole_chunks(self, size: int) -> int:
        return sum(chunk.chunk_start_offset + chunk.chunk_length <= size for chunk in self.chunks)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Sound:
    return Sound(tmp_path_factory.mktemp("sound"), 60, 2500)


def recovered(data: bytes, tmp_path: Path) -> tuple[RecoveryReport, list[tuple[str, int, bytes]]]:
    """Recover a file of these bytes; return the report and the messages of the new bag."""
    damaged, out = tmp_path / "damaged.mcap", tmp_path / "out"
    shutil.rmtree(out, ignore_errors=True)
    damaged.write_bytes(data)
    report = recover(damaged, out)
    with BagReader(out) as reader:
        messages = [(m.topic, m.log_time_ns, m.raw) for m in reader.messages()]
        assert reader.info.finished
    assert report.messages.total() == len(messages)
    return report, messages


def test_a_sound_bag_comes_back_whole(sound: Sound, tmp_path: Path) -> None:
    report = recover(sound.bag, tmp_path / "out")
    assert report.messages == Counter(counts(60))
    assert (report.bytes_skipped, report.messages_of_lost_topics, report.damages) == (0, 0, [])
    info = bag_info(tmp_path / "out")
    assert info.configuration == CONFIGURATION
    assert info.counters == bag_info(sound.bag).counters
    assert {name: topic.type_hash for name, topic in info.topics.items()} == {
        name: topic.type_hash for name, topic in bag_info(sound.bag).topics.items()
    }
    assert report.lines()[0].endswith(f"salvaged {sum(counts(60).values())} messages of 4 topics from {sound.bag}")


@pytest.mark.slow
def test_cut_at_every_byte_of_the_last_two_chunks(tmp_path: Path) -> None:
    sound = Sound(tmp_path / "sound", 16, 700)  # as short as eight chunks can be: each byte costs a recovery
    assert len(sound.chunks) > 4
    per_chunk: dict[int, int] = {}
    for size in range(sound.chunks[-2].chunk_start_offset, len(sound.data)):
        chunks = sound.whole_chunks(size)
        if size > sound.chunks[-1].chunk_start_offset + sound.chunks[-1].chunk_length and size % 97:
            continue  # the summary: all is saved already, a sample will do
        report, messages = recovered(sound.data[:size], tmp_path)
        assert messages == sound.messages[: len(messages)]
        assert per_chunk.setdefault(chunks, len(messages)) == len(messages)
        assert report.bytes_read == size
        assert any("truncated" in damage for damage in report.damages)
    assert sorted(per_chunk.values()) == list(per_chunk.values())
    assert len(per_chunk) == 3
    assert per_chunk[len(sound.chunks)] == len(sound.messages)


@pytest.mark.slow
def test_cut_anywhere(sound: Sound, tmp_path: Path) -> None:
    source = random.Random(1)
    for size in [0, 1, 8, 9, 17, *source.sample(range(len(sound.data)), 60)]:
        _, messages = recovered(sound.data[:size], tmp_path)
        assert messages == sound.messages[: len(messages)]
        assert bool(messages) == (sound.whole_chunks(size) > 0)


@pytest.mark.slow
def test_a_flipped_bit_costs_no_more_than_its_chunk(sound: Sound, tmp_path: Path) -> None:
    source = random.Random(2)
    largest = max(Counter(_chunk_of(sound, time) for _, time, _ in sound.messages).values())
    for at in source.sample(range(8, len(sound.data)), 150):
        data = bytearray(sound.data)
        data[at] ^= 1 << source.randrange(8)
        _, messages = recovered(bytes(data), tmp_path)
        missing = Counter(sound.messages) - Counter(messages)
        assert missing.total() <= largest + 2
        assert not Counter(messages) - Counter(sound.messages)


def test_a_record_that_changed_its_kind_is_no_message(sound: Sound, tmp_path: Path) -> None:
    """The nearest kinds differ from a message's by one bit, and their content would do for one."""
    file = RecordFile(sound.file)
    kinds = {found.offset: file.head_at(found.offset)[0] for found in file.scan(lambda _: None)}
    file.close()
    near = [at for at, kind in kinds.items() if kind in _ONE_BIT_FROM_A_MESSAGE]
    assert len(near) > len(sound.chunks)
    for at in near:
        data = bytearray(sound.data)
        data[at] = Opcode.MESSAGE
        report, messages = recovered(bytes(data), tmp_path)
        assert messages == sound.messages
        assert report.bytes_skipped > 0


def _chunk_of(sound: Sound, time_ns: int) -> int:
    return sum(chunk.message_start_time <= time_ns for chunk in sound.chunks)


def test_the_first_chunk_lost_loses_no_topic(sound: Sound, tmp_path: Path) -> None:
    data = bytearray(sound.data)
    first = sound.chunks[0]
    data[first.chunk_start_offset : first.chunk_start_offset + first.chunk_length] = bytes(first.chunk_length)
    end = sound.chunks[-1].chunk_start_offset + sound.chunks[-1].chunk_length
    report, messages = recovered(bytes(data[:end]), tmp_path)  # no summary either
    assert report.messages_of_lost_topics == 0
    assert {topic for topic, _, _ in messages} == {JOINTS, FORCES, NOTES}
    assert messages == sound.messages[-len(messages) :]
    assert report.bytes_skipped >= first.chunk_length
    with AnyReader([tmp_path / "out"]) as reader:
        assert {c.topic for c in reader.connections} == {JOINTS, FORCES, NOTES, DESCRIPTION}


def test_two_files_worth_of_rubbish_between_records(sound: Sound, tmp_path: Path) -> None:
    at = sound.chunks[2].chunk_start_offset
    rubbish = random.Random(3).randbytes(50_000)
    report, messages = recovered(sound.data[:at] + rubbish + sound.data[at:], tmp_path)
    assert messages == sound.messages
    assert len(rubbish) <= report.bytes_skipped <= len(rubbish) + 100


@pytest.mark.parametrize("size", [0, 1, 7, 5000])
def test_rubbish_gives_an_empty_bag(tmp_path: Path, size: int) -> None:
    report, messages = recovered(random.Random(4).randbytes(size), tmp_path)
    assert messages == []
    assert report.bytes_skipped == size


def test_messages_outside_chunks_come_back(tmp_path: Path) -> None:
    path = tmp_path / "plain.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start(profile="ros2")
        channel = writer.register_channel(
            "/n", "cdr", writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        )
        for number in range(50):
            writer.add_message(channel, number, string_cdr(str(number)), number)
        writer.finish()
    data = bytearray(path.read_bytes())
    at = data.index(string_cdr("20"))
    data[at - 30] ^= 0xFF  # the length of message 20
    report, messages = recovered(bytes(data), tmp_path)
    assert [time for _, time, _ in messages] == [number for number in range(50) if number != 20]
    assert report.messages == {"/n": 49}


def test_every_split_is_recovered(tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 300, split_duration_s=0.1)
    (bag / "metadata.yaml").unlink()
    last = bag / "bag_2.mcap"
    last.write_bytes(last.read_bytes()[:-100])
    recover(bag, tmp_path / "out")
    with BagReader(tmp_path / "out") as reader:
        assert {name: topic.message_count for name, topic in reader.topics.items()} == counts(300)
        assert [split.file.name for split in reader.info.splits] == ["out_0.mcap", "out_1.mcap", "out_2.mcap"]


def test_a_recording_that_still_runs_can_be_looked_into(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", configuration="", chunk_bytes=1) as writer:
        writer.add_topic(NOTES, TYPES[NOTES])
        writer.write(NOTES, string_cdr("x"), 0, 0)
        assert recover(tmp_path / "bag", tmp_path / "out").messages == {NOTES: 1}


def test_what_cannot_be_written_is_said_and_leaves_nothing(sound: Sound, tmp_path: Path) -> None:
    with pytest.raises(MissingBagError):
        recover(tmp_path / "none", tmp_path / "out")
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "there_0.mcap").write_text("kept")
    with pytest.raises(BagExistsError, match="use --force to overwrite"):
        recover(sound.bag, tmp_path / "there")
    with pytest.raises(UnwritableDirectoryError, match="/proc/out"):
        recover(sound.bag, "/proc/out")
    with pytest.raises(ForeignFileError, match=r"metadata\.yaml: expected a file \.mcap or the directory of a bag$"):
        recover(sound.bag / "metadata.yaml", tmp_path / "out")
    assert [path.name for path in tmp_path.rglob("*")] == ["there", "there_0.mcap"]


@pytest.mark.parametrize("part", [0, 1, 2])
def test_a_part_that_is_missing_is_named_with_a_remedy_that_works(tmp_path: Path, part: int) -> None:
    bag = written(tmp_path / "bag", 300, split_duration_s=0.1)
    (bag / f"bag_{part}.mcap").unlink()
    with pytest.raises(DamagedBagError, match=rf"part bag_{part}.mcap.*mech-twin recover {bag} OUT"):
        BagReader(bag)
    info = bag_info(bag)
    assert any(f"bag_{part}.mcap" in problem for problem in info.problems)
    assert sum(row.get("cut", 0) for row in info.counters.values()) > 0
    report = recover(bag, tmp_path / "out")
    assert report.damages == [f"{bag}: its part bag_{part}.mcap is missing"]
    assert any(f"bag_{part}.mcap is missing" in problem for problem in bag_info(tmp_path / "out").problems)


def test_counts_of_a_salvaged_recording_add_up_and_say_what_was_cut(sound: Sound, tmp_path: Path) -> None:
    data = bytearray(sound.data)
    chunk = sound.chunks[1]
    data[chunk.chunk_start_offset + 60] ^= 0xFF
    recovered(bytes(data), tmp_path)
    info = bag_info(tmp_path / "out")
    assert info.problems[0].startswith(f"{tmp_path / 'out'}: salvaged from a damaged recording: skipped ")
    assert sum(row.get("cut", 0) for row in info.counters.values()) > 0
    for topic, row in info.counters.items():
        assert row["written"] == info.topics[topic].message_count
        assert row["received"] == row["written"] + row["dropped"] + row.get("cut", 0)
        assert row["received"] == counts(60)[topic]


def test_a_file_named_twice_by_the_metadata_counts_once(sound: Sound, tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 20)
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("  - bag_0.mcap\n", "  - bag_0.mcap\n" * 4))
    with pytest.raises(DamagedBagError, match="names a file twice"):
        BagReader(bag)
    assert bag_info(bag).message_count == sum(counts(20).values())


def test_aliases_in_the_quality_of_service_of_a_topic_are_not_expanded(tmp_path: Path) -> None:
    rows = ["- &a0 [x, x, x, x, x, x, x, x, x]"]
    rows += [f"- &a{level} [{', '.join([f'*a{level - 1}'] * 9)}]" for level in range(1, 9)]
    with pytest.raises(UnboundedYamlError, match="expand to more than"):
        bounded_yaml("\n".join(rows))
    file = tmp_path / "bombs.mcap"
    with file.open("wb") as stream:
        plain = Writer(stream)
        plain.start(profile="ros2")
        schema = plain.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = plain.register_channel("/n", "cdr", schema, {"offered_qos_profiles": "\n".join(rows)})
        plain.add_message(channel, 0, string_cdr("x"), 0)
        plain.finish()
    recover(file, tmp_path / "out")
    assert (tmp_path / "out" / "metadata.yaml").stat().st_size < 10_000


def test_the_remedy_for_a_damaged_file_salvages_the_whole_bag(tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 300, split_duration_s=0.1, chunk_bytes=4000)
    file, alone = bag / "bag_1.mcap", tmp_path / "alone.mcap"
    for path in (file, alone):
        path.write_bytes(file.read_bytes()[:8000])
    for opened, whole in ((bag, bag), (file, bag), (alone, alone)):
        with pytest.raises(UnfinishedBagError, match=f": mech-twin recover {whole} OUT"):
            BagReader(opened)
