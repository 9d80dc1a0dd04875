# SPDX-License-Identifier: Apache-2.0
"""Message types of a bag: the installed classes, decoding, and the recorded quality of service."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import yaml
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from mech_twin.files.bounded_yaml import bounded_yaml
from mech_twin.recording.bag_metadata import LONGEST_QOS
from mech_twin.recording.errors import DecodeError, UnknownTypeError
from mech_twin.recording.schemas import message_schema

if TYPE_CHECKING:
    from mech_twin.recording.bag_contents import TopicInfo

DEEPEST = 10_000
CDR = "cdr"


def message_class(topic: TopicInfo) -> Any:
    """Return the installed class of a topic's messages.

    The type name comes from the bag, so a module is imported only if an installed package defines a message of this
    name and hash.

    Raises
    ------
    UnknownTypeError
        The type is not installed, is installed in another version, or the encoding is not CDR.
    """
    if topic.message_encoding != CDR:
        raise UnknownTypeError(f"encoding '{topic.message_encoding}' is not {CDR}")
    schema = message_schema(topic.type_name)
    if topic.type_hash.startswith("RIHS01_") and topic.type_hash != schema.type_hash:
        raise UnknownTypeError(f"type '{topic.type_name}' is another version than the one installed")
    package, _, name = topic.type_name.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise UnknownTypeError(f"type '{topic.type_name}' cannot be imported") from error


def decoded(raw: bytes, kind: Any) -> Any:
    """Return the message decoded from CDR.

    Raises
    ------
    DecodeError
        The bytes are not a message of this type.
    """
    try:
        return deserialize_message(raw, kind)
    except (RuntimeError, ValueError, MemoryError) as error:  # RMWError is a RuntimeError
        raise DecodeError(f"no {kind.__name__}") from error


def recorded_qos(qos_yaml: str) -> QoSProfile:
    """Return the quality of service offered on a topic; the strictest of several publishers.

    Deadline, lifespan and lease are ignored: they are valid at the recorded rate only.
    """
    profiles = _profiles(qos_yaml) or [{}]
    reliable = any(_word(p.get("reliability"), "reliable") != "best_effort" for p in profiles)
    latched = any(_word(p.get("durability"), "volatile") == "transient_local" for p in profiles)
    every = any(_word(p.get("history"), "keep_last") == "keep_all" for p in profiles)
    depth = max(_depth(p.get("depth")) for p in profiles)
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_ALL if every else HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def is_latched(qos: QoSProfile) -> bool:
    """Return whether late subscribers still receive the last messages (transient local)."""
    return bool(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)


_NUMBERED = {  # rosbag2 before version 8 wrote the numbers of rmw
    "reliable": {1: "reliable", 2: "best_effort"},
    "volatile": {1: "transient_local", 2: "volatile"},
    "keep_last": {1: "keep_last", 2: "keep_all"},
}


def _word(value: Any, default: str) -> str:
    return _NUMBERED[default].get(value, default) if isinstance(value, int) else str(value or default).lower()


def _depth(value: Any) -> int:
    return min(max(value, 1), DEEPEST) if isinstance(value, int) and not isinstance(value, bool) else 10


def _profiles(qos_yaml: str) -> list[dict[str, Any]]:
    if len(qos_yaml) > LONGEST_QOS:
        return []
    try:
        found = bounded_yaml(qos_yaml) if qos_yaml else []
    except (yaml.YAMLError, ValueError, RecursionError):
        return []
    return [profile for profile in found if isinstance(profile, dict)] if isinstance(found, list) else []
