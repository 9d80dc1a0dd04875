# SPDX-License-Identifier: Apache-2.0
"""Bodies and the joints between them: which joints make the tree, which close loops, and where each coordinate stands.

A joint is between a point of its first body and one of its second::

    revolute    the points coincide; coordinate: angle of the second body's frame in the first's
    slider      the second's point lies on a line through the first's; coordinate: travel along it.  The angle is fixed
    weld        the points coincide, and the angle is fixed
    free        coordinates: place of the second's point from the first's, in the first's frame, and the angle
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from mech_twin.mechanics.code_generation import Number

REVOLUTE, SLIDER, WELD, FREE = "revolute", "slider", "weld", "free"
COORDINATES = {REVOLUTE: 1, SLIDER: 1, WELD: 0, FREE: 3}
GROUND = 0  # the body that does not move
Vector = tuple[Number, Number]
NOWHERE: Vector = (0.0, 0.0)


class StructureError(ValueError):
    """A structure that is none: the message names body or joint."""


class RigidBody(NamedTuple):
    """A rigid body: mass (kg), inertia about its centre (kg m2), centre in its own frame (m)."""

    name: str
    mass: Number = 0.0
    inertia: Number = 0.0
    centre: Vector = NOWHERE


class PlanarJoint(NamedTuple):
    """A joint between two bodies, by their places in the list.

    Attributes
    ----------
    first_at, second_at : (x, y)
        The points, each in the frame of its body (m).
    axis : (x, y)
        Direction of a slider in the first body's frame, a unit vector.
    turned : (angle, cos, sin)
        Angle of the second body's frame in the first's, of slider and weld (rad).
    """

    name: str
    kind: str
    first: int
    second: int
    first_at: Vector = NOWHERE
    second_at: Vector = NOWHERE
    axis: Vector = (1.0, 0.0)
    turned: tuple[Number, Number, Number] = (0.0, 1.0, 0.0)


class FirmGear(NamedTuple):
    """A firm ratio between the coordinates of two joints: that of the second is ``ratio * first + offset``."""

    first: int
    second: int
    ratio: Number
    offset: Number = 0.0


class Branch(NamedTuple):
    """A joint of the tree: from the body that is placed already to the one it places; its first coordinate."""

    joint: int
    parent: int
    child: int
    coordinate: int


@dataclass(frozen=True)
class Structure:
    """Bodies, the ground being the first, and joints.

    Attributes
    ----------
    preferred : sequence of int
        Joints that are to be of the tree before others, as those that are driven.
    gears : sequence of FirmGear
        Revolutes and sliders that move by a firm ratio; each gear closes as a loop does.
    """

    bodies: Sequence[RigidBody]
    joints: Sequence[PlanarJoint]
    preferred: Sequence[int] = ()
    gears: Sequence[FirmGear] = ()

    @cached_property
    def branches(self) -> tuple[Branch, ...]:
        """The joints of the tree, parents before children; the others close loops.

        Raises
        ------
        StructureError
            A body that nothing joins to the ground.
        """
        chosen = self._chosen()
        placed, found, count = {GROUND}, [], 0
        while True:
            step = next((j for j in chosen if len({self.joints[j].first, self.joints[j].second} & placed) == 1), None)
            if step is None:
                break
            joint = self.joints[step]
            parent, child = (joint.first, joint.second) if joint.first in placed else (joint.second, joint.first)
            found.append(Branch(step, parent, child, count))
            count += COORDINATES[joint.kind]
            placed.add(child)
            chosen.remove(step)
        lost = [body.name for i, body in enumerate(self.bodies) if i not in placed]
        if lost:
            raise StructureError(f"nothing joins {', '.join(lost)} to the ground; a body that flies has a joint 'free'")
        return tuple(found)

    def _chosen(self) -> list[int]:
        """Return the joints of the tree in no order: welds, then preferred ones, those on the ground, the others."""
        group = list(range(len(self.bodies)))

        def root(body: int) -> int:
            while group[body] != body:
                body = group[body]
            return body

        def rank(j: int) -> tuple[bool, bool, bool, bool]:
            joint = self.joints[j]
            return (
                joint.kind != WELD, j not in self.preferred, GROUND not in (joint.first, joint.second),
                joint.kind == FREE,
            )  # fmt: skip

        chosen = []
        for j in sorted(range(len(self.joints)), key=rank):
            one, other = root(self.joints[j].first), root(self.joints[j].second)
            if one != other:
                group[other] = one
                chosen.append(j)
        return chosen

    @cached_property
    def loops(self) -> tuple[int, ...]:
        """The joints that close a loop."""
        of_tree = {branch.joint for branch in self.branches}
        return tuple(j for j in range(len(self.joints)) if j not in of_tree)

    @cached_property
    def first_coordinate(self) -> dict[int, int]:
        """The first coordinate of each joint of the tree."""
        return {branch.joint: branch.coordinate for branch in self.branches}

    @property
    def size(self) -> int:
        """How many coordinates the tree has."""
        return sum(COORDINATES[self.joints[branch.joint].kind] for branch in self.branches)

    @property
    def closures(self) -> int:
        """How many equations close the loops and the gears."""
        return sum(3 - COORDINATES[self.joints[j].kind] for j in self.loops) + len(self.gears)


@dataclass(frozen=True)
class Split:
    """Which coordinates of the tree are free, which follow a drive, and which depend on these by the closures."""

    free: tuple[int, ...]
    driven: tuple[int, ...]
    dependent: tuple[int, ...]

    @property
    def led(self) -> tuple[int, ...]:
        """Free and driven coordinates: what the dependent ones follow."""
        return (*self.free, *self.driven)


def split_of(
    size: int, closures: int, driven: Sequence[int], order: Sequence[int], regular: Callable[[tuple[int, ...]], bool]
) -> Split:
    """Return a split of the coordinates.

    Parameters
    ----------
    driven : sequence of int
        Coordinates that a drive leads.
    order : sequence of int
        All coordinates, those first that are to be free.
    regular : callable
        Tells whether the closures determine these coordinates.

    Raises
    ------
    StructureError
        The drives and loops leave no such choice.
    """
    kept = list(driven)
    for j in order:
        if len(kept) == size - closures:
            break
        rest = tuple(i for i in range(size) if i not in kept and i != j)
        if j not in kept and regular(rest):
            kept.append(j)
    dependent = tuple(i for i in range(size) if i not in kept)
    if len(kept) != size - closures or not regular(dependent):
        raise StructureError("the loops do not determine the joints that neither a drive nor a freedom moves")
    return Split(tuple(i for i in kept if i not in driven), tuple(driven), dependent)
