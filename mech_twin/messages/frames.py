# SPDX-License-Identifier: Apache-2.0
"""Frames of a mechanism <-> geometry_msgs/TransformStamped on ``frames``, and on ``/tf`` if tf2_msgs is installed.

Frame names start with the namespace of the run, so that each of several runs has its own tree: ``winding_drum/shaft``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache

from geometry_msgs.msg import TransformStamped

from mech_twin.capabilities.mechanism import FrameTree, Pose, moved
from mech_twin.messages.cdr import stamped_bytes

TOOL_FRAME = "tool"


@lru_cache(maxsize=1024)
def frame_id(namespace: str, frame: str) -> str:
    """Return the frame name with the namespace of the run, unique among all runs.

    Parameters
    ----------
    namespace : str
        Full namespace of the run, with or without the leading slash.
    frame : str
        Name of the frame within the machine.
    """
    return f"{namespace.strip('/')}/{frame}"


def transforms(mechanism: FrameTree, positions: Mapping[str, float], time_s: float, namespace: str) -> list[bytes]:
    """Return the pose of each frame in its parent, parents first, as bytes of TransformStamped.

    Parameters
    ----------
    mechanism : FrameTree
        The frames.
    positions : mapping
        Positions of the machine's joints by name (rad or m).
    time_s : float
        Time of the positions (s).
    namespace : str
        Full namespace of the run.

    Raises
    ------
    KeyError
        If a joint's position is missing.
    """
    found = []
    for joint in mechanism.joints:
        parent, child = frame_id(namespace, joint.parent), frame_id(namespace, joint.child)
        found.append(stamped_bytes(time_s, parent, child, numbers=_numbers(moved(joint, positions))))
    return found


def _numbers(pose: Pose) -> tuple[float, ...]:
    half = 0.5 * math.remainder(pose.angle_rad, 2.0 * math.pi)
    return pose.x_m, pose.y_m, 0.0, 0.0, 0.0, math.sin(half), math.cos(half)


def pose(message: TransformStamped) -> Pose:
    """Return the planar pose of a transform message."""
    at, turn = message.transform.translation, message.transform.rotation
    return Pose(at.x, at.y, 2.0 * math.atan2(turn.z, turn.w))
