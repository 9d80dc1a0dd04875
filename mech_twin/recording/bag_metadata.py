# SPDX-License-Identifier: Apache-2.0
"""Writes and reads `metadata.yaml` (version 9) of a rosbag2 directory."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from mech_twin.files.bounded_yaml import bounded_yaml
from mech_twin.files.input_file import opened_input
from mech_twin.files.output_file import FILE_MODE, NEW_FILE
from mech_twin.recording.errors import DamagedBagError, ForeignFileError, MissingBagError, salvage

FILE_NAME = "metadata.yaml"
MAX_FILE_BYTES = 1 << 20
LONGEST_QOS = 1 << 16
MCAP = "mcap"
SQLITE = "sqlite3"
ZSTD = "zstd"
MAX_SPLITS = 10_000


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
    ros_distro: str,
) -> None:
    """Write `metadata.yaml` atomically: a reader finds the old file or the new one."""
    text = yaml.dump(
        {"rosbag2_bagfile_information": _information(topics, files, custom, ros_distro)},
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


def _span(start_ns: int | None, end_ns: int) -> dict[str, dict[str, int]]:
    return {
        "duration": {"nanoseconds": end_ns - start_ns if start_ns is not None else 0},
        "starting_time": {"nanoseconds_since_epoch": start_ns if start_ns is not None else 0},
    }


def _information(
    topics: Sequence[TopicMetadata], files: Sequence[FileStatistics], custom: Mapping[str, str], ros_distro: str
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
                    "offered_qos_profiles": _profiles(topic.qos_yaml),
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
        "ros_distro": ros_distro,
    }


@lru_cache(maxsize=64)
def _profiles(qos_yaml: str) -> list[Any]:
    """Return the QoS profiles as a list; empty if the text of a foreign bag cannot be parsed."""
    try:
        profiles = bounded_yaml(qos_yaml) if len(qos_yaml) <= LONGEST_QOS else []
    except (yaml.YAMLError, ValueError, RecursionError):
        return []
    return profiles if isinstance(profiles, list) else []
