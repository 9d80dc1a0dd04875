# SPDX-License-Identifier: Apache-2.0
"""Message definitions as stored in a bag, collected from the installed message packages.

Every package installs `share/<package>/msg/<Type>.msg` and a type description (`.json`, REP-2011, REP-2016) that
lists the referenced types and their hashes.  Neither a running ROS nor its environment variables are needed.

The types of a bag are the installed classes; its quality of service is read too.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from mech_twin.recording.bag_metadata import qos_profiles
from mech_twin.recording.errors import DecodeError, UnknownTypeError

if TYPE_CHECKING:
    from mech_twin.recording.bag_contents import TopicInfo

_SEPARATOR = "=" * 80
_TYPE_NAME = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")
DEEPEST = 10_000
CDR = "cdr"


class MessageSchema(NamedTuple):
    """A message type: its name, its full `ros2msg` text, and its REP-2011 hash."""

    type_name: str
    definition: str
    type_hash: str


@cache
def message_schema(type_name: str) -> MessageSchema:
    """Return the definition of a type, including all types it depends on.

    Parameters
    ----------
    type_name : str
        Full name such as `sensor_msgs/msg/JointState`.

    Raises
    ------
    UnknownTypeError
        No installed package defines it.
    """
    if not _TYPE_NAME.fullmatch(type_name):
        raise UnknownTypeError(f"'{type_name}' is no message type; expected package/msg/Type")
    description = _description(type_name)
    own = description["type_description_msg"]["type_description"]["type_name"]
    if own != type_name:
        raise UnknownTypeError(f"type '{type_name}': its description is that of '{own}'")
    hashes = {item["type_name"]: item["hash_string"] for item in description["type_hashes"]}
    others = [item["type_name"] for item in description["type_description_msg"]["referenced_type_descriptions"]]
    parts = [_text(type_name)]
    parts += [f"{_SEPARATOR}\nMSG: {other.replace('/msg/', '/')}\n{_text(other)}" for other in others]
    return MessageSchema(type_name, "\n".join(parts), hashes[type_name])


def installed_shares() -> Iterator[Path]:
    """Yield the share directories that may contain message packages, sourced workspaces first."""
    for prefix in [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]:
        if prefix:
            yield Path(prefix) / "share"


def offered_qos(
    reliability: str = "reliable", durability: str = "volatile", depth: int = 10, history: str = "keep_last"
) -> str:
    """Return the YAML of one offered QoS profile, as rosbag2 (metadata version 9) writes it on a channel."""
    forever = "sec: 9223372036\n    nsec: 854775807"
    return (
        f"- history: {history}\n  depth: {depth}\n  reliability: {reliability}\n  durability: {durability}\n"
        f"  deadline:\n    {forever}\n  lifespan:\n    {forever}\n"
        f"  liveliness: automatic\n  liveliness_lease_duration:\n    {forever}\n"
        "  avoid_ros_namespace_conventions: false\n"
    )


def _file(type_name: str, ending: str) -> Path:
    package, _, name = type_name.split("/")
    for share in installed_shares():
        path = share / package / "msg" / f"{name}.{ending}"
        if path.is_file():
            return path
    raise UnknownTypeError(
        f"type '{type_name}': no {package}/msg/{name}.{ending} under {', '.join(map(str, installed_shares()))}"
    )


def _text(type_name: str) -> str:
    return _file(type_name, "msg").read_text(encoding="utf-8")


def _description(type_name: str) -> dict[str, Any]:
    path = _file(type_name, "json")
    try:
        description: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise UnknownTypeError(f"type '{type_name}': {path} is no type description ({error})") from error
    return description


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
    profiles = [each for each in qos_profiles(qos_yaml) if isinstance(each, dict)] or [{}]
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


_NUMBERED = {  # rosbag2 before version 8 wrote the numbers of rmw
    "reliable": {1: "reliable", 2: "best_effort"},
    "volatile": {1: "transient_local", 2: "volatile"},
    "keep_last": {1: "keep_last", 2: "keep_all"},
}


def _word(value: Any, default: str) -> str:
    return _NUMBERED[default].get(value, default) if isinstance(value, int) else str(value or default).lower()


def _depth(value: Any) -> int:
    return min(max(value, 1), DEEPEST) if isinstance(value, int) and not isinstance(value, bool) else 10
