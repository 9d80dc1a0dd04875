# SPDX-License-Identifier: Apache-2.0
"""A mechanism as text in the Unified Robot Description Format (URDF), for robot_state_publisher, RViz and Foxglove.

Joints have the names of the machine's joints, so that its joint states apply without conversion.  A joint that moves
with another is a mimic joint.  URDF has no closed chains: a comment marks where one was opened.

Masses are those of the machine.  Planar motion depends only on ``izz``; ``ixx`` and ``iyy`` are those of a flat link,
half of it each.  A point mass has a radius of gyration of `POINT_M`, since readers reject an inertia that is not
positive definite.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from mech_twin.capabilities.mechanism import Bar, FrameTree, Inertia, Joint, joined

UNLIMITED = "1e6"  # effort and speed: the description has no limits
PLANAR = "planar: of each inertia izz is known; ixx and iyy are those of a flat link"
SHORTEST_M = 1e-6  # length of the box of a link without extent
POINT_M = 1e-4  # radius of gyration of a point mass


def urdf(name: str, mechanism: FrameTree) -> str:
    """Return the description of a machine.

    Parameters
    ----------
    name : str
        Name of the machine.
    mechanism : FrameTree
        Its frames; each becomes a link.
    """
    robot = Element("robot", name=name)
    for loop in mechanism.loops:
        robot.append(ElementTree.Comment(f" closed chain, opened here: {loop.first} and {loop.second} are one pin "))
    for untold in (PLANAR, *mechanism.untold):
        robot.append(ElementTree.Comment(f" {untold} "))
    for frame in mechanism.frames:
        link = SubElement(robot, "link", name=frame)
        masses = [one for one in mechanism.inertias if one.link == frame and one.mass_kg > 0.0]
        if masses:
            _add_inertial(link, joined(masses))
        for bar in mechanism.bars:
            if bar.link == frame:
                _add_visual(link, bar)
    movers: set[str] = set()
    for joint in mechanism.joints:
        _add_joint(robot, joint, first=joint.name not in movers)
        movers.add(joint.name)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode") + "\n"


def _add_joint(robot: Element, joint: Joint, *, first: bool) -> None:
    moves = joint.kind != "fixed"
    # the first one of a machine's joint has its name; a ratio of -1 reverses its axis
    own_name = joint.name if moves and first else f"{joint.child}_joint"
    element = SubElement(robot, "joint", name=own_name, type=joint.kind)
    x, y = joint.origin_m
    SubElement(element, "origin", xyz=_row(x, y, 0.0), rpy=_row(0.0, 0.0, joint.turned_rad))
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    if not moves:
        return
    sign = joint.ratio if first else 1.0
    axis = (0.0, 0.0, sign) if joint.kind == "continuous" else (sign * joint.axis[0], sign * joint.axis[1], 0.0)
    SubElement(element, "axis", xyz=_row(*axis))
    if joint.kind == "prismatic":
        limit = {"effort": UNLIMITED, "velocity": UNLIMITED}
        SubElement(element, "limit", limit | {"lower": repr(-joint.travel_m), "upper": repr(joint.travel_m)})
    if not first:
        SubElement(element, "mimic", joint=joint.name, multiplier=repr(joint.ratio))


def _add_inertial(link: Element, inertia: Inertia) -> None:
    inertial, about = SubElement(link, "inertial"), inertia.about_centre_kg_m2
    if about == 0.0:
        inertial.append(ElementTree.Comment(f" a point of the machine, here with a radius of gyration of {POINT_M} m "))
        about = inertia.mass_kg * POINT_M**2
    SubElement(inertial, "origin", xyz=_row(*inertia.centre_m, 0.0), rpy=_row(0.0, 0.0, 0.0))
    SubElement(inertial, "mass", value=repr(float(inertia.mass_kg)))
    flat = {"ixx": 0.5 * about, "ixy": 0.0, "ixz": 0.0, "iyy": 0.5 * about, "iyz": 0.0, "izz": about}
    SubElement(inertial, "inertia", {name: repr(float(value)) for name, value in flat.items()})


def _add_visual(link: Element, bar: Bar) -> None:
    (x0, y0), (x1, y1) = bar.start_m, bar.end_m
    length = max(math.hypot(x1 - x0, y1 - y0), SHORTEST_M)
    visual = SubElement(link, "visual")
    middle = _row(0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0)
    SubElement(visual, "origin", xyz=middle, rpy=_row(0.0, 0.0, math.atan2(y1 - y0, x1 - x0)))
    SubElement(SubElement(visual, "geometry"), "box", size=_row(length, bar.width_m, bar.width_m))
    red, green, blue = (round(part / 255.0, 3) for part in bar.colour)
    material = SubElement(visual, "material", name="_".join(str(part) for part in bar.colour))
    SubElement(material, "color", rgba=f"{red} {green} {blue} 1")


def _row(*numbers: float) -> str:
    return " ".join(repr(number + 0.0) for number in numbers)
