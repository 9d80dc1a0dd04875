# SPDX-License-Identifier: Apache-2.0
"""A planar mechanism as a tree of frames, for transforms (TF) and for a robot description (URDF).

A closed chain is not a tree: it is opened at one pin, and ``Loop`` gives the two frames that coincide there.  ::

    machine -- crank (turns by the joint `crank`) -- crank_pin (at the crank's end, turned back) -- coupler -- ...

The coordinates of a machine's joints are absolute angles, those of a tree are relative to the parent.  So a chain
continues from a frame at the pin that is rotated back, by ratio -1.  Reactions at a pin are given in the axes of its
frame.

The Unified Robot Description Format (URDF) is read by robot_state_publisher, RViz and Foxglove.  Joints have the names
of the machine's joints, so that its joint states apply without conversion.  A joint that moves with another is a mimic
joint.  URDF has no closed chains: a comment marks where one was opened.

Masses are those of the machine.  Planar motion depends only on ``izz``; ``ixx`` and ``iyy`` are those of a flat link,
half of it each.  A point mass has a radius of gyration of `POINT_M`, since readers reject an inertia that is not
positive definite.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from mech_twin.capabilities.figure import Colour, Point

ROOT = "machine"
UNLIMITED = "1e6"  # effort and speed: the description has no limits
PLANAR = "planar: of each inertia izz is known; ixx and iyy are those of a flat link"
SHORTEST_M = 1e-6  # length of the box of a link without extent
POINT_M = 1e-4  # radius of gyration of a point mass


class Joint(NamedTuple):
    """A joint of the tree: motion of a child frame in its parent.

    Attributes
    ----------
    kind : str
        ``continuous`` (turns about z), ``prismatic`` (slides along ``axis``) or ``fixed``.
    parent, child : str
        The two frames, which are also links of the description.
    origin_m : (x, y)
        Position of the child in the parent's frame (m).
    turned_rad : float
        Rotation of the child relative to the parent at coordinate 0 (rad).
    name : str
        The machine's joint whose position is the coordinate; empty if fixed.
    ratio : float
        Factor of the position.
    axis : (x, y)
        Direction of sliding, a unit vector in the child's frame at coordinate 0.
    travel_m : float
        Largest travel in either direction, for the robot description (m).
    """

    kind: str
    parent: str
    child: str
    origin_m: Point = (0.0, 0.0)
    turned_rad: float = 0.0
    name: str = ""
    ratio: float = 1.0
    axis: Point = (1.0, 0.0)
    travel_m: float = 0.0


class Loop(NamedTuple):
    """Two frames whose origins coincide, where a closed chain was opened."""

    first: str
    second: str


class Bar(NamedTuple):
    """A straight part of a link, from ``start_m`` to ``end_m`` in the link's frame (m), of a width (m)."""

    link: str
    start_m: Point
    end_m: Point
    width_m: float
    colour: Colour


class Inertia(NamedTuple):
    """A mass (kg) of a link, its centre in the link's frame (m), and inertia about that centre (kg m2; 0: a point)."""

    link: str
    mass_kg: float
    centre_m: Point = (0.0, 0.0)
    about_centre_kg_m2: float = 0.0


def inertia_about_origin(link: str, mass_kg: float, centre_m: Point, about_origin_kg_m2: float) -> Inertia:
    """Return the inertia of a link from its moment of inertia about the origin of its frame."""
    own = about_origin_kg_m2 - mass_kg * (centre_m[0] ** 2 + centre_m[1] ** 2)
    return Inertia(link, mass_kg, centre_m, max(own, 0.0))


def joined(inertias: Sequence[Inertia]) -> Inertia:
    """Return several masses of one link as one, about their common centre of mass."""
    mass = sum(one.mass_kg for one in inertias)
    x = sum(one.mass_kg * one.centre_m[0] for one in inertias) / mass
    y = sum(one.mass_kg * one.centre_m[1] for one in inertias) / mass
    about = sum(
        one.about_centre_kg_m2 + one.mass_kg * ((one.centre_m[0] - x) ** 2 + (one.centre_m[1] - y) ** 2)
        for one in inertias
    )
    return Inertia(inertias[0].link, mass, (x, y), about)


class Pose(NamedTuple):
    """Position (m) and orientation (rad) of a frame in another."""

    x_m: float
    y_m: float
    angle_rad: float


