# SPDX-License-Identifier: Apache-2.0
"""The 416 conformance files of MCAP, made here as their generator makes them, are read and salvaged whole.

Half of them are padded: bytes after the known fields of every record that may have some.  The sum over the sums of all
files is that of the published ones (github.com/foxglove/mcap, tests/conformance), so these are the same files.
"""

from __future__ import annotations

import hashlib
import itertools
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.record_file import MAGIC
from mech_twin.recording.recovery import recover

PUBLISHED = "eabcfbf8e6525dd4022cb979a3d1793443a31f427cc163be4ddb98e295cd8d01"
FEATURES = ("ch", "mx", "st", "rsh", "rch", "ax", "mdx", "chx", "sum", "pad")
PADDING = b"\x01\xff\xff"
DATA = b"\x01\x02\x03"

SCHEMA = Schema(id=1, name="Example", encoding="c", data=b"\x04\x05\x06")
CHANNEL = Channel(id=1, topic="example", message_encoding="a", metadata={"foo": "bar"}, schema_id=1)
BARE = Channel(id=1, topic="example", message_encoding="text", metadata={}, schema_id=0)
ONE = Message(channel_id=1, log_time=2, data=DATA, publish_time=1, sequence=10)
TEN = [
    Message(channel_id=1, log_time=time, data=DATA, publish_time=time, sequence=number)
    for number, time in enumerate((0, 2, 1, 3, 3, 5, 4, 7, 8, 9))
]
ATTACHMENT = Attachment(
    create_time=1, log_time=2, name="myFile", media_type="application/octet-stream", data=DATA
)  # fmt: skip
CONTENTS: dict[str, list[McapRecord]] = {
    "NoData": [],
    "OneSchemalessMessage": [BARE, ONE],
    "OneMessage": [SCHEMA, CHANNEL, ONE],
    "OneAttachment": [ATTACHMENT],
    "OneMetadata": [Metadata(name="myMetadata", metadata={"foo": "bar"})],
    "TenMessages": [SCHEMA, CHANNEL, *TEN],
}


def makes_sense(records: list[McapRecord], features: frozenset[str]) -> bool:
    """Return whether a file of these records can have these features."""
    kinds = {type(record) for record in records}
    asked = {"ax": Attachment, "mdx": Metadata, "rsh": Schema, "rch": Channel}
    chunked = features & {"ch", "chx", "mx"}
    return (
        all(kind in kinds for feature, kind in asked.items() if feature in features)
        and (not chunked or ("ch" in features and bool(kinds & {Message, Channel, Schema})))
        and ("sum" not in features or bool(features & {"chx", "rsh", "rch", "mdx", "ax", "st"}))
    )


def variants() -> Iterator[tuple[str, list[McapRecord], frozenset[str]]]:
    """Yield name, records and features of every file."""
    for name, records in CONTENTS.items():
        for size in range(len(FEATURES) + 1):
            for chosen in map(frozenset, itertools.combinations(FEATURES, size)):
                if makes_sense(records, chosen):
                    yield "-".join((name, *sorted(chosen))), records, chosen


def encoded(record: McapRecord, features: frozenset[str] = frozenset()) -> bytes:
    """Return the bytes of a record, padded if the file is and its kind may be."""
    builder = RecordBuilder()
    record.write(builder)
    data = builder.end()
    if "pad" not in features or isinstance(record, Message | Chunk | DataEnd | Footer):
        return data
    return data[:1] + (len(data) - 9 + len(PADDING)).to_bytes(8, "little") + data[9:] + PADDING


def chunk_and_index(records: list[McapRecord], features: frozenset[str], start: int) -> tuple[bytes, list[McapRecord]]:
    """Return the bytes of a chunk with its message index, and the chunk's index if the file has one."""
    content, entries, channels = b"", [], 0
    for record in records:
        channels += isinstance(record, Channel)
        if isinstance(record, Message):
            entries.append((record.log_time, len(content)))
        content += encoded(record)
    times = [time for time, _ in entries] or [0]
    chunk = encoded(
        Chunk(
            compression="",
            data=content,
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        )
    )
    indexed = "mx" in features and channels > 0
    index = encoded(MessageIndex(channel_id=1, records=entries), features) if indexed else b""
    of_chunk = ChunkIndex(
        chunk_length=len(chunk),
        chunk_start_offset=start,
        compression="",
        compressed_size=len(content),
        message_end_time=max(times),
        message_index_length=len(index),
        message_index_offsets={1: start + len(chunk)} if indexed else {},
        message_start_time=min(times),
        uncompressed_size=len(content),
    )
    return chunk + index, [of_chunk] if "chx" in features else []


