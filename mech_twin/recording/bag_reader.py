# SPDX-License-Identifier: Apache-2.0
"""Reads a recording in order of log time, in bounded memory."""

import heapq
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from mcap.records import Channel

from mech_twin.recording.bag_contents import BagInfo, BagMessage, RecordingReader, SplitInfo, TopicInfo
from mech_twin.recording.bag_directory import (
    bag_files,
    inside,
    is_sqlite_bag,
    missing_parts,
    plain_file,
    plain_message,
)
from mech_twin.recording.bag_metadata import FILE_NAME, custom_data, read_metadata
from mech_twin.recording.bag_split import COUNTERS_KEY, FINISHED_KEY, RECOVERED_KEY
from mech_twin.recording.errors import (
    BagBeyondLimitsError,
    BagError,
    DamagedBagError,
    MissingPartError,
    UnfinishedBagError,
)
from mech_twin.recording.file_index import (
    MAX_CHANNELS,
    Extent,
    FileIndex,
    counter_rows,
    parsed_mapping,
    scanned_index,
    summary_index,
)
from mech_twin.recording.record_file import RawMessage, RecordFile, UnreadableRecordError

Answer = TypeVar("Answer")
MAX_OPEN_BYTES = 1 << 30
MESSAGE_BYTES = 256  # memory per message besides its payload


