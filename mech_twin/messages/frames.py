# SPDX-License-Identifier: Apache-2.0
"""Frames of a mechanism <-> geometry_msgs/TransformStamped on ``frames``, and on ``/tf`` where tf2_msgs is installed.

Names of frames bear the namespace of the run, so that several runs have one tree each: ``winding_drum/shaft``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3

from mech_twin.capabilities.mechanism import FrameTree, Pose, moved
from mech_twin.messages.step_message import set_stamp


def frame_id(namespace: str, frame: str) -> str:
    """Return the name of a frame among those of all runs.

    Parameters
    ----------
    namespace : str
        Full namespace of the run, with or without the slash it begins with.
    frame : str
        Name of the frame within the machine.
    """
    return f"{namespace.strip('/')}/{frame}"


def transforms(
    mechanism: FrameTree, positions: Mapping[str, float], time_s: float, namespace: str
) -> list[TransformStamped]:
    """Return the pose of each frame in its parent, parents first.

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
        stamped = TransformStamped(child_frame_id=frame_id(namespace, joint.child))
        set_stamp(stamped.header, time_s)
        stamped.header.frame_id = frame_id(namespace, joint.parent)
        stamped.transform = _transform(moved(joint, positions))
        found.append(stamped)
    return found


def _transform(pose: Pose) -> Transform:
    half = 0.5 * math.remainder(pose.angle_rad, 2.0 * math.pi)
    rotation = Quaternion(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
    return Transform(translation=Vector3(x=pose.x_m, y=pose.y_m, z=0.0), rotation=rotation)


def pose(message: TransformStamped) -> Pose:
    """Return the pose a message tells of."""
    at, turn = message.transform.translation, message.transform.rotation
    return Pose(at.x, at.y, 2.0 * math.atan2(turn.z, turn.w))
