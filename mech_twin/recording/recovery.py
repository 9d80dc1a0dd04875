# SPDX-License-Identifier: Apache-2.0
"""Copies the intact records of a damaged or unfinished recording into a new one."""

import secrets
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Channel
from mcap.writer import CompressionType, Writer

from mech_twin.files.output_file import DIRECTORY_MODE
from mech_twin.recording.bag_directory import (
    MCAP_SUFFIX,
    ZSTD_SUFFIX,
    bag_files,
    conversion,
    missing_parts,
    plain_file,
    plain_message,
)
from mech_twin.recording.bag_metadata import (
    FILE_NAME,
    FileStatistics,
    TopicMetadata,
    check_recording_directory,
    custom_data,
    read_metadata,
    remove_recording,
    write_metadata,
)
from mech_twin.recording.bag_split import (
    COUNTERS_KEY,
    FINISHED_KEY,
    LIBRARY,
    RECOVERED_KEY,
    TOPIC_RECORD,
    MessageWriter,
    SplitFile,
)
from mech_twin.recording.errors import (
    BagError,
    BagExistsError,
    DamagedBagError,
    ForeignFileError,
    UnwritableDirectoryError,
)
from mech_twin.recording.file_index import FileIndex, scanned_index
from mech_twin.recording.record_file import RawMessage, RecordFile, UnreadableRecordError

_CHUNK_BYTES = 256 * 1024
_MAX_DAMAGES = 50
_MARK_CHARACTERS = 4000


@dataclass
class RecoveryReport:
    """Result of a recovery.

    Attributes
    ----------
    messages : Counter
        Recovered messages by topic, including the latched messages repeated in later splits.
    messages_of_lost_topics : int
        Intact messages whose channel record is lost.
    bytes_read, bytes_skipped : int
        Size of the files, and number of bytes outside intact records.
    damages : list of str
        Position and reason, one line each; the first fifty.
    """

    bag: Path
    out: Path
    messages: Counter[str] = field(default_factory=Counter)
    messages_of_lost_topics: int = 0
    bytes_read: int = 0
    bytes_skipped: int = 0
    damages: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """Return the report as text lines."""
        rows = [f"{topic}: {count} messages" for topic, count in self.messages.items()]
        return [
            f"{self.out}: salvaged {self.messages.total()} messages of {len(self.messages)} topics from {self.bag}",
            *rows,
            f"skipped {self.bytes_skipped} of {self.bytes_read} bytes, "
            f"{self.messages_of_lost_topics} messages of lost topics",
            *self.damages,
        ]


def recover(bag: Path | str, out: Path | str, *, force: bool = False) -> RecoveryReport:
    """Write a new bag with every intact record of another; return a report.

    No file content raises an error; the source is only read.

    Parameters
    ----------
    bag : Path
        A rosbag2 directory, or one MCAP file, which its name tells: its content may be damaged.
    force : bool
        Overwrite an existing recording.

    Raises
    ------
    MissingBagError
        There is no such bag.
    ForeignFileError
        The file is not named as an MCAP file.
    BagExistsError, UnwritableDirectoryError
        The output exists or cannot be written; nothing is left behind.
    """
    source, target = Path(bag), Path(out).absolute()
    if source.is_file() and not source.name.removesuffix(ZSTD_SUFFIX).endswith(MCAP_SUFFIX):
        raise ForeignFileError(source, f"expected a file {MCAP_SUFFIX} or the directory of a bag{conversion(source)}")
    files = bag_files(source)
    _check_apart(source, target)
    check_recording_directory(target, force=force)
    report = RecoveryReport(source, target, damages=_absent(source, files))
    partial = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    try:
        target.parent.mkdir(DIRECTORY_MODE, parents=True, exist_ok=True)
        partial.mkdir(DIRECTORY_MODE)
        _rebuild(files, partial, report)
        report.messages = Counter(dict(sorted(report.messages.items())))
        remove_recording(target)
        partial.rename(target)
    except OSError as error:
        raise UnwritableDirectoryError(target, f"cannot be written ({error.strerror})") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return report


def _absent(source: Path, files: list[Path]) -> list[str]:
    """Return a line for each missing file of a bag, by its numbers and by `metadata.yaml`."""
    if not source.is_dir():
        return []
    unknown: list[str] = []
    try:
        listed = read_metadata(source).files
    except BagError:
        listed = ()
        unknown.append(f"{source}: has no readable {FILE_NAME}; what was dropped after its last file is not known")
    lines = [f"{source}: its part {name} is missing" for name in listed if not (source / name).is_file()]
    return list(dict.fromkeys([*missing_parts(source, files), *lines, *unknown]))[:_MAX_DAMAGES]


