# SPDX-License-Identifier: Apache-2.0
"""The faster writer writes the very bytes of the mcap package's own."""

import io
import tracemalloc
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from mech_twin.recording.bag_split import MessageWriter

TIMES = st.integers(0, 2**63)
MESSAGES = st.lists(st.tuples(st.integers(0, 2), TIMES, st.binary(max_size=300), TIMES, st.integers(0, 2**32 - 1)))


def file_of(writer_class, messages, compression, flushes=(), **arguments):
    output = io.BytesIO()
    writer = writer_class(output, **arguments, compression=compression, enable_data_crcs=True)
    writer.start(profile="ros2", library="x")
    schema = writer.register_schema("x/msg/X", "ros2msg", b"int32 x")
    channels = [writer.register_channel(f"/{number}", "cdr", schema) for number in range(3)]
    for place, (channel, log_time, data, publish_time, sequence) in enumerate(messages):
        writer.add_message(channels[channel], log_time, data, publish_time, sequence)
        if place in flushes:
            writer.flush()
    writer.add_metadata("m", {"a": "b"})
    writer.finish()
    return output.getvalue()


@given(
    MESSAGES, st.sampled_from([1, 100, 1000, 100_000]), st.sampled_from(CompressionType), st.sets(st.integers(0, 20))
)
@settings(max_examples=100, deadline=None)
def test_the_bytes_are_those_of_the_package(messages, chunk_bytes, compression, flushes):
    ours = file_of(MessageWriter, messages, compression, flushes, chunk_bytes=chunk_bytes)
    theirs = file_of(Writer, messages, compression, flushes, chunk_size=chunk_bytes)
    assert ours == theirs


@pytest.mark.parametrize("member", ["_chunk", "_statistics"])
def test_without_the_private_members_the_package_s_own_method_writes(member):
    class Without(MessageWriter):
        def __init__(self, *arguments, **named):
            super().__init__(*arguments, **named)
            setattr(self, member, None)

    messages = [(number % 3, number, bytes(number), number, number) for number in range(200)]
    ours = file_of(Without, messages, CompressionType.ZSTD, chunk_bytes=1000)
    assert ours == file_of(Writer, messages, CompressionType.ZSTD, chunk_size=1000)
    found = [message for _, _, message in make_reader(io.BytesIO(ours)).iter_messages()]
    assert [message.data for message in found] == [data for _, _, data, _, _ in messages]
    assert all(one.log_time <= other.log_time for one, other in pairwise(found))


def test_an_open_file_grows_by_the_bytes_of_its_index():
    channels, chunks = 20, 400
    writer = MessageWriter(Sink(), 1 << 20, CompressionType.ZSTD)
    writer.start()
    schema = writer.register_schema("x/msg/X", "ros2msg", b"int32 x")
    known = [writer.register_channel(f"/{number}", "cdr", schema) for number in range(channels)]

    def write(first, last):
        for chunk in range(first, last):
            for channel in known:
                writer.add_message(channel, 10**12 + chunk, b"payload", 10**12 + chunk, chunk)
            writer.flush()

    write(0, 100)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    write(100, 100 + chunks)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    record = 9 + 64 + len("zstd") + 10 * channels
    assert grown < 1.3 * record * chunks + 2000  # a row of bytes grows by an eighth ahead


class Sink:
    """Takes what is written and keeps nothing."""

    def __init__(self):
        self.length = 0

    def write(self, data):
        self.length += len(data)
        return len(data)

    def tell(self):
        return self.length

    def flush(self):
        pass
