# SPDX-License-Identifier: Apache-2.0
"""A thousand damaged bags end in a reading, a recovery, or one line; never in a traceback."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from bag_cases import written

from mech_twin.recording.bag_contents import BagMessage
from mech_twin.recording.bag_reader import BagReader, bag_info
from mech_twin.recording.errors import BagError, DecodeError
from mech_twin.recording.message_decoder import MessageDecoder
from mech_twin.recording.recovery import recover

MUTATIONS = 1000
Mutation = Callable[[bytearray, random.Random], None]


def flip(data: bytearray, source: random.Random) -> None:
    data[source.randrange(len(data))] ^= 1 << source.randrange(8)


def overwrite(data: bytearray, source: random.Random) -> None:
    at = source.randrange(len(data))
    data[at : at + source.randrange(1, 200)] = source.randbytes(source.randrange(1, 200))


def extreme(data: bytearray, source: random.Random) -> None:
    at = source.randrange(len(data))
    data[at : at + 8] = source.choice([b"\xff" * 8, bytes(8), b"\xff" * 4, b"\0\0\0\x80"])


def remove(data: bytearray, source: random.Random) -> None:
    at = source.randrange(len(data))
    del data[at : at + source.randrange(1, 500)]


def repeat(data: bytearray, source: random.Random) -> None:
    at, to = source.randrange(len(data)), source.randrange(len(data))
    data[to:to] = data[at : at + source.randrange(1, 1000)]


def shorten(data: bytearray, source: random.Random) -> None:
    del data[source.randrange(len(data)) :]


CHANGES: list[Mutation] = [flip, overwrite, extreme, remove, repeat, shorten]


def mutated(data: bytes, source: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(source.randrange(1, 4)):
        if changed:
            source.choice(CHANGES)(changed, source)
    return bytes(changed)


def read_all(bag: Path, salvage: bool) -> None:
    try:
        with BagReader(bag, salvage=salvage) as reader:
            decoder = MessageDecoder(reader.topics)
            for message in reader.messages():
                decode(decoder, message)
    except BagError as error:
        assert "\n" not in str(error)


def decode(decoder: MessageDecoder, message: BagMessage) -> None:
    try:
        decoder.decode(message)
    except DecodeError as error:
        assert "\n" not in str(error)


def used(bag: Path, out: Path) -> None:
    """Do everything that can be done with a bag."""
    for salvage in (False, True):
        read_all(bag, salvage)
    try:
        bag_info(bag)
    except BagError as error:
        assert "\n" not in str(error)
    recover(bag, out)
    read_all(out, salvage=False)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(4))
def test_damaged_recordings(tmp_path: Path, part: int) -> None:
    options = {"compression": ("zstd", "none")[part % 2], "chunk_bytes": (1500, 100_000)[part // 2]}
    bag = written(tmp_path / "bag", 30, **options)
    file = bag / "bag_0.mcap"
    data = file.read_bytes()
    for number in range(MUTATIONS // 4):
        file.write_bytes(mutated(data, random.Random(f"{part} {number}")))
        used(bag, tmp_path / f"out_{number}")


@pytest.mark.slow
def test_a_few_damaged_recordings(tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 30, chunk_bytes=1500)
    file = bag / "bag_0.mcap"
    data = file.read_bytes()
    for number in range(40):
        file.write_bytes(mutated(data, random.Random(number)))
        used(bag, tmp_path / f"out_{number}")


@pytest.mark.slow
def test_damaged_metadata(tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 3)
    file = bag / "metadata.yaml"
    data = file.read_bytes()
    for number in range(100):
        file.write_bytes(mutated(data, random.Random(number)))
        read_all(bag, salvage=False)
        read_all(bag, salvage=True)
        bag_info(bag)
