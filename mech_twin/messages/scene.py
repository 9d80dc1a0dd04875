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
        If a marker is of a kind no drawing has.
    """
    if not message.markers:
        return Drawing(step, 0.0, ())
    return Drawing(step, stamp_s(message.markers[0].header), tuple(_shape(marker) for marker in message.markers))


def _shape(marker: Marker) -> Shape:
    if marker.type not in KINDS:
        raise MessageError(f"marker type {marker.type} of '{marker.ns}' is not drawn")
    colour = _byte(marker.color.r), _byte(marker.color.g), _byte(marker.color.b)
    kind = KINDS[marker.type]
    places = [marker.pose.position] if kind == "text" else marker.points
    points = tuple((place.x, place.y) for place in places)
    return Shape(marker.ns, kind, points, colour, marker.scale.x, marker.text)


def _byte(share: float) -> int:
    """Return a share of a colour as 0-255."""
    if not 0.0 <= share <= 1.0:
        raise MessageError(f"a marker's colour has a share of {share}; expected 0 to 1")
    return round(share * 255)