class FrameTree(NamedTuple):
    """The tree, parents before children; its opened loops; shapes and masses of its links.

    ``lengths`` are joints of linkage and motor without a frame whose positions are lengths (m).  ``inertias`` are the
    machine's masses; those of one link add up.  ``mass_remarks`` are about unknown masses of links.  ``leading`` is the
    joint that the drive leads; empty for the first of the linkage.  ``turning_stops``: their gap is an angle.
    """

    joints: tuple[Joint, ...]
    loops: tuple[Loop, ...] = ()
    bars: tuple[Bar, ...] = ()
    lengths: tuple[str, ...] = ()
    inertias: tuple[Inertia, ...] = ()
    mass_remarks: tuple[str, ...] = ()
    leading: str = ""
    turning_stops: frozenset[str] = frozenset()

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all frames, the root first."""
        return (ROOT, *(joint.child for joint in self.joints))

    @property
    def sliding_joints(self) -> frozenset[str]:
        """Joints whose positions are lengths (m)."""
        return frozenset((*self.lengths, *(joint.name for joint in self.joints if joint.kind == "prismatic")))


def fixed(parent: str, child: str, origin_m: Point = (0.0, 0.0), turned_rad: float = 0.0) -> Joint:
    """Return a frame that is fixed in its parent."""
    return Joint("fixed", parent, child, origin_m, turned_rad)


def turning(
    name: str, parent: str, child: str, origin_m: Point = (0.0, 0.0), ratio: float = 1.0, turned_rad: float = 0.0
) -> Joint:
    """Return a frame that turns with a joint of the machine; ratio -1 for rotation back, or clockwise."""
    return Joint("continuous", parent, child, origin_m, turned_rad, name, ratio)


def sliding(name: str, parent: str, child: str, axis: Point, travel_m: float, origin_m: Point = (0.0, 0.0)) -> Joint:
    """Return a frame that slides with a joint of the machine."""
    return Joint("prismatic", parent, child, origin_m, 0.0, name, 1.0, axis, travel_m)


def moved(joint: Joint, positions: Mapping[str, float]) -> Pose:
    """Return the pose of a joint's child in its parent, at positions of the machine's joints by name (rad or m)."""
    x, y = joint.origin_m
    if joint.kind == "fixed":
        return Pose(x, y, joint.turned_rad)
    value = joint.ratio * positions[joint.name]
    if joint.kind == "continuous":
        return Pose(x, y, joint.turned_rad + value)
    c, s = math.cos(joint.turned_rad), math.sin(joint.turned_rad)
    u, v = value * joint.axis[0], value * joint.axis[1]
    return Pose(x + c * u - s * v, y + s * u + c * v, joint.turned_rad)


def composed(outer: Pose, inner: Pose) -> Pose:
    """Return the composition of two poses: inner, given in the frame with pose outer."""
    c, s = math.cos(outer.angle_rad), math.sin(outer.angle_rad)
    x = outer.x_m + c * inner.x_m - s * inner.y_m
    return Pose(x, outer.y_m + s * inner.x_m + c * inner.y_m, outer.angle_rad + inner.angle_rad)


def poses(mechanism: FrameTree, positions: Mapping[str, float]) -> dict[str, Pose]:
    """Return the pose of every frame in the root frame; see `moved`."""
    found = {ROOT: Pose(0.0, 0.0, 0.0)}
    for joint in mechanism.joints:
        found[joint.child] = composed(found[joint.parent], moved(joint, positions))
    return found


def four_bar_chain(
    links: tuple[str, str, str], lengths_m: tuple[float, float, float], pivot_m: Point, base: str = ROOT
) -> tuple[tuple[Joint, ...], Loop]:
    """Return crank, coupler and rocker on a base as a tree, opened at the pin of coupler and rocker.

    ``links`` are also the names of the joints.  The frames at the pins have the base's axes; they are named
    ``crank_bearing``, ``crank_pin``, ``rocker_pin`` and ``rocker_bearing`` on the root, else ``..._axes``.

    Parameters
    ----------
    pivot_m : (x, y)
        Bearing of the rocker in the base's frame (m).
    """
    (crank, coupler, rocker), (crank_m, coupler_m, rocker_m) = links, lengths_m
    tail = "" if base == ROOT else "_axes"
    joints = (
        fixed(base, f"crank_bearing{tail}"),
        turning(crank, f"crank_bearing{tail}", crank),
        turning(crank, crank, f"crank_pin{tail}", (crank_m, 0.0), ratio=-1.0),
        turning(coupler, f"crank_pin{tail}", coupler),
        fixed(coupler, f"{coupler}_end", (coupler_m, 0.0)),
        fixed(base, f"rocker_bearing{tail}", pivot_m),
        turning(rocker, f"rocker_bearing{tail}", rocker),
        turning(rocker, rocker, f"rocker_pin{tail}", (rocker_m, 0.0), ratio=-1.0),
    )
    return joints, Loop(f"{coupler}_end", f"rocker_pin{tail}")


def four_bar_masses(names: tuple[str, str, str], links: Iterable[Any]) -> tuple[Inertia, ...]:
    """Return the masses of crank, coupler and rocker: links of `parts.four_bar`, the crank's inertia about its pin."""
    crank, coupler, rocker = ((link.mass_kg, (link.along_m, link.across_m), link.inertia_kg_m2) for link in links)
    return inertia_about_origin(names[0], *crank), Inertia(names[1], *coupler), Inertia(names[2], *rocker)


def urdf(name: str, mechanism: FrameTree) -> str:
    """Return the description of a machine, a link for each frame."""
    robot = Element("robot", name=name)
    for loop in mechanism.loops:
        robot.append(ElementTree.Comment(f" closed chain, opened here: {loop.first} and {loop.second} are one pin "))
    for remark in (PLANAR, *mechanism.mass_remarks):
        robot.append(ElementTree.Comment(f" {remark} "))
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