def generated(records: list[McapRecord], features: frozenset[str]) -> bytes:
    """Return a conformance file."""
    out = MAGIC + encoded(Header(profile="", library=""), features)
    inside = [record for record in records if isinstance(record, Schema | Channel | Message)]
    attachments: list[McapRecord] = []
    metadata: list[McapRecord] = []
    for record in records:
        data = encoded(record, features)
        if isinstance(record, Attachment) and "ax" in features:
            attachments.append(
                AttachmentIndex(
                    offset=len(out),
                    length=len(data),
                    create_time=record.create_time,
                    log_time=record.log_time,
                    data_size=len(record.data),
                    name=record.name,
                    media_type=record.media_type,
                )
            )
        if isinstance(record, Metadata) and "mdx" in features:
            metadata.append(MetadataIndex(offset=len(out), length=len(data), name=record.name))
        if record not in inside or "ch" not in features:
            out += data
    chunks: list[McapRecord] = []
    if "ch" in features:
        data, chunks = chunk_and_index(inside, features, len(out))
        out += data
    out += encoded(DataEnd(data_section_crc=zlib.crc32(out)))
    times = [record.log_time for record in records if isinstance(record, Message)]
    statistics = Statistics(
        attachment_count=sum(isinstance(record, Attachment) for record in records),
        channel_count=sum(isinstance(record, Channel) for record in records),
        channel_message_counts={1: len(times)} if times else {},
        chunk_count=int("ch" in features),
        message_count=len(times),
        message_end_time=max(times, default=0),
        message_start_time=min(times, default=0),
        metadata_count=sum(isinstance(record, Metadata) for record in records),
        schema_count=sum(isinstance(record, Schema) for record in records),
    )
    groups: list[tuple[Opcode, list[McapRecord]]] = [
        (Opcode.SCHEMA, [record for record in records if isinstance(record, Schema) and "rsh" in features]),
        (Opcode.CHANNEL, [record for record in records if isinstance(record, Channel) and "rch" in features]),
        (Opcode.STATISTICS, [statistics] if "st" in features else []),
        (Opcode.METADATA_INDEX, metadata),
        (Opcode.ATTACHMENT_INDEX, attachments),
        (Opcode.CHUNK_INDEX, chunks),
    ]
    start = len(out)
    offsets = b""
    for opcode, members in groups:
        data = b"".join(encoded(record, features) for record in members)
        if data:
            group = SummaryOffset(group_opcode=opcode, group_start=len(out), group_length=len(data))
            offsets += encoded(group, features)
        out += data
    summary = start if len(out) > start else 0
    at_offsets = len(out) if "sum" in features else 0
    out += offsets if at_offsets else b""
    footer = Footer(summary_start=summary, summary_offset_start=at_offsets, summary_crc=0)
    crc = zlib.crc32(out[start:] + encoded(footer)[:-4])
    return out + encoded(footer)[:-4] + crc.to_bytes(4, "little") + MAGIC


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, list[McapRecord]]:
    folder = tmp_path_factory.mktemp("conformance")
    found = {}
    for name, records, features in variants():
        path = folder / f"{name}.mcap"
        path.write_bytes(generated(records, features))
        found[path] = records
    return found


def test_the_files_are_the_published_ones(files: dict[Path, list[McapRecord]]) -> None:
    sums = sorted(f"{path.stem} {hashlib.sha256(path.read_bytes()).hexdigest()}\n" for path in files)
    assert len(sums) == 416
    assert hashlib.sha256("".join(sums).encode()).hexdigest() == PUBLISHED


@pytest.mark.slow
def test_every_file_is_read_and_salvaged_whole(files: dict[Path, list[McapRecord]], tmp_path: Path) -> None:
    for path, records in files.items():
        messages = [record for record in records if isinstance(record, Message)]
        with BagReader(path) as reader:
            read = [(message.log_time_ns, bytes(message.raw)) for message in reader.messages()]
            assert reader.info.problems == (), path.stem
        assert read == sorted((record.log_time, record.data) for record in messages), path.stem
        report = recover(path, tmp_path / path.stem)
        salvaged = sum(report.messages.values()), report.bytes_skipped, report.damages
        assert salvaged == (len(messages), 0, []), path.stem
