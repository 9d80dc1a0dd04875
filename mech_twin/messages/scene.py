"""Drawing <-> visualization_msgs/MarkerArray on ``scene``."""

from __future__ import annotations

from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker, MarkerArray

from mech_twin.messages.rows import MessageError, set_stamp, stamp_s
from mech_twin.samples import Drawing, Shape

FRAME = "machine"
TYPES = {"line": Marker.LINE_STRIP, "points": Marker.POINTS, "arrow": Marker.ARROW}
KINDS = {value: key for key, value in TYPES.items()}
ARROW_POINTS = 2


def to_message(drawing: Drawing) -> MarkerArray:
    """Return a drawing as markers, one a shape, its name as the marker's namespace."""
    return MarkerArray(markers=[_marker(drawing.time_s, i, shape) for i, shape in enumerate(drawing.shapes)])


def _marker(time_s: float, index: int, shape: Shape) -> Marker:
    marker = Marker(ns=shape.name, id=index, type=TYPES[shape.kind], action=Marker.ADD)
    set_stamp(marker.header, time_s)
    marker.header.frame_id = FRAME
    marker.pose.orientation.w = 1.0
    marker.scale.x = marker.scale.y = marker.scale.z = shape.width_m
    marker.color.r, marker.color.g, marker.color.b = (part / 255.0 for part in shape.colour)
    marker.color.a = 1.0
    marker.points = [Point(x=x, y=y, z=0.0) for x, y in shape.points_m]
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
    colour = (round(marker.color.r * 255), round(marker.color.g * 255), round(marker.color.b * 255))
    points = tuple((point.x, point.y) for point in marker.points)
    return Shape(marker.ns, KINDS[marker.type], points, colour, marker.scale.x)
