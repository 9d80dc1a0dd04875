# SPDX-License-Identifier: Apache-2.0
"""Reads rosbag2 recordings in sqlite3 storage (`.db3`) with the package rosbags."""

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import apsw
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import Reader, ReaderError

from mech_twin.recording.bag_contents import BagInfo, BagMessage, RecordingReader, SplitInfo, TopicInfo
from mech_twin.recording.bag_directory import (
    SQLITE_SUFFIX,
    bag_files,
    inside,
    missing_parts,
    plain_file,
    plain_message,
)
from mech_twin.recording.bag_metadata import FILE_NAME, SQLITE, read_metadata
from mech_twin.recording.errors import DamagedBagError, MissingBagError, MissingPartError
from mech_twin.recording.record_file import MAX_RECORD_BYTES, UnreadableRecordError
from mech_twin.recording.schemas import offered_qos

_FAILURES = (ReaderError, UnreadableRecordError, apsw.Error, ValueError, TypeError, LookupError, MemoryError)


class SqliteReader(RecordingReader):
    """A sqlite3 bag open for reading: a rosbag2 directory, or one `.db3` file.

    Parameters
    ----------
    salvage : bool
        Read the existing files of a bag of which others are missing.

    Raises
    ------
    MissingBagError, ForeignFileError, DamagedBagError
        One line with the file and the reason.
    """

    def __init__(self, path: Path | str, *, salvage: bool = False) -> None:
        super().__init__(path)
        self._files = _files_of(self.path, salvage, self._problems)
        self._readers: list[Reader] = []
        with ExitStack() as undo:
            undo.callback(self.close)
            for file in self._files:
                self._open(file)
            undo.pop_all()
        filled = [reader for reader in self._readers if reader.message_count]
        self.start_ns: int | None = min((reader.start_time for reader in filled), default=None)
        self.end_ns: int | None = max((reader.end_time - 1 for reader in filled), default=None)
        for reader in self._readers:
            for item in reader.connections:
                self._add_topic(_topic_info(item))

    @property
    def info(self) -> BagInfo:
        """Return the summary of the bag."""
        finished = self.path.is_file() or (self.path / FILE_NAME).is_file()
        absent = () if finished else (f"{self.path}: has no {FILE_NAME}",)
        splits = map(_split_info, self._files, self._readers)
        return self._info(splits, finished, (*absent, *self._problems))

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_s: float = 0.0,
        duration_s: float | None = None,
        *,
        as_written: bool = False,
    ) -> Iterator[BagMessage]:
        """Yield the messages file by file, always in order of time within each; see `BagReader.messages`.

        Raises
        ------
        DamagedBagError
            The database is corrupt.
        """
        if self.start_ns is None or self.end_ns is None:
            return
        first = self.start_ns + round(start_s * 1e9)
        last = self.end_ns if duration_s is None else min(self.end_ns, first + round(duration_s * 1e9))
        for file, reader in zip(self._files, self._readers, strict=True):
            wanted = [item for item in reader.connections if topics is None or item.topic in topics]
            with _reported(file):
                for item, time_ns, raw in reader.messages(wanted, first, last + 1) if wanted else ():
                    yield BagMessage(item.topic, item.msgtype, time_ns, time_ns, plain_message(bytes(raw)))

    def _open(self, file: Path) -> None:
        with _reported(file):
            reader = Reader(plain_file(file, self._stack))
            reader.open()
            self._stack.callback(reader.close)
            storage: Any = reader.storage
            storage.dbconn.limit(apsw.SQLITE_LIMIT_LENGTH, MAX_RECORD_BYTES)
            self._readers.append(reader)


def _files_of(path: Path, salvage: bool, problems: list[str]) -> list[Path]:
    if not path.exists():
        raise MissingBagError(path, "there is no such bag")
    if path.is_file():
        return [path]
    if not (path / FILE_NAME).is_file():
        files = bag_files(path, SQLITE_SUFFIX)
        problems += missing_parts(path, files)
        return files
    listed = [inside(path, path / name) for name in read_metadata(path, storage=SQLITE).files]
    for file in listed:
        if not file.is_file():
            if not salvage:
                raise MissingPartError(path, file, FILE_NAME)
            problems.append(f"{path}: its part {file.name} is missing")
    return [file for file in listed if file.is_file()]


@contextmanager
def _reported(file: Path) -> Iterator[None]:
    """Raise the various errors of rosbags and sqlite as `DamagedBagError`."""
    try:
        yield
    except _FAILURES as error:
        raise DamagedBagError(
            file, f"cannot be read as a sqlite3 bag ({error})", f"salvage its tables: sqlite3 {file} .recover"
        ) from error


def _topic_info(item: Connection) -> TopicInfo:
    extension = item.ext
    assert isinstance(extension, ConnectionExtRosbag2)
    qos = "".join(
        offered_qos(
            profile.reliability.name.lower(),
            profile.durability.name.lower(),
            profile.depth,
            profile.history.name.lower(),
        )
        for profile in extension.offered_qos_profiles
    )
    return TopicInfo(
        item.topic,
        item.msgtype,
        item.msgcount,
        qos,
        item.digest,
        item.msgdef.data,
        "ros2msg",
        extension.serialization_format,
    )


def _split_info(file: Path, reader: Reader) -> SplitInfo:
    count = reader.message_count
    start, end = (reader.start_time, reader.end_time - 1) if count else (None, None)
    return SplitInfo(file, file.stat().st_size, start, end, count)
