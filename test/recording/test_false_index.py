# SPDX-License-Identifier: Apache-2.0
"""Index, summary and metadata of a file are compared with its data; a recovery believes none of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable
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
from mcap.writer import Writer

from mech_twin.recording import file_index
from mech_twin.recording.bag_reader import BagReader, bag_info
from mech_twin.recording.errors import DamagedBagError
from mech_twin.recording.record_file import MAGIC, MAX_CHUNK_RECORDS, UnreadableRecordError, inner_records
from mech_twin.recording.recovery import recover

CHUNKS, EACH = 3, 10
Change = Callable[[list[ChunkIndex], Statistics], None]


def encoded(record: McapRecord, padding: bytes = b"") -> bytes:
    """Return a record with bytes after its known fields, but for those whose content is open-ended or fixed."""
    builder = RecordBuilder()
    record.write(builder)
    data = builder.end()
    if isinstance(record, Message | Footer):
        return data
    length = len(data) - 9 + len(padding)
    return data[:1] + length.to_bytes(8, "little") + data[9:] + padding


def numbered_file(
    path: Path, change: Change | None = None, padding: bytes = b"", extras: frozenset[str] = frozenset()
) -> Path:
    """Write a file of `CHUNKS` chunks of `EACH` messages; ``change`` falsifies what its summary says."""
    schema = Schema(id=1, data=b"string data", encoding="ros2msg", name="std_msgs/msg/String")
    channel = Channel(id=1, topic="/n", message_encoding="cdr", metadata={"a": "b"}, schema_id=1)
    out = bytearray(MAGIC + encoded(Header(profile="ros2", library="test"), padding))
    indexes: list[ChunkIndex] = []
    for number in range(CHUNKS):
        times = range(number * EACH, (number + 1) * EACH)
        content = encoded(schema, padding) + encoded(channel, padding)
        entries = []
        for time in times:
            entries.append((time, len(content)))
            content += encoded(Message(channel_id=1, log_time=time, data=b"abcd", publish_time=time, sequence=time))
        chunk = Chunk(
            compression="",
            data=content,
            message_start_time=times[0],
            message_end_time=times[-1],
            uncompressed_crc=0,
            uncompressed_size=len(content),
        )
        at, record = len(out), encoded(chunk, padding)
        out += record
        offset = len(out)
        index = encoded(MessageIndex(channel_id=1, records=entries), padding) if "indexes" in extras else b""
        out += index
        indexes.append(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=at,
                compression="",
                compressed_size=len(content),
                message_end_time=times[-1],
                message_index_length=len(index),
                message_index_offsets={1: offset} if index else {},
                message_start_time=times[0],
                uncompressed_size=len(content),
            )
        )
    more = b""
    if "attachment" in extras:
        attachment = Attachment(create_time=1, log_time=2, name="a", media_type="b", data=b"abc")
        record = encoded(attachment, padding)
        more += encoded(
            AttachmentIndex(
                offset=len(out), length=len(record), create_time=1, log_time=2, data_size=3, name="a", media_type="b"
            ),
            padding,
        )
        out += record
    if "metadata" in extras:
        record = encoded(Metadata(name="m", metadata={"a": "b"}), padding)
        more += encoded(MetadataIndex(offset=len(out), length=len(record), name="m"), padding)
        out += record
    out += encoded(DataEnd(data_section_crc=0), padding)
    statistics = Statistics(
        attachment_count=0,
        channel_count=1,
        channel_message_counts={1: CHUNKS * EACH},
        chunk_count=CHUNKS,
        message_count=CHUNKS * EACH,
        message_end_time=CHUNKS * EACH,
        message_start_time=0,
        metadata_count=0,
        schema_count=1,
    )
    if change is not None:
        change(indexes, statistics)
    start = len(out) if "summary" in extras else 0
    if start:
        for record_ in (schema, channel, *indexes, statistics):
            out += encoded(record_, padding)
        out += more
        if "offsets" in extras:
            out += encoded(SummaryOffset(group_opcode=Opcode.STATISTICS, group_start=start, group_length=1), padding)
    out += encoded(Footer(summary_start=start, summary_offset_start=0, summary_crc=0)) + MAGIC
    path.write_bytes(out)
    return path


EXTRAS = ("indexes", "attachment", "metadata", "summary", "offsets")
VARIANTS = [frozenset(each) for size in range(len(EXTRAS) + 1) for each in itertools.combinations(EXTRAS, size)]


@pytest.mark.parametrize("extras", VARIANTS, ids=lambda extras: "-".join(sorted(extras)) or "plain")
def test_unknown_fields_at_the_end_of_every_record_are_ignored(tmp_path: Path, extras: frozenset[str]) -> None:
    file = numbered_file(tmp_path / "padded.mcap", padding=b"\x01\x02\x03", extras=extras)
    with BagReader(file) as reader:
        assert [message.log_time_ns for message in reader.messages()] == list(range(CHUNKS * EACH))
        assert reader.info.message_count == CHUNKS * EACH
    report = recover(file, tmp_path / "out")
    assert (report.messages, report.bytes_skipped, report.damages) == ({"/n": CHUNKS * EACH}, 0, [])


def twice(indexes: list[ChunkIndex], statistics: Statistics) -> None:
    indexes.append(indexes[0])


def left_out(indexes: list[ChunkIndex], statistics: Statistics) -> None:
    indexes.pop(1)


def counted_wrongly(indexes: list[ChunkIndex], statistics: Statistics) -> None:
    statistics.channel_message_counts[1] = statistics.message_count = 10**9


def smaller_than_it_is(indexes: list[ChunkIndex], statistics: Statistics) -> None:
    indexes[0].uncompressed_size = 1


@pytest.mark.parametrize("change", [twice, left_out, counted_wrongly, smaller_than_it_is])
def test_a_summary_that_contradicts_the_data_is_refused_and_recovered_without(tmp_path: Path, change: Change) -> None:
    file = numbered_file(tmp_path / "false.mcap", change, extras=frozenset(EXTRAS))
    with pytest.raises(DamagedBagError, match="its summary"):
        BagReader(file)
    info = bag_info(file)
    assert info.message_count == CHUNKS * EACH
    assert len(info.problems) == 1
    assert recover(file, tmp_path / "out").messages == {"/n": CHUNKS * EACH}


@pytest.mark.slow
def test_empty_messages_without_end_are_bounded_by_their_number() -> None:
    empty = encoded(Message(channel_id=1, log_time=0, data=b"", publish_time=0, sequence=0))
    with pytest.raises(UnreadableRecordError, match="more than 1048576 records"):
        for _ in inner_records(empty * (MAX_CHUNK_RECORDS + 1)):
            pass


@pytest.mark.parametrize(("size", "count"), [(100_000, 1), (0, 400)])
def test_what_the_chunks_of_a_file_come_to_together_is_bounded_whatever_each_holds(
    size: int, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zeros shrink to nothing, and messages without content weigh nothing: a small file may ask for hours of both."""
    monkeypatch.setattr(file_index, "SCAN_BYTES", 500_000)
    monkeypatch.setattr(file_index, "MOST_EXPANSION", 0)
    file = tmp_path / "zeros.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=size + count * 31 + 2000)
        writer.start()
        channel = writer.register_channel("/n", "cdr", 0)
        for time in range(100):
            for _ in range(count):
                writer.add_message(channel, time, bytes(size), time)
            writer.flush()
        writer.finish()
    report = recover(file, tmp_path / "out")
    assert 0 < report.messages["/n"] < 6 * count
    assert "chunks that come to more than 500000 bytes together" in report.damages[0]