def _check_apart(source: Path, target: Path) -> None:
    """Refuse an output that equals, contains or lies within the source."""
    one, other = source.resolve(), target.resolve()
    if one == other or one in other.parents or other in one.parents:
        raise BagExistsError(target, f"is not separate from {source}; choose another directory")


def _rebuild(files: list[Path], directory: Path, report: RecoveryReport) -> None:
    topics: dict[str, TopicMetadata] = {}
    files_written: list[FileStatistics] = []
    for number, path in enumerate(files):
        with ExitStack() as stack:
            file = RecordFile(path, plain_file(path, stack, partial=True))
            stack.callback(file.close)
            index = scanned_index(file)  # index and summary are not trusted
            report.bytes_read += file.size
            report.bytes_skipped += sum(damage.length for damage in index.damages)
            report.damages += index.problems()[: _MAX_DAMAGES - len(report.damages)]
            files_written.append(_rewritten(index, directory / f"{report.out.name}_{number}.mcap", topics, report))
    salvaged = f"skipped {report.bytes_skipped} of {report.bytes_read} bytes"
    custom = {FINISHED_KEY: "true", RECOVERED_KEY: "; ".join((salvaged, *report.damages))[:_MARK_CHARACTERS]}
    # the loss counters of `metadata.yaml`: after a full disk the files lack the last ones
    custom |= {key: text for key, text in custom_data(report.bag).items() if key == COUNTERS_KEY}
    write_metadata(directory, list(topics.values()), files_written, custom)


def _rewritten(
    index: FileIndex, path: Path, topics: dict[str, TopicMetadata], report: RecoveryReport
) -> FileStatistics:
    """Copy the intact records of one file; return the statistics of the copy."""
    statistics = FileStatistics(path.name)
    file = SplitFile(path, fsync=False)
    try:
        writer = MessageWriter(
            file,  # type: ignore[arg-type]
            _CHUNK_BYTES,
            CompressionType.ZSTD,
            enable_data_crcs=True,
        )
        writer.start(profile="ros2", library=LIBRARY)
        _copy_attachments(index, writer)
        channels = _register(index, writer, topics)
        for channel, record in _intact_messages(index, report):
            writer.add_message(
                channels[channel.id], record.log_time_ns, record.raw, record.publish_time_ns, record.sequence
            )
            statistics.count(channel.topic, record.log_time_ns)
            report.messages[channel.topic] += 1
            if file.pending:
                file.commit()
        writer.finish()
        file.commit()
    finally:
        file.close()
    return statistics


def _copy_attachments(index: FileIndex, writer: Writer) -> None:
    for attachment in index.attachment_records():
        writer.add_attachment(
            attachment.create_time, attachment.log_time, attachment.name, attachment.media_type, attachment.data
        )
    for name in index.metadata:
        if name != TOPIC_RECORD:  # refers to channels by id, and the ids change
            writer.add_metadata(name, index.metadata_record(name))


def _register(index: FileIndex, writer: Writer, topics: dict[str, TopicMetadata]) -> dict[int, int]:
    """Register the schemas and channels of a file; return the new id of each channel."""
    schemas: dict[tuple[str, str, bytes], int] = {}
    channels: dict[int, int] = {}
    for key, channel in index.channels.items():
        schema = index.schema_of(channel)
        same = (schema.name, schema.encoding, schema.data)
        if same not in schemas:
            schemas[same] = writer.register_schema(*same) if schema.id else 0
        channels[key] = writer.register_channel(
            channel.topic, channel.message_encoding, schemas[same], channel.metadata
        )
        qos, type_hash = (channel.metadata.get(name, "") for name in ("offered_qos_profiles", "topic_type_hash"))
        topics.setdefault(channel.topic, TopicMetadata(channel.topic, schema.name, qos, type_hash))
    return channels


def _intact_messages(index: FileIndex, report: RecoveryReport) -> Iterator[tuple[Channel, RawMessage]]:
    for extent in index.extents:
        try:
            for record in index.records_of(extent):
                channel = index.channels.get(record.channel_id)
                if channel is None:
                    report.messages_of_lost_topics += 1
                    continue
                try:
                    yield channel, record._replace(raw=plain_message(record.raw))
                except UnreadableRecordError as error:
                    report.damages.append(f"topic {channel.topic}: {error}")
        except DamagedBagError as error:  # verified a moment ago: the disk itself is failing
            report.damages.append(error.reason)
