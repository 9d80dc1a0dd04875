# SPDX-License-Identifier: Apache-2.0
"""Writes and reads `metadata.yaml` (version 9) of a rosbag2 directory.

The directory of a new recording is checked before a run, created for it, and free of other files.
"""

import os
import shutil
import stat
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from glob import escape
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import mkdtemp
from types import MappingProxyType
from typing import Any

import yaml

from mech_twin.files.input_file import bounded_yaml, opened_input
from mech_twin.files.output_file import DIRECTORY_MODE, FILE_MODE, NEW_FILE, OutputError, check_output_directory
from mech_twin.recording.errors import (
    BagError,
    BagExistsError,
    DamagedBagError,
    ForeignFileError,
    MissingBagError,
    UnwritableDirectoryError,
    salvage,
)

VARIABLE = "ROS_DISTRO"  # a native installation sets it; the wheels do not
# major version of rclpy in each release; as a wheel its distribution is called ros-rclpy
RELEASES: Mapping[str, str] = MappingProxyType({"3": "humble", "7": "jazzy", "9": "kilted"})
RCLPY = ("ros-rclpy", "rclpy")
UNKNOWN = "unknown"
FILE_NAME = "metadata.yaml"
RESERVATION_NAME = ".reserve"
MAX_FILE_BYTES = 1 << 20
LONGEST_QOS = 1 << 16
MCAP = "mcap"
SQLITE = "sqlite3"
ZSTD = "zstd"
MAX_SPLITS = 10_000


def running_distro(environment: Mapping[str, str] = os.environ, installed: Callable[[str], str] = version) -> str:
    """Return the release, from the environment or from the version of rclpy; ``unknown`` if neither gives it.

    Parameters
    ----------
    installed : callable, optional
        Returns the version of a distribution; raises PackageNotFoundError.
    """
    named = environment.get(VARIABLE)
    if named:
        return named
    for distribution in RCLPY:
        try:
            return RELEASES.get(installed(distribution).partition(".")[0], UNKNOWN)
        except PackageNotFoundError:
            continue
    return UNKNOWN


class _PlainDumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes YAML without anchors and aliases, which other rosbag2 readers do not expect."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


@dataclass
class FileStatistics:
    """Message counts and time range of one file."""

    name: str
    counts: Counter[str] = field(default_factory=Counter)
    start_ns: int | None = None
    end_ns: int = 0

    def count(self, topic: str, log_time_ns: int) -> None:
        """Count one message."""
        self.counts[topic] += 1
        if self.start_ns is None or log_time_ns < self.start_ns:
            self.start_ns = log_time_ns
        self.end_ns = max(self.end_ns, log_time_ns)


@dataclass(frozen=True)
class TopicMetadata:
    """Name, type and quality of service of a topic."""

    topic: str
    type_name: str
    qos_yaml: str
    type_hash: str


@dataclass(frozen=True)
class BagMetadata:
    """The fields of `metadata.yaml` that are needed to open a bag."""

    files: tuple[str, ...]
    custom: Mapping[str, str]


