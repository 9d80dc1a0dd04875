# SPDX-License-Identifier: Apache-2.0
"""A disk that is full or fails stops nothing: what was written stays valid, what is dropped is counted."""

from __future__ import annotations

import errno
import os
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from bag_cases import NOTES, TYPES, string_cdr
from rosbags.highlevel import AnyReader
from small_disk import small_disk

from mech_twin.recording.bag_reader import BagReader, bag_info, lost_messages
from mech_twin.recording.bag_writer import BagWriter, WriterState
from mech_twin.recording.recovery import recover

SOURCE = random.Random(5)


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    with small_disk(tmp_path / "disk", monkeypatch) as path:
        yield path


class Feed:
    """Notes that do not compress, 2 kB each, numbered, 1 ms apart."""

    def __init__(self, writer: BagWriter) -> None:
        self._writer = writer
        self.sent = 0
        writer.add_topic(NOTES, TYPES[NOTES])

    def send(self, count: int) -> None:
        for _ in range(count):
            text = f"{self.sent} {SOURCE.randbytes(1000).hex()}"
            self._writer.write(NOTES, string_cdr(text), self.sent * 1_000_000, self.sent * 1_000_000)
            self.sent += 1


def numbers(bag: Path) -> list[int]:
    with BagReader(bag, salvage=not (bag_info(bag).finished)) as reader:
        return [int(message.raw[8:].split()[0]) for message in reader.messages()]


def test_recording_goes_on_in_a_new_split_when_space_returns(disk: Path) -> None:
    filler = disk / "filler"
    filler.write_bytes(bytes(300_000))
    writer = BagWriter(disk / "bag", configuration="a: 1", chunk_bytes=20_000, retry_s=0.0)
    feed = Feed(writer)
    feed.send(600)
    assert writer.state is WriterState.ERROR
    assert "No space left on device" in writer.error
    assert str(disk / "bag") in writer.error

    while_full = writer.counters[NOTES]
    assert while_full.received == 600
    assert while_full.written + while_full.dropped == 600
    assert while_full.dropped > 0
    with AnyReader([disk / "bag" / "bag_0.mcap"]) as reader:  # complete while the disk is still full
        assert sum(1 for _ in reader.messages()) == while_full.written

    filler.unlink()
    feed.send(50)
    assert writer.state is WriterState.RECORDING
    assert writer.error == ""
    writer.close()
    assert writer.state is WriterState.CLOSED
    first = while_full.written
    assert numbers(disk / "bag") == [*range(first), *range(600, 650)]
    info = bag_info(disk / "bag")
    assert info.finished
    assert len(info.splits) == 2
    dropped = {"received": 650, "written": first + 50, "dropped": 600 - first, "missed": 0, "late": 0, "publishers": 0}
    assert info.counters == {NOTES: dropped}
    with AnyReader([disk / "bag"]) as reader:
        assert sum(1 for _ in reader.messages()) == first + 50


def test_closing_on_a_full_disk_leaves_a_finished_bag(disk: Path) -> None:
    with BagWriter(disk / "bag", configuration="", chunk_bytes=20_000) as writer:
        feed = Feed(writer)
        feed.send(1000)
        assert writer.state is WriterState.ERROR
    assert writer.state is WriterState.CLOSED
    assert numbers(disk / "bag") == list(range(writer.counters[NOTES].written))
    info = bag_info(disk / "bag")
    assert info.finished
    row = info.counters[NOTES]
    assert (row["received"], row["written"] + row["dropped"]) == (1000, 1000)
    assert row["dropped"] > 0


def test_what_a_full_disk_lost_is_told_of_the_recovered_recording_too(disk: Path, tmp_path: Path) -> None:
    with BagWriter(disk / "bag", configuration="", chunk_bytes=20_000) as writer:
        Feed(writer).send(1000)
    recover(disk / "bag", tmp_path / "out")
    before, after = (bag_info(path).counters[NOTES] for path in (disk / "bag", tmp_path / "out"))
    assert after["dropped"] == before["dropped"] > 0
    (disk / "bag" / "metadata.yaml").unlink()
    report = recover(disk / "bag", tmp_path / "again")
    assert "what was dropped after its last file is not known" in report.damages[0]
    assert any("is not known" in problem for problem in bag_info(tmp_path / "again").problems)


