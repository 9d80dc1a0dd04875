# SPDX-License-Identifier: Apache-2.0
"""Message definitions as stored in a bag, collected from the installed message packages.

Every package installs `share/<package>/msg/<Type>.msg` and a type description (`.json`, REP-2011, REP-2016) that
lists the referenced types and their hashes.  Neither a running ROS nor its environment variables are needed.
"""

from __future__ import annotations

import json
import os
import re
import struct
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from mech_twin.recording.errors import UnknownTypeError

_SEPARATOR = "=" * 80
_TYPE_NAME = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")


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
    parts += [f"{_SEPARATOR}\nMSG: {_short(other)}\n{_text(other)}" for other in others]
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


def string_cdr(text: str) -> bytes:
    """Return the little-endian CDR encoding of a std_msgs/msg/String."""
    data = text.encode() + b"\0"
    return b"\x00\x01\x00\x00" + struct.pack("<I", len(data)) + data


def _short(type_name: str) -> str:
    package, _, name = type_name.split("/")
    return f"{package}/{name}"


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
