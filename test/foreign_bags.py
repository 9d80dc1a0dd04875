# SPDX-License-Identifier: Apache-2.0
"""Recordings as rosbags writes them: another storage, compressed files or messages."""

from __future__ import annotations

from pathlib import Path

import yaml
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from mech_twin.recording.bag_contents import BagMessage
from mech_twin.recording.bag_reader import BagReader

FOREVER = QosTime(9223372036, 854775807)


def qos_of(qos_yaml: str) -> Qos:
    latched = "transient_local" in qos_yaml
    return Qos(
        QosHistory.KEEP_LAST,
        yaml.safe_load(qos_yaml)[0]["depth"],
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        FOREVER,
        FOREVER,
        QosLiveliness.AUTOMATIC,
        FOREVER,
        avoid_ros_namespace_conventions=False,
    )


def converted(
    bag: Path,
    directory: Path,
    version: int = 9,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write the messages of a bag in another storage or compression, by rosbags."""
    store = get_typestore(Stores.ROS2_JAZZY)
    made = Writer(directory, version=version, storage_plugin=storage)
    if mode is not CompressionMode.NONE:
        made.set_compression(mode, CompressionFormat.ZSTD)
    with BagReader(bag) as reader, made as writer:
        connections = {
            name: writer.add_connection(
                name, topic.type_name, typestore=store, offered_qos_profiles=[qos_of(topic.qos_yaml)]
            )
            for name, topic in reader.topics.items()
        }
        for message in reader.messages():
            writer.write(connections[message.topic], message.log_time_ns, message.raw)
    return directory


def by_topic(messages: list[BagMessage]) -> dict[str, list[tuple[int, bytes]]]:
    found: dict[str, list[tuple[int, bytes]]] = {}
    for message in messages:
        found.setdefault(message.topic, []).append((message.log_time_ns, message.raw))
    return found
