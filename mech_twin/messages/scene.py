# SPDX-License-Identifier: Apache-2.0
"""Drawing <-> visualization_msgs/MarkerArray on ``scene``, one marker per shape.

It is written directly as CDR bytes: the middleware's converter handles a marker attribute by attribute, including the
empty mesh and texture.  ::

      (gap) | sec, nanosec | frame, name | number, type, action | gap | pose, scale, colour, ... | points | empty, text
      4-byte aligned                                              8-byte aligned, from the head's end

Frames of a mechanism are geometry_msgs/TransformStamped on ``frames``, and on ``/tf`` if tf2_msgs is installed.
Their names start with the namespace of the run, so that each of several runs has its own tree: ``winding_drum/shaft``.
"""

import math
import struct
from collections.abc import Mapping
from functools import lru_cache
from itertools import chain

from geometry_msgs.msg import TransformStamped
from visualization_msgs.msg import Marker, MarkerArray

from mech_twin.capabilities.mechanism import FrameTree, Pose, moved
from mech_twin.messages.cdr import HEAD, STAMP, stamp_of, stamped_bytes, words
from mech_twin.messages.step_message import MessageError, stamp_s
from mech_twin.samples import Drawing, Shape

TOOL_FRAME = "tool"
FRAME = "machine"
TYPES = {"line": Marker.LINE_STRIP, "points": Marker.POINTS, "arrow": Marker.ARROW, "text": Marker.TEXT_VIEW_FACING}
KINDS = {value: key for key, value in TYPES.items()}
ARROW_POINTS = 2
FARTHEST_M = 1000.0  # largest distance from the machine's origin: the view would stay zoomed out
MOST_MARKERS = 2000
MOST_POINTS = 100_000  # in all markers together
COUNT = struct.Struct("<I")
NUMBERS = struct.Struct("<3i")
POSE_TO_POINTS = struct.Struct("<7d3d4f12xI")  # pose, scale, colour, lifetime, frame_locked, number of points
ALIGNMENT = 8


NOTHING = words("")
BEFORE_TEXT = bytes(4) + NOTHING + bytes(STAMP.size) + NOTHING + NOTHING + bytes(8)  # colours, texture
AFTER_TEXT = NOTHING + NOTHING + bytes(5)  # mesh


@lru_cache(maxsize=1024)
def frame_id(namespace: str, frame: str) -> str:
    """Return the frame name with the namespace of the run, unique among all runs; tf2 takes none with a leading slash.

    Parameters
    ----------
    namespace : str
        Full namespace of the run, with or without the leading slash.
    frame : str
        Name of the frame within the machine.
    """
    return f"{namespace.strip('/')}/{frame}".lstrip("/")


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


def to_bytes(drawing: Drawing, frame: str = FRAME) -> bytes:
    """Return a drawing in a frame as CDR of markers, in the namespaces of its shapes' names; padding is 0."""
    stamp = STAMP.pack(*stamp_of(drawing.time_s))
    parts = [COUNT.pack(len(drawing.shapes))]
    end = COUNT.size  # counted from the end of the head
    for index, shape in enumerate(drawing.shapes):
        gap, opening = _opening(end % ALIGNMENT, frame, shape.name, index, shape.kind)
        marker = b"".join((gap, stamp, opening, _body(shape), BEFORE_TEXT, words(shape.text), AFTER_TEXT))
        parts.append(marker)
        end += len(marker)
    return HEAD + b"".join(parts)


@lru_cache(maxsize=4096)
def _opening(begin: int, frame: str, name: str, index: int, kind: str) -> tuple[bytes, bytes]:
    """Return the bytes of a marker before its stamp, and from stamp to pose; ``begin`` is its offset modulo 8."""
    gap = bytes(-begin % 4)
    named = words(frame, name) + NUMBERS.pack(index, TYPES[kind], Marker.ADD)
    return gap, named + bytes(-(begin + len(gap) + STAMP.size + len(named)) % ALIGNMENT)


def _body(shape: Shape) -> bytes:
    x, y, points = 0.0, 0.0, shape.points_m
    if shape.kind == "text":  # placed by its pose
        (x, y), points = points[0], ()
    red, green, blue = (part / 255.0 for part in shape.colour)
    width = shape.width_m
    numbers = (x, y, 0.0, 0.0, 0.0, 0.0, 1.0, width, width, width, red, green, blue, 1.0, len(points))
    places = chain.from_iterable((x, y, 0.0) for x, y in points)
    return POSE_TO_POINTS.pack(*numbers) + struct.pack(f"<{3 * len(points)}d", *places)


def from_message(message: MarkerArray) -> Drawing:
    """Return the drawing of a marker array, which does not contain the step: its is 0.

    Raises
    ------
    MessageError
        If a marker has an unknown type, or values out of range, or if there are too many markers or points.
    """
    markers = message.markers
    if not markers:
        return Drawing(0, 0.0, ())
    points = sum(len(marker.points) for marker in markers)
    if len(markers) > MOST_MARKERS or points > MOST_POINTS:
        found = f"{len(markers)} markers with {points} points"
        raise MessageError(f"{found}; expected at most {MOST_MARKERS} with {MOST_POINTS}")
    return Drawing(0, stamp_s(markers[0].header), tuple(_shape(marker) for marker in markers))


def _shape(marker: Marker) -> Shape:
    if marker.type not in KINDS:
        raise MessageError(f"marker type {marker.type} of '{marker.ns}' is not drawn")
    colour = _byte(marker.color.r), _byte(marker.color.g), _byte(marker.color.b)
    kind = KINDS[marker.type]
    places = [marker.pose.position] if kind == "text" else marker.points
    if kind == "arrow" and len(places) != ARROW_POINTS:
        raise MessageError(f"arrow '{marker.ns}' has {len(places)} points; expected {ARROW_POINTS}")
    points = tuple((_place(place.x), _place(place.y)) for place in places)
    return Shape(marker.ns, kind, points, colour, _place(marker.scale.x), marker.text)


def _place(value_m: float) -> float:
    """Return a coordinate or width (m) if within `FARTHEST_M`."""
    if not -FARTHEST_M <= value_m <= FARTHEST_M:
        raise MessageError(f"a marker has a place or width of {value_m:g} m; expected at most {FARTHEST_M:g} m")
    return value_m


def _byte(share: float) -> int:
    """Return a colour component 0 to 1 as 0 to 255."""
    if not 0.0 <= share <= 1.0:
        raise MessageError(f"a marker's colour has a share of {share}; expected 0 to 1")
    return round(share * 255)
