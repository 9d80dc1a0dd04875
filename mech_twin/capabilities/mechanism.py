# SPDX-License-Identifier: Apache-2.0
r"""A planar mechanism as a tree of frames, for transforms (TF) and for a robot description (URDF).

A closed chain is not a tree: it is opened at one pin, and ``Loop`` gives the two frames that coincide there.  ::

    machine -- crank (turns by the joint `crank`) -- crank_pin (at the crank's end, turned back) -- coupler -- ...

The coordinates of a machine's joints are absolute angles, those of a tree are relative to the parent.  So a chain
continues from a frame at the pin that is rotated back, by ratio -1.  Reactions at a pin are given in the axes of its
frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

ROOT = "machine"
Point = tuple[float, float]
Colour = tuple[int, int, int]


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
    machine's masses; those of one link add up.  ``untold`` are remarks on unknown masses of links.
    """

    joints: tuple[Joint, ...]
    loops: tuple[Loop, ...] = ()
    bars: tuple[Bar, ...] = ()
    lengths: tuple[str, ...] = ()
    inertias: tuple[Inertia, ...] = ()
    untold: tuple[str, ...] = ()

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
    """Return the pose of a joint's child in its parent.

    Parameters
    ----------
    joint : Joint
        The joint.
    positions : mapping
        Positions of the machine's joints by name (rad or m).

    Raises
    ------
    KeyError
        If the position of the joint is not among them.
    """
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
    links : tuple of str
        Crank, coupler and rocker.
    lengths_m : tuple of float
        Their lengths (m).
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