class BagReader(RecordingReader):
    """A bag open for reading: a rosbag2 directory, or one MCAP file.

    Parameters
    ----------
    salvage : bool
        Read the intact part of an unfinished or damaged bag instead of refusing it.

    Raises
    ------
    MissingBagError, ForeignFileError, UnfinishedBagError, DamagedBagError
        One line with the file and the reason.
    """

    def __init__(self, path: Path | str, *, salvage: bool = False) -> None:
        super().__init__(path)
        self._indexes: list[FileIndex] = []
        with ExitStack() as undo:
            undo.callback(self.close)
            files, self._finished = _files_of(self.path, salvage, self._problems)
            for file in files:
                self._open(file, salvage)
            undo.pop_all()
        for index in self._indexes:
            for key, channel in index.channels.items():
                self._add_topic(_topic_info(index, key, channel))
        starts = [extent.start_ns for index in self._indexes for extent in index.extents]
        ends = [extent.end_ns for index in self._indexes for extent in index.extents]
        self.start_ns: int | None = min(starts, default=None)
        self.end_ns: int | None = max(ends, default=None)

    @property
    def info(self) -> BagInfo:
        """Return the summary of the bag."""
        texts = (index.configuration() for index in self._indexes)
        return self._info(
            map(_split_info, self._indexes),
            self._finished and all(index.finished for index in self._indexes),
            (*self._problems, *self._cut()),
            counters=self._counters(),
            configuration=next((text for text in texts if text is not None), None),
        )

    def _cut(self) -> tuple[str, ...]:
        salvaged = custom_data(self.path).get(RECOVERED_KEY)
        return () if salvaged is None else (f"{self.path}: salvaged from a damaged recording: {salvaged}",)

    def _counters(self) -> dict[str, dict[str, int]]:
        """Return the loss counters by topic: the larger of those in the last file and in `metadata.yaml`.

        They only grow; messages received after the last file was finished (disk full) are only in `metadata.yaml`.
        """
        counters: dict[str, dict[str, int]] = {}
        for index in self._indexes:
            counters = index.counters() or counters
        if self.path.is_file() and any(index.split_number() for index in self._indexes):
            return {}  # they count the whole bag; this is one later file of it
        stored = counter_rows(parsed_mapping(custom_data(self.path).get(COUNTERS_KEY, "{}")))
        for topic in counters.keys() & stored.keys():
            row, later = counters[topic], stored[topic]
            counters[topic] = {key: max(value, later.get(key, 0)) for key, value in row.items()}
        for topic, row in counters.items():  # "written": messages present; the others were cut
            held = self.topics[topic].message_count if topic in self.topics else 0
            cut = max(0, row.get("written", 0) - held)
            row["written"] = held
            if cut:
                row["cut"] = cut
            row["received"] = held + row.get("dropped", 0) + cut
        return counters

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_s: float = 0.0,
        duration_s: float | None = None,
        *,
        as_written: bool = False,
    ) -> Iterator[BagMessage]:
        """Yield the messages; see `RecordingReader.messages`."""
        if self.start_ns is None:
            return
        first = self.start_ns + round(start_s * 1e9)
        last = (1 << 64) if duration_s is None else first + round(duration_s * 1e9)
        wanted = [
            {key for key, channel in index.channels.items() if topics is None or channel.topic in topics}
            for index in self._indexes
        ]
        chosen = [
            (number, extent)
            for number, index in enumerate(self._indexes)
            for extent in index.extents
            if extent.end_ns >= first
            and extent.start_ns <= last
            and (not extent.channels or extent.channels & wanted[number])
        ]
        ordered: Iterator[tuple[int, RawMessage]]
        if as_written:
            chosen.sort(key=lambda item: (item[0], item[1].offset))
            ordered = ((number, each) for number, at in chosen for each in self._indexes[number].records_of(at))
        else:
            self._check_disorder(extent for _, extent in chosen)
            ordered = self._merged(sorted(chosen, key=lambda item: (item[1].start_ns, item[0], item[1].offset)))
        for number, record in ordered:
            if first <= record.log_time_ns <= last and record.channel_id in wanted[number]:
                index = self._indexes[number]
                if index.repeats.get(record.channel_id) == record.sequence:
                    continue
                channel = index.channels[record.channel_id]
                name = index.schema_of(channel).name
                try:
                    raw = plain_message(record.raw)
                except UnreadableRecordError as error:
                    raise DamagedBagError(index.file.path, f"topic {channel.topic}: {error}") from error
                yield BagMessage(channel.topic, name, record.log_time_ns, record.publish_time_ns, raw)

    def _merged(self, chosen: list[tuple[int, Extent]]) -> Iterator[tuple[int, RawMessage]]:
        """Yield the messages of the extents in time order; an extent is in memory only during its time range."""
        waiting: list[tuple[int, int, int, RawMessage, Iterator[RawMessage]]] = []
        following = 0
        open_bytes: dict[int, int] = {}
        while waiting or following < len(chosen):
            while following < len(chosen) and (not waiting or chosen[following][1].start_ns <= waiting[0][0]):
                number, extent = chosen[following]
                found = sorted(self._indexes[number].records_of(extent), key=lambda item: item.log_time_ns)
                open_bytes[following] = sum(len(record.raw) + MESSAGE_BYTES for record in found)
                if sum(open_bytes.values()) > MAX_OPEN_BYTES:
                    raise self._beyond_limits()
                records = iter(found)
                if (head := next(records, None)) is not None:
                    heapq.heappush(waiting, (head.log_time_ns, following, number, head, records))
                else:
                    del open_bytes[following]
                following += 1
            if not waiting:
                continue
            _, order, number, record, records = waiting[0]
            if (head := next(records, None)) is None:
                heapq.heappop(waiting)
                del open_bytes[order]
            else:
                heapq.heapreplace(waiting, (head.log_time_ns, order, number, head, records))
            yield number, record

    def _check_disorder(self, extents: Iterator[Extent]) -> None:
        """Refuse a bag whose chunks overlap in time so much that sorting exceeds `MAX_OPEN_BYTES`."""
        borders: list[tuple[int, int, int]] = []
        for extent in extents:
            borders += [(extent.start_ns, 0, extent.size_bytes), (extent.end_ns, 1, -extent.size_bytes)]
        open_bytes = 0
        for _, _, change in sorted(borders):
            open_bytes += change
            if open_bytes > MAX_OPEN_BYTES:
                raise self._beyond_limits()

    def _beyond_limits(self) -> BagBeyondLimitsError:
        limit = MAX_OPEN_BYTES >> 20
        return BagBeyondLimitsError(
            self.path, f"its chunks overlap in time so far that sorting needs more than {limit} MiB"
        )

    def _open(self, path: Path, salvage: bool) -> None:
        file = RecordFile(path, plain_file(path, self._stack, partial=salvage))
        self._stack.callback(file.close)
        index = scanned_index(file) if salvage else summary_index(file)
        if salvage:
            self._problems += index.problems()
        if len(index.channels) > MAX_CHANNELS:
            raise BagBeyondLimitsError(path, f"has {len(index.channels)} channels, more than {MAX_CHANNELS}")
        if self._indexes:
            repeated = index.repeated()
            index.repeats = {
                key: repeated[channel.topic] for key, channel in index.channels.items() if channel.topic in repeated
            }
        self._indexes.append(index)