def write_metadata(
    directory: Path,
    topics: Sequence[TopicMetadata],
    files: Sequence[FileStatistics],
    custom: Mapping[str, str],
) -> None:
    """Write `metadata.yaml` atomically: a reader finds the old file or the new one."""
    text = yaml.dump(
        {"rosbag2_bagfile_information": _information(topics, files, custom)},
        Dumper=_PlainDumper,
        sort_keys=False,
        allow_unicode=True,
    )
    temporary = directory / f".{FILE_NAME}.{os.getpid()}"
    temporary.unlink(missing_ok=True)
    try:
        with os.fdopen(os.open(temporary, NEW_FILE, FILE_MODE), "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(directory / FILE_NAME)
    finally:
        temporary.unlink(missing_ok=True)


def read_metadata(directory: Path, storage: str = MCAP) -> BagMetadata:
    """Return the contents of `metadata.yaml`.

    Raises
    ------
    MissingBagError, ForeignFileError, DamagedBagError
        It cannot be read, describes another storage format, or is not rosbag2 metadata.
    """
    path = directory / FILE_NAME
    try:
        with opened_input(path) as stream:
            text = stream.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise MissingBagError(path, f"cannot be read ({error.strerror})") from error
    remedy = f"to read the rest, move {path} away" if storage == SQLITE else salvage(directory)
    if len(text) > MAX_FILE_BYTES:
        raise DamagedBagError(path, f"larger than {MAX_FILE_BYTES} bytes", remedy)
    try:
        information = bounded_yaml(text)["rosbag2_bagfile_information"]
        found = information["storage_identifier"]
        names = tuple(str(name) for name in information["relative_file_paths"])
        compression = str(information.get("compression_format") or ZSTD).lower()
        custom = {str(key): str(value) for key, value in (information.get("custom_data") or {}).items()}
    except (yaml.YAMLError, KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        raise DamagedBagError(path, f"is not rosbag2 metadata ({type(error).__name__}: {error})", remedy) from error
    if found != storage:
        raise ForeignFileError(
            path, f"storage '{found}' does not match its files or is not supported; convert it with `ros2 bag convert`"
        )
    if compression != ZSTD:
        raise ForeignFileError(path, f"compression '{compression}': expected {ZSTD}; convert with `ros2 bag convert`")
    for name in names:
        if Path(name).name != name or name in {"", ".."}:
            raise DamagedBagError(path, f"names a file outside its directory: '{name}'", remedy)
    if len(names) > MAX_SPLITS:
        raise DamagedBagError(path, f"names {len(names)} files, more than {MAX_SPLITS}", remedy)
    return BagMetadata(names, custom)


def custom_data(path: Path) -> Mapping[str, str]:
    """Return the custom data of a bag's `metadata.yaml`; empty without readable ones."""
    try:
        return read_metadata(path).custom if path.is_dir() else {}
    except BagError:
        return {}


def _span(start_ns: int | None, end_ns: int) -> dict[str, dict[str, int]]:
    return {
        "duration": {"nanoseconds": end_ns - start_ns if start_ns is not None else 0},
        "starting_time": {"nanoseconds_since_epoch": start_ns if start_ns is not None else 0},
    }


def _information(
    topics: Sequence[TopicMetadata], files: Sequence[FileStatistics], custom: Mapping[str, str]
) -> dict[str, Any]:
    totals: Counter[str] = Counter()
    for file in files:
        totals.update(file.counts)
    starts = [file.start_ns for file in files if file.start_ns is not None]
    return {
        "version": 9,
        "storage_identifier": MCAP,
        **_span(min(starts, default=None), max((file.end_ns for file in files), default=0)),
        "message_count": totals.total(),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.topic,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": qos_profiles(topic.qos_yaml),
                    "type_description_hash": topic.type_hash,
                },
                "message_count": totals[topic.topic],
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {"path": file.name, **_span(file.start_ns, file.end_ns), "message_count": file.counts.total()}
            for file in files
        ],
        "custom_data": dict(custom),
        "ros_distro": running_distro(),
    }


@lru_cache(maxsize=64)
def qos_profiles(qos_yaml: str) -> list[Any]:
    """Return the QoS profiles as a list; empty if the text of a foreign bag cannot be parsed."""
    try:
        profiles = bounded_yaml(qos_yaml) if len(qos_yaml) <= LONGEST_QOS else []
    except (yaml.YAMLError, ValueError, RecursionError):
        return []
    return profiles if isinstance(profiles, list) else []


