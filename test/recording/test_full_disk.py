# SPDX-License-Identifier: Apache-2.0
"""A disk that is full or fails stops nothing: what was written stays valid, what is dropped is counted."""

from __future__ import annotations

import errno
import os
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from bag_cases import NOTES, TYPES
from rosbags.highlevel import AnyReader
from small_disk import small_disk

from mech_twin.recording.bag_reader import BagReader, bag_info
from mech_twin.recording.bag_writer import BagWriter, WriterState
from mech_twin.recording.schemas import string_cdr

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
    dropped = {"received": 650, "written": first + 50, "dropped": 600 - first, "missed": 0, "late": 0}
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
    assert bag_info(disk / "bag").finished


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