def open_bag(path: Path | str, *, salvage: bool = False) -> RecordingReader:
    """Return a reader of a recording in MCAP or sqlite3 storage; ``salvage`` reads the intact part of a damaged one.

    Raises
    ------
    MissingBagError, ForeignFileError, UnfinishedBagError, DamagedBagError
        One line with the file and the reason.
    """
    if is_sqlite_bag(Path(path)):
        from mech_twin.recording.sqlite_reader import SqliteReader

        return SqliteReader(path, salvage=salvage)
    return BagReader(path, salvage=salvage)


def bag_info(path: Path | str) -> BagInfo:
    """Return the summary of a bag; of an unfinished or damaged one, of its intact part, with the problems listed."""
    return about_bag(path, lambda reader: None)[0]


def about_bag(
    path: Path | str, ask: Callable[[RecordingReader], Answer], *, verify: bool = False
) -> tuple[BagInfo, Answer]:
    """Return the summary of a bag and the result of ``ask``; for a damaged bag those of its intact part.

    The summary tells only of damage between the chunks; ``verify`` reads each and its checksum.
    """
    problems: tuple[str, ...] = ()
    try:
        with open_bag(path) as reader:
            if not verify:
                return reader.info, ask(reader)
    except (UnfinishedBagError, DamagedBagError, MissingPartError) as error:
        problems = (str(error),)
    with open_bag(path, salvage=True) as reader:
        found, answer = reader.info, ask(reader)
    return replace(found, problems=found.problems or problems), answer


def _files_of(path: Path, salvage: bool, problems: list[str]) -> tuple[list[Path], bool]:
    """Return the files of a bag and whether its metadata marks it as closed."""
    files = bag_files(path)
    if path.is_file():
        return files, True
    problems += missing_parts(path, files)
    try:
        if not (path / FILE_NAME).exists():
            raise UnfinishedBagError(path, f"has no {FILE_NAME}: it was never closed, or is still being written")
        metadata = read_metadata(path)
        if metadata.custom.get(FINISHED_KEY, "true") != "true":
            raise UnfinishedBagError(path, "was never closed, or is still being written")
        listed = [inside(path, path / name) for name in metadata.files]
        if len(set(listed)) < len(listed):
            raise DamagedBagError(path, f"{FILE_NAME} names a file twice")
        for file in listed:
            if not file.is_file():
                raise DamagedBagError(path, f"its part {file.name}, listed in {FILE_NAME}, does not exist")
    except (UnfinishedBagError, DamagedBagError) as error:
        if not salvage:
            raise
        problems.append(f"{error.file}: {error.reason}")
        return files, False
    return listed, True


def lost_messages(path: Path) -> str:
    """Return a line on the messages that a new recording has lost; empty if none."""
    if not path.exists():  # an empty recording was deleted
        return ""
    try:
        info = bag_info(path)
    except BagError as error:
        return str(error)
    dropped = sum(row.get("dropped", 0) for row in info.counters.values())
    open_end = "" if info.finished else "the recording could not be closed"
    lost = f"{dropped} messages lost, which the disk did not accept" if dropped else ""
    found = "; ".join(filter(None, (lost, open_end)))
    return f"{path}: {found}" if found else ""


def _topic_info(index: FileIndex, key: int, channel: Channel) -> TopicInfo:
    schema = index.schema_of(channel)
    return TopicInfo(
        channel.topic,
        schema.name,
        index.counts[key] - (1 if key in index.repeats and index.counts[key] else 0),
        channel.metadata.get("offered_qos_profiles", ""),
        channel.metadata.get("topic_type_hash", ""),
        schema.data.decode("utf-8", "replace"),
        schema.encoding,
        channel.message_encoding,
    )


def _split_info(index: FileIndex) -> SplitInfo:
    return SplitInfo(
        index.file.path,
        index.file.path.stat().st_size,
        min((extent.start_ns for extent in index.extents), default=None),
        max((extent.end_ns for extent in index.extents), default=None),
        index.counts.total(),
    )
