# SPDX-License-Identifier: Apache-2.0
r"""A planar mechanism as a tree of frames: for frames in space (TF) and for a description (URDF).

A closed chain has no tree: it is opened at one pin, and ``Loop`` says which two frames coincide there.  ::

    machine -- crank (turns by the joint `crank`) -- crank_pin (at the crank's end, turned back) -- coupler -- ...

The coordinates of a machine's joints are absolute angles, those of a tree are relative to the parent.  So a chain goes
on from a frame at the pin that is turned back, by ratio -1.  A pin's frame has the axes its reaction is given in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

ROOT = "machine"
Point = tuple[float, float]
Colour = tuple[int, int, int]


class Joint(NamedTuple):
    """One frame below another.

    Attributes
    ----------
    kind : str
        ``continuous`` (turns about z), ``prismatic`` (slides along ``axis``) or ``fixed``.
    parent, child : str
        The two frames, which are also links of the description.
    origin_m : (x, y)
        Where the child lies in the parent's frame (m).
    turned_rad : float
        How far the child is turned against the parent at coordinate 0 (rad).
    name : str
        The machine's joint whose position is the coordinate; empty where fixed.
    ratio : float
        Factor of the position; other than 1 it is a mimic joint of the description.
    axis : (x, y)
        Direction of sliding, a unit vector in the child's frame at coordinate 0.
    travel_m : float
        Greatest distance of sliding either way, for the description (m).
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
    """Two frames whose origins coincide: where the closed chain was opened."""

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
    """Return the mass of a link whose inertia is told about the origin of its frame."""
    own = about_origin_kg_m2 - mass_kg * (centre_m[0] ** 2 + centre_m[1] ** 2)
    return Inertia(link, mass_kg, centre_m, max(own, 0.0))


def joined(inertias: Sequence[Inertia]) -> Inertia:
    """Return masses of one link as one, about their common centre."""
    mass = sum(one.mass_kg for one in inertias)
    x = sum(one.mass_kg * one.centre_m[0] for one in inertias) / mass
    y = sum(one.mass_kg * one.centre_m[1] for one in inertias) / mass
    about = sum(
        one.about_centre_kg_m2 + one.mass_kg * ((one.centre_m[0] - x) ** 2 + (one.centre_m[1] - y) ** 2)
        for one in inertias
    )
    return Inertia(inertias[0].link, mass, (x, y), about)


class Pose(NamedTuple):
    """Place (m) and orientation (rad) of a frame in another."""

    x_m: float
    y_m: float
    angle_rad: float


class FrameTree(NamedTuple):
    """The tree, parents before children; where it was opened; what its links look like.

    ``lengths`` names the joints of linkage and motor whose positions are lengths (m) though they carry no frame.
    ``inertias`` are the machine's masses, several of a link add up; ``untold`` says of links what it does not know.
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
    """Return a frame that does not move in its parent."""
    return Joint("fixed", parent, child, origin_m, turned_rad)


def turning(
    name: str, parent: str, child: str, origin_m: Point = (0.0, 0.0), ratio: float = 1.0, turned_rad: float = 0.0
) -> Joint:
    """Return a frame that turns with a joint of the machine; ratio -1 turns it back, or clockwise."""
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
    """Return a pose that is given in a frame, in the frame that frame is given in."""
    c, s = math.cos(outer.angle_rad), math.sin(outer.angle_rad)
    x = outer.x_m + c * inner.x_m - s * inner.y_m
    return Pose(x, outer.y_m + s * inner.x_m + c * inner.y_m, outer.angle_rad + inner.angle_rad)


def poses(mechanism: FrameTree, positions: Mapping[str, float]) -> dict[str, Pose]:
    """Return the pose of every frame in the root's; see `moved`."""
    found = {ROOT: Pose(0.0, 0.0, 0.0)}
    for joint in mechanism.joints:
        found[joint.child] = composed(found[joint.parent], moved(joint, positions))
    return found


def four_bar_chain(
    links: tuple[str, str, str], lengths_m: tuple[float, float, float], pivot_m: Point, base: str = ROOT
) -> tuple[tuple[Joint, ...], Loop]:
    """Return crank, coupler and rocker on a base, opened at the pin of coupler and rocker.

    ``links`` are also the names of the joints; the frames at the pins that are turned back to the base's axes are
    called ``crank_bearing``, ``crank_pin``, ``rocker_pin`` and ``rocker_bearing`` on the root, else ``..._axes``.

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
