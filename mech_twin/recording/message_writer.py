# SPDX-License-Identifier: Apache-2.0
"""The `mcap` writer with a faster path for messages and a smaller index of an open file.

A message record is packed in one call instead of field by field.  The summary of a chunk is kept as its final bytes,
a seventh of the memory of the objects; this index is the only memory that grows with an open file.

The output is byte for byte that of `mcap.writer.Writer`, as a test checks.  Both use private members of that class;
with a release of `mcap` that lacks them, its own methods are used.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import chain
from typing import IO, Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, MessageIndex
from mcap.writer import CompressionType, Writer

_HEAD = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_FIXED_BYTES = 22  # content of a message record before the payload
_CHUNK_INDEX_BYTES = 64  # content of a chunk index without channel offsets and compression name
_INDEXES = "_Writer__chunk_indices"


class _PackedIndex(MessageIndex):
    """A message index whose entries are packed at once."""

    def write(self, stream: RecordBuilder) -> None:
        stream.start_record(Opcode.MESSAGE_INDEX)
        stream.write2(self.channel_id)
        stream.write4(16 * len(self.records))
        stream.write(struct.pack(f"<{2 * len(self.records)}Q", *chain.from_iterable(self.records)))
        stream.finish_record()


class _PackedChunkIndexes:
    """The chunk indexes of a file as packed records; replaces the writer's list of objects."""

    def __init__(self) -> None:
        self._records = bytearray()

    def append(self, index: ChunkIndex) -> None:
        """Add the record of a chunk."""
        offsets = index.message_index_offsets
        compression = index.compression.encode()
        self._records += struct.pack(
            f"<BQQQQQI{'HQ' * len(offsets)}QI{len(compression)}sQQ",
            Opcode.CHUNK_INDEX,
            _CHUNK_INDEX_BYTES + 10 * len(offsets) + len(compression),
            index.message_start_time,
            index.message_end_time,
            index.chunk_start_offset,
            index.chunk_length,
            10 * len(offsets),
            *chain.from_iterable(offsets.items()),
            index.message_index_length,
            len(compression),
            compression,
            index.compressed_size,
            index.uncompressed_size,
        )

    def __iter__(self) -> Iterator[_PackedChunkIndexes]:
        """Yield this object once: it writes all records together."""
        yield self

    def write(self, stream: RecordBuilder) -> None:
        """Write the records in the order of the chunks."""
        stream.write(self._records)


class MessageWriter(Writer):
    """Writer of one MCAP file with chunks and checksums.

    Parameters
    ----------
    output : binary stream
        Destination of the bytes.
    chunk_bytes : int
        Uncompressed size at which a chunk is closed.
    compression : CompressionType
        Compression of the chunks.
    enable_data_crcs : bool
        Whether the data section has a checksum of its own.
    """

    def __init__(
        self, output: IO[bytes], chunk_bytes: int, compression: CompressionType, *, enable_data_crcs: bool = False
    ) -> None:
        super().__init__(
            output, chunk_size=chunk_bytes, compression=compression, enable_crcs=True, enable_data_crcs=enable_data_crcs
        )
        self._chunk_bytes = chunk_bytes
        self._chunk: Any = getattr(self, "_Writer__chunk_builder", None)
        self._statistics: Any = getattr(self, "_Writer__statistics", None)
        if getattr(self, _INDEXES, None) == []:
            setattr(self, _INDEXES, _PackedChunkIndexes())

    def flush(self) -> None:
        """Close the current chunk and write it to the output."""
        super().flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the summary; the output stays open."""
        super().finish()  # type: ignore[no-untyped-call]

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """Add a message to the current chunk; see `mcap.writer.Writer.add_message`."""
        chunk, statistics = self._chunk, self._statistics
        if chunk is None or statistics is None:
            super().add_message(channel_id, log_time, data, publish_time, sequence)
            return
        records = chunk.record_writer
        offset = records.count
        length = _FIXED_BYTES + len(data)
        records.write(_HEAD.pack(Opcode.MESSAGE, length, channel_id, sequence, log_time, publish_time) + data)
        index = chunk.message_indices.get(channel_id)
        if index is None:
            index = chunk.message_indices[channel_id] = _PackedIndex(channel_id=channel_id, records=[])
        index.records.append((log_time, offset))
        if chunk.num_messages == 0 or log_time < chunk.message_start_time:
            chunk.message_start_time = log_time
        chunk.message_end_time = max(chunk.message_end_time, log_time)
        if statistics.message_count == 0 or log_time < statistics.message_start_time:
            statistics.message_start_time = log_time
        statistics.message_end_time = max(statistics.message_end_time, log_time)
        chunk.num_messages += 1
        statistics.message_count += 1
        statistics.channel_message_counts[channel_id] += 1
        if offset + 9 + length > self._chunk_bytes:
            self.flush()
