# SPDX-License-Identifier: Apache-2.0
"""Drawing <-> visualization_msgs/MarkerArray on ``scene``."""

from __future__ import annotations

from copy import copy

from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from mech_twin.messages.step_message import MessageError, set_stamp, stamp_s
from mech_twin.samples import Drawing, Shape

FRAME = "machine"
TYPES = {"line": Marker.LINE_STRIP, "points": Marker.POINTS, "arrow": Marker.ARROW, "text": Marker.TEXT_VIEW_FACING}
KINDS = {value: key for key, value in TYPES.items()}
ARROW_POINTS = 2
FARTHEST_M = 1000.0  # of anything drawn from the machine's origin: the picture would be widened to it for good
MOST_MARKERS = 2000
MOST_POINTS = 100_000  # of all markers together
BLANK = Marker(action=Marker.ADD)


def to_message(drawing: Drawing, frame: str = FRAME) -> MarkerArray:
    """Return a drawing in a frame as markers, one a shape, its name as the marker's namespace."""
    return MarkerArray(markers=[_marker(drawing.time_s, frame, i, shape) for i, shape in enumerate(drawing.shapes)])


def _marker(time_s: float, frame: str, index: int, shape: Shape) -> Marker:
    marker = copy(BLANK)  # to make one takes most of the time of a drawing: textures and meshes come with it
    marker.ns, marker.id, marker.type = shape.name, index, TYPES[shape.kind]
    marker.header = Header(frame_id=frame)
    set_stamp(marker.header, time_s)
    marker.pose = Pose(orientation=Quaternion(w=1.0))  # what others may write to is not shared between markers
    marker.colors, marker.uv_coordinates = [], []
    marker.scale = Vector3(x=shape.width_m, y=shape.width_m, z=shape.width_m)
    red, green, blue = (part / 255.0 for part in shape.colour)
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
    marker.points = [Point(x=x, y=y, z=0.0) for x, y in shape.points_m]
    marker.text = shape.text
    if shape.kind == "text":  # stands at its pose
        (marker.pose.position.x, marker.pose.position.y), marker.points = shape.points_m[0], []
    return marker


def from_message(message: MarkerArray, step: int = 0) -> Drawing:
    """Return the drawing of a marker array; the exact step is not in it.

    Raises
    ------
    MessageError
        If a marker is of a kind no drawing has, if it or its place is no part of a machine's picture, or if there are
        more than a picture has.
    """
    markers = message.markers
    if not markers:
        return Drawing(step, 0.0, ())
    points = sum(len(marker.points) for marker in markers)
    if len(markers) > MOST_MARKERS or points > MOST_POINTS:
        found = f"{len(markers)} markers with {points} points"
        raise MessageError(f"{found}; expected at most {MOST_MARKERS} with {MOST_POINTS}")
    return Drawing(step, stamp_s(markers[0].header), tuple(_shape(marker) for marker in markers))


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
    """Return a coordinate or a width that a picture may have."""
    if not -FARTHEST_M <= value_m <= FARTHEST_M:
        raise MessageError(f"a marker has a place or width of {value_m:g} m; expected at most {FARTHEST_M:g} m")
    return value_m


def _byte(share: float) -> int:
    """Return a share of a colour as 0-255."""
    if not 0.0 <= share <= 1.0:
        raise MessageError(f"a marker's colour has a share of {share}; expected 0 to 1")
    return round(share * 255)
