# SPDX-License-Identifier: Apache-2.0
"""Header stamp of a message, read from its CDR bytes."""

from __future__ import annotations

import struct

ENCAPSULATION = 4
SEQUENCE_LENGTH = 4
HEADER_FIRST = frozenset(
    {
        "sensor_msgs/msg/Imu",
        "sensor_msgs/msg/JointState",
        "geometry_msgs/msg/TransformStamped",
        "geometry_msgs/msg/WrenchStamped",
        "geometry_msgs/msg/Vector3Stamped",
        "diagnostic_msgs/msg/DiagnosticArray",
        "trajectory_msgs/msg/JointTrajectory",
        "rosgraph_msgs/msg/Clock",
    }
)
SEQUENCE_OF_HEADERS_FIRST = frozenset({"visualization_msgs/msg/MarkerArray"})


def stamp_ns(type_name: str, raw: bytes) -> int | None:
    """Return the header stamp of a message in nanoseconds, None for a type without one.

    Parameters
    ----------
    type_name : str
        Such as ``sensor_msgs/msg/JointState``.
    raw : bytes
        CDR with its four-byte encapsulation header.
    """
    if type_name in HEADER_FIRST:
        offset = ENCAPSULATION
    elif type_name in SEQUENCE_OF_HEADERS_FIRST and len(raw) > ENCAPSULATION + SEQUENCE_LENGTH:
        offset = ENCAPSULATION + SEQUENCE_LENGTH
    else:
        return None
    if len(raw) < offset + 8:
        return None
    seconds, nanoseconds = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, offset)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