def test_what_a_full_disk_lost_is_said_at_once_and_told_of_the_closed_recording(
    disk: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with BagWriter(disk / "bag", configuration="", chunk_bytes=20_000) as writer:
        feed = Feed(writer)
        feed.send(1000)
        assert "No space left on device: the recording loses messages" in caplog.text
    assert lost_messages(disk / "bag") == (
        f"{disk / 'bag'}: {writer.dropped} messages lost, which the disk did not accept"
    )


def test_a_limit_of_file_size_is_told_of_the_recording_that_cannot_be_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pwrite = os.pwrite

    def limited(descriptor: int, data: bytes, offset: int) -> int:
        room = 100_000 - offset
        if room <= 0:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
        return pwrite(descriptor, data[:room], offset)

    monkeypatch.setattr(os, "pwrite", limited)
    with BagWriter(tmp_path / "bag", configuration="", chunk_bytes=20_000, retry_s=0.0) as writer:
        Feed(writer).send(500)
    info = bag_info(tmp_path / "bag")
    row = info.counters[NOTES]
    assert not info.finished
    assert (row["received"], row["written"] + row["dropped"]) == (500, 500)
    assert row["written"] == len(numbers(tmp_path / "bag"))
    assert "could not be closed" in lost_messages(tmp_path / "bag")


def test_a_disk_full_to_the_last_byte_leaves_a_valid_prefix(disk: Path) -> None:
    writer = BagWriter(disk / "bag", configuration="", chunk_bytes=20_000, retry_s=0.0)
    feed = Feed(writer)
    feed.send(100)
    (disk / "bag" / ".reserve").unlink()  # someone else takes even the space held back
    with (disk / "filler").open("wb", buffering=0) as filler:
        for size in (65536, 4096, 512):
            fill(filler.fileno(), size)
    feed.send(100)
    writer.close()
    assert writer.state is WriterState.ERROR
    saved = numbers(disk / "bag")
    assert saved == list(range(len(saved)))
    assert writer.counters[NOTES].written == len(saved)
    assert not bag_info(disk / "bag").finished

    (disk / "filler").unlink()
    writer.close()
    assert writer.state is WriterState.CLOSED
    assert bag_info(disk / "bag").finished
    assert numbers(disk / "bag") == list(range(writer.counters[NOTES].written))


def fill(descriptor: int, size: int) -> None:
    at = os.fstat(descriptor).st_size
    try:
        while os.pwrite(descriptor, bytes(size), at) == size:
            at += size
    except OSError as error:
        assert error.errno == errno.ENOSPC


def test_a_disk_that_fails_is_counted_and_survived(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failing = False
    pwrite = os.pwrite

    def faulty(descriptor: int, data: bytes, offset: int) -> int:
        if failing:
            pwrite(descriptor, data[: len(data) // 2], offset)
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return pwrite(descriptor, data, offset)

    monkeypatch.setattr(os, "pwrite", faulty)
    writer = BagWriter(tmp_path / "bag", configuration="", chunk_bytes=20_000, retry_s=0.0)
    feed = Feed(writer)
    feed.send(100)
    failing = True
    feed.send(100)
    assert writer.state is WriterState.ERROR
    assert "Input/output error" in writer.error
    on_disk = numbers(tmp_path / "bag")
    assert on_disk == list(range(writer.counters[NOTES].written))
    failing = False
    writer.tick()
    assert writer.state is WriterState.RECORDING
    feed.send(100)
    writer.close()
    saved = numbers(tmp_path / "bag")
    counted = writer.counters[NOTES]
    assert len(saved) == counted.written == 300 - counted.dropped
    assert saved == [*range(200 - counted.dropped), *range(200, 300)]