def check_recording_directory(directory: Path, *, force: bool = False) -> None:
    """Check that a recording can be created in this directory.

    Parameters
    ----------
    directory : Path
        The directory; it may be empty or not exist yet.
    force : bool
        Whether it may contain another recording, which `remove_recording` deletes.

    Raises
    ------
    BagExistsError
        It is not empty; with ``force``, it contains files that do not belong to a recording.
    UnwritableDirectoryError
        It cannot be created or written.
    """
    if _occupied(directory):
        if not force:
            raise BagExistsError(directory, "exists already and is not empty; use --force to overwrite the recording")
        _recording_files(directory)
    try:
        check_output_directory(directory, force=True)
    except OutputError as error:
        raise UnwritableDirectoryError(directory, str(error).removeprefix(f"{directory}: ")) from error


def remove_recording(directory: Path) -> None:
    """Delete the recording in this directory, if there is one, but not the directory.

    Raises
    ------
    BagExistsError
        It holds files that do not belong to a recording; nothing is deleted.
    """
    if _occupied(directory):
        for path in _recording_files(directory):
            path.unlink()


@contextmanager
def kept_until_replaced(directory: Path | None) -> Iterator[list[str]]:
    """Keep the recording in this directory until another one stands there; put it back after a failure without one.

    Where no directory can be made beside it, it is deleted at the beginning.  Yields a line on each recording that is
    kept beside the directory: this one, and those that killed runs were to replace.
    """
    files = _recording_files(directory) if directory is not None and _occupied(directory) else []
    directory = None if directory is None else directory.absolute()
    prefix = "" if directory is None else f".{directory.name}-replaced-"
    left = [] if directory is None else sorted(directory.parent.glob(f"{escape(prefix)}*"))
    kept = [f"{path}: an earlier recording, which a killed run was to replace" for path in left]
    if directory is None or not files:
        yield kept
        return
    try:
        aside = Path(mkdtemp(prefix=prefix, dir=directory.parent))
    except OSError:
        remove_recording(directory)
        yield kept
        return
    for path in files:
        shutil.move(path, aside)
    try:
        yield [*kept, f"{aside}: the earlier recording, until this run has ended"]
    except BaseException:
        if not _occupied(directory):
            directory.mkdir(DIRECTORY_MODE, exist_ok=True)
            for path in list(aside.iterdir()):
                shutil.move(path, directory)
        shutil.rmtree(aside)
        raise
    shutil.rmtree(aside)


def new_directory(wanted: Path) -> tuple[Path, list[Path]]:
    """Return an empty directory and the directories created for it, innermost first.

    Raises
    ------
    BagExistsError, UnwritableDirectoryError
        The directory is not empty or cannot be created; nothing is left behind.
    """
    directory = wanted.absolute()
    if _occupied(directory):
        raise BagExistsError(directory, "is not empty; nothing is overwritten, choose another directory")
    made: list[Path] = []
    try:
        missing = [path for path in (directory, *directory.parents) if not path.exists()]
        for path in reversed(missing):
            path.mkdir(DIRECTORY_MODE)
            made.insert(0, path)
    except OSError as error:
        for path in made:
            path.rmdir()
        raise UnwritableDirectoryError(directory, f"cannot be created ({error.strerror})") from error
    return directory, made


def _recording_files(directory: Path) -> list[Path]:
    """Return the files of a directory, which must contain a recording and nothing else."""
    if not directory.is_dir():
        raise BagExistsError(directory, "is not a directory")
    files = list(directory.iterdir())
    for path in files:
        belongs = path.suffix == ".mcap" or path.name in {FILE_NAME, RESERVATION_NAME}
        if not (belongs and stat.S_ISREG(path.lstat().st_mode)):
            raise BagExistsError(
                directory, f"holds '{path.name}', which is not part of a recording; nothing is deleted"
            )
    return files


def _occupied(directory: Path) -> bool:
    """Whether the path is a non-empty directory, another file, or a symbolic link, which is never followed."""
    try:
        if not os.path.lexists(directory):
            return False
        return directory.is_symlink() or not directory.is_dir() or any(directory.iterdir())
    except OSError as error:
        raise UnwritableDirectoryError(directory, f"cannot be read ({error.strerror})") from error
