# SPDX-License-Identifier: Apache-2.0
"""Index of one MCAP file: where its chunks, attachments and metadata are."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mcap.records import Attachment, Channel, Chunk, Metadata, Schema

from mech_twin.recording.bag_split import CONFIGURATION_NAME, COUNTERS_RECORD, SPLIT_RECORD
from mech_twin.recording.errors import DamagedBagError, ForeignFileError
from mech_twin.recording.mcap_records import (
    Damage,
    RawMessage,
    Record,
    UnreadableRecordError,
    decompressed,
    inner_records,
)
from mech_twin.recording.record_file import RecordFile

_MAX_PROBLEMS = 50
MAX_CONFIGURATION_BYTES = 1 << 20
MAX_CHANNELS = 10_000


class Extent(NamedTuple):
    """A byte range of messages: one chunk, or consecutive messages outside chunks."""

    offset: int
    length: int
    start_ns: int
    end_ns: int
    size_bytes: int
    channels: frozenset[int]


@dataclass
class FileIndex:
    """Schemas, channels and positions of the records of one file."""

    file: RecordFile
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    extents: list[Extent] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    attachments: list[int] = field(default_factory=list)
    metadata: dict[str, int] = field(default_factory=dict)
    damages: list[Damage] = field(default_factory=list)
    finished: bool = True

    def records_of(self, extent: Extent) -> Iterator[RawMessage]:
        """Yield the messages of an extent.

        Raises
        ------
        DamagedBagError
            The records do not match the index.
        """
        try:
            for record in _contents(self.file, extent):
                if isinstance(record, RawMessage):
                    yield record
        except UnreadableRecordError as error:
            raise DamagedBagError(self.file.path, f"at byte {extent.offset}: {error}") from error

    def problems(self) -> list[str]:
        """Return the damage of the file, one line each; the first fifty."""
        lines = [] if self.finished else [f"{self.file.path}: has no footer, it was truncated"]
        lines += [
            f"{self.file.path}: {damage.length} bytes at {damage.offset}: {damage.reason}"
            for damage in self.damages[:_MAX_PROBLEMS]
        ]
        return lines

    def metadata_record(self, name: str) -> dict[str, str]:
        """Return the last metadata record of this name; empty if there is none."""
        if name not in self.metadata:
            return {}
        try:
            record = self.file.record_at(self.metadata[name]).record
        except UnreadableRecordError as error:
            raise DamagedBagError(self.file.path, f"metadata '{name}': {error}") from error
        return record.metadata if isinstance(record, Metadata) else {}

    def attachment_records(self) -> Iterator[Attachment]:
        """Yield the attachments."""
        for offset in self.attachments:
            try:
                record = self.file.record_at(offset).record
            except UnreadableRecordError as error:
                raise DamagedBagError(self.file.path, f"attachment at byte {offset}: {error}") from error
            if isinstance(record, Attachment):
                yield record

    def configuration(self) -> str | None:
        """Return the configuration attached to the file."""
        for attachment in self.attachment_records():
            if attachment.name == CONFIGURATION_NAME:
                if len(attachment.data) > MAX_CONFIGURATION_BYTES:
                    raise ForeignFileError(
                        self.file.path,
                        f"its configuration has {len(attachment.data)} bytes, more than {MAX_CONFIGURATION_BYTES}",
                    )
                return attachment.data.decode("utf-8", "replace")
        return None

    def split_number(self) -> int:
        """Return the number of the file in its bag; 0 for the first file, or if unknown."""
        number = self.metadata_record(SPLIT_RECORD).get("index", "0")
        return int(number) if number.isascii() and number.isdigit() and len(number) < 10 else 0

    def repeated(self) -> dict[str, int]:
        """Return the sequence number of the latched message repeated from earlier splits, by topic."""
        return {
            key: value
            for key, value in parsed_mapping(self.metadata_record(SPLIT_RECORD).get("repeated", "{}")).items()
            if isinstance(value, int)
        }

    def counters(self) -> dict[str, dict[str, int]]:
        """Return the loss counters by topic, as of the last chunk."""
        rows = {topic: parsed_mapping(text) for topic, text in self.metadata_record(COUNTERS_RECORD).items()}
        return counter_rows(rows)


def counter_rows(rows: Mapping[str, object]) -> dict[str, dict[str, int]]:
    """Return loss counters by topic, without values that are not integers."""
    return {
        topic: {key: value for key, value in row.items() if isinstance(value, int)}
        for topic, row in rows.items()
        if isinstance(row, dict)
    }


def parsed_mapping(text: str) -> dict[str, object]:
    """Return a JSON object; empty if the text is not one."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}


def _contents(file: RecordFile, extent: Extent) -> Iterator[Record]:
    offset = extent.offset
    while offset < extent.offset + extent.length:
        found = file.record_at(offset)
        if isinstance(found.record, Chunk):
            yield from inner_records(decompressed(found.record))
        else:
            yield found.record
        offset += found.length
