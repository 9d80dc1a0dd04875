# SPDX-License-Identifier: Apache-2.0
r"""Places, Jacobians and accelerations of the bodies of a tree, on numbers or on symbols.

    P = o + R(a) r,    dP = J ds,    P'' = J s'' + (the acceleration that is left with s'' = 0, called bent here)

A scalar of the motion (a coordinate of a joint, a gap, a distance) is a value, its row of the Jacobian, and what is
left of its second derivative with s'' = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from mech_twin.mechanics.code_generation import Number, cosine, is_zero, sine, square_root, total
from mech_twin.mechanics.structure import FREE, GROUND, REVOLUTE, SLIDER, FirmGear, PlanarJoint, Structure, Vector

Row = list[Number]


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """Return the sum of products."""
    return total([x * y for x, y in zip(a, b, strict=True) if not is_zero(x)])


def added(a: Row, b: Row) -> Row:
    """Return the sum of two rows."""
    return [x + y for x, y in zip(a, b, strict=True)]


def scaled(factor: Number, row: Row) -> Row:
    """Return a row times a number."""
    return [factor * x for x in row]


class BodyFrame(NamedTuple):
    """The frame of a body: place, angle with its cosine and sine, and rows of the Jacobian."""

    x: Number
    y: Number
    angle: Number
    cos: Number
    sin: Number
    row_x: Row
    row_y: Row
    row_angle: Row

    def turned(self, v: Vector) -> Vector:
        """Return a vector of this frame in that of the machine."""
        return self.cos * v[0] - self.sin * v[1], self.sin * v[0] + self.cos * v[1]


class MovingPoint(NamedTuple):
    """A point of a body: place, rows, body, and its arm from the origin of the body's frame."""

    x: Number
    y: Number
    row_x: Row
    row_y: Row
    body: int
    arm: Vector


class Scalar(NamedTuple):
    """A number of the motion; ``bent`` returns what is left of its second derivative with s'' = 0."""

    value: Number
    row: Row
    bent: Callable[[JointRates], Number]


class JointRates:
    """Speeds of a tree: those of its coordinates, and the accelerations that are left with s'' = 0."""

    def __init__(self, motion: Kinematics, speeds: Sequence[Number]) -> None:
        self.speeds, self._motion = speeds, motion
        self.omega: list[Number] = [dot(frame.row_angle, speeds) for frame in motion.frames]
        self.origin: list[Vector] = [(0.0, 0.0)] * len(motion.frames)
        for branch in motion.structure.branches:
            joint = motion.structure.joints[branch.joint]
            first, second = motion.frames[joint.first], motion.frames[joint.second]
            on_first = self._moving(joint, first, branch.coordinate)
            w = self.omega[joint.second]
            x, y = second.turned(joint.second_at)
            on_second = (-(w * w * x), -(w * w * y))
            sign = 1.0 if branch.child == joint.second else -1.0
            base = self.origin[branch.parent]
            self.origin[branch.child] = (
                base[0] + sign * (on_first[0] - on_second[0]),
                base[1] + sign * (on_first[1] - on_second[1]),
            )

    def _moving(self, joint: PlanarJoint, frame: BodyFrame, place: int) -> Vector:
        """Return the acceleration of a joint's second point about the first body's origin, seen with s'' = 0."""
        w, (x, y) = self.omega[joint.first], frame.turned(self._motion.arm(joint, place))
        speed: Vector = (0.0, 0.0)
        if joint.kind == SLIDER:
            speed = joint.axis[0] * self.speeds[place], joint.axis[1] * self.speeds[place]
        elif joint.kind == FREE:
            speed = self.speeds[place], self.speeds[place + 1]
        u, v = frame.turned(speed)
        return -(w * w * x) - 2.0 * w * v, -(w * w * y) + 2.0 * w * u

    def point(self, at: MovingPoint) -> Vector:
        """Return the acceleration of a point that is left with s'' = 0."""
        w, (x, y) = self.omega[at.body], self.origin[at.body]
        return x - w * w * at.arm[0], y - w * w * at.arm[1]

    def velocity(self, at: MovingPoint) -> Vector:
        """Return the velocity of a point."""
        return dot(at.row_x, self.speeds), dot(at.row_y, self.speeds)


class Kinematics:
    """The bodies of a structure at coordinates ``s`` of its tree."""

    def __init__(self, structure: Structure, s: Sequence[Number]) -> None:
        self.structure, self.s = structure, s
        none: Row = [0.0] * structure.size
        self.frames = [BodyFrame(0.0, 0.0, 0.0, 1.0, 0.0, none, none, none)] * len(structure.bodies)
        for branch in structure.branches:
            joint = structure.joints[branch.joint]
            place = self._second if branch.child == joint.second else self._first
            self.frames[branch.child] = place(joint, branch.coordinate)

    def arm(self, joint: PlanarJoint, place: int) -> Vector:
        """Return the position of a joint's second point in the frame of its first body."""
        x, y = joint.first_at
        if joint.kind == SLIDER:
            return x + joint.axis[0] * self.s[place], y + joint.axis[1] * self.s[place]
        if joint.kind == FREE:
            return x + self.s[place], y + self.s[place + 1]
        return x, y

    def _angle(
        self, joint: PlanarJoint, base: BodyFrame, place: int, sign: float
    ) -> tuple[Number, Number, Number, Row]:
        """Return the angle of a joint's other body, its cosine and sine, and its row."""
        row = list(base.row_angle)
        if joint.kind in (REVOLUTE, FREE):
            j = place if joint.kind == REVOLUTE else place + 2
            angle = base.angle + sign * self.s[j]
            row[j] = row[j] + sign
            return angle, cosine(angle), sine(angle), row
        by, c, s = joint.turned
        s = sign * s
        return base.angle + sign * by, base.cos * c - base.sin * s, base.sin * c + base.cos * s, row

    def _gliding(self, joint: PlanarJoint, frame: BodyFrame, place: int) -> list[tuple[int, Vector]]:
        """Return the coordinates along which the second point moves in the first body's frame, and how."""
        if joint.kind == SLIDER:
            return [(place, frame.turned(joint.axis))]
        if joint.kind == FREE:
            return [(place, frame.turned((1.0, 0.0))), (place + 1, frame.turned((0.0, 1.0)))]
        return []

    def _second(self, joint: PlanarJoint, place: int) -> BodyFrame:
        base = self.frames[joint.first]
        angle, c, s, row = self._angle(joint, base, place, 1.0)
        x, y = base.turned(self.arm(joint, place))
        made = BodyFrame(0.0, 0.0, angle, c, s, row, row, row)
        u, v = made.turned(joint.second_at)
        row_x = added(added(base.row_x, scaled(-y, base.row_angle)), scaled(v, row))
        row_y = added(added(base.row_y, scaled(x, base.row_angle)), scaled(-u, row))
        for j, (along_x, along_y) in self._gliding(joint, base, place):
            row_x[j], row_y[j] = row_x[j] + along_x, row_y[j] + along_y
        return BodyFrame(base.x + x - u, base.y + y - v, angle, c, s, row_x, row_y, row)

    def _first(self, joint: PlanarJoint, place: int) -> BodyFrame:
        base = self.frames[joint.second]
        angle, c, s, row = self._angle(joint, base, place, -1.0)
        u, v = base.turned(joint.second_at)
        made = BodyFrame(0.0, 0.0, angle, c, s, row, row, row)
        x, y = made.turned(self.arm(joint, place))
        row_x = added(added(base.row_x, scaled(-v, base.row_angle)), scaled(y, row))
        row_y = added(added(base.row_y, scaled(u, base.row_angle)), scaled(-x, row))
        for j, (along_x, along_y) in self._gliding(joint, made, place):
            row_x[j], row_y[j] = row_x[j] - along_x, row_y[j] - along_y
        return BodyFrame(base.x + u - x, base.y + v - y, angle, c, s, row_x, row_y, row)

    def point(self, body: int, at: Vector) -> MovingPoint:
        """Return a point of a body, given in its frame."""
        frame = self.frames[body]
        x, y = frame.turned(at)
        return MovingPoint(
            frame.x + x,
            frame.y + y,
            added(frame.row_x, scaled(-y, frame.row_angle)),
            added(frame.row_y, scaled(x, frame.row_angle)),
            body,
            (x, y),
        )

    def along(self, vector: Vector, start: MovingPoint, end: MovingPoint) -> Scalar:
        """Return the distance from ``start`` to ``end`` along a vector in the frame of the body of ``start``."""
        body = start.body
        frame = self.frames[body]
        x, y = frame.turned(vector)
        dx, dy = end.x - start.x, end.y - start.y
        across = x * dy - y * dx
        row = [
            x * (a - b) + y * (c - d) + across * w
            for a, b, c, d, w in zip(end.row_x, start.row_x, end.row_y, start.row_y, frame.row_angle, strict=True)
        ]

        def bent(rates: JointRates) -> Number:
            w = rates.omega[body]
            (ax, ay), (bx, by) = rates.point(end), rates.point(start)
            (u, v), (p, q) = rates.velocity(end), rates.velocity(start)
            turning = 2.0 * w * (x * (v - q) - y * (u - p))
            return x * (ax - bx) + y * (ay - by) + turning - w * w * (x * dx + y * dy)

        return Scalar(x * dx + y * dy, row, bent)

    def angle(self, first: int, second: int, turned: Number = 0.0) -> Scalar:
        """Return the angle of the second body's frame in the first's, less ``turned``."""
        one, other = self.frames[first], self.frames[second]
        row = [a - b for a, b in zip(other.row_angle, one.row_angle, strict=True)]
        return Scalar(other.angle - one.angle - turned, row, _straight)

    def distance(self, start: MovingPoint, end: MovingPoint) -> Scalar:
        """Return the distance of two points; its second derivative is not told."""
        dx, dy = end.x - start.x, end.y - start.y
        length = square_root(dx * dx + dy * dy)
        x, y = dx / length, dy / length
        row = [
            x * (a - b) + y * (c - d) for a, b, c, d in zip(end.row_x, start.row_x, end.row_y, start.row_y, strict=True)
        ]
        return Scalar(length, row, _unknown)

    def coordinate(self, j: int) -> Scalar:
        """Return a coordinate of the tree."""
        row: Row = [0.0] * self.structure.size
        row[j] = 1.0
        return Scalar(self.s[j], row, _straight)

    def joint_coordinates(self, number: int) -> list[Scalar]:
        """Return the coordinates of a joint, of the tree or of a loop."""
        joint = self.structure.joints[number]
        place = self.structure.first_coordinate.get(number)
        if place is not None:
            count = {REVOLUTE: 1, SLIDER: 1, FREE: 3}.get(joint.kind, 0)
            return [self.coordinate(place + i) for i in range(count)]
        if joint.kind == REVOLUTE:
            return [self.angle(joint.first, joint.second)]
        start, end = self.point(joint.first, joint.first_at), self.point(joint.second, joint.second_at)
        if joint.kind == SLIDER:
            return [self.along(joint.axis, start, end)]
        if joint.kind == FREE:
            axes: tuple[Vector, Vector] = ((1.0, 0.0), (0.0, 1.0))
            return [*(self.along(axis, start, end) for axis in axes), self.angle(joint.first, joint.second)]
        return []

    def closures(self) -> list[Scalar]:
        """Return the closure errors: positions and angle of each loop, then of each gear."""
        found = []
        for number in self.structure.loops:
            joint = self.structure.joints[number]
            start, end = self.point(joint.first, joint.first_at), self.point(joint.second, joint.second_at)
            if joint.kind == SLIDER:
                found.append(self.along((-joint.axis[1], joint.axis[0]), start, end))
            elif joint.kind != FREE:
                found += [self._apart(start, end, 0), self._apart(start, end, 1)]
            if joint.kind not in (REVOLUTE, FREE):
                found.append(self.angle(joint.first, joint.second, joint.turned[0]))
        return found + [self.geared(gear) for gear in self.structure.gears]

    def geared(self, gear: FirmGear) -> Scalar:
        """Return by how much the second joint of a gear is beyond its share of the first."""
        first, second = (self.joint_coordinates(joint)[0] for joint in (gear.first, gear.second))

        def bent(rates: JointRates) -> Number:
            return second.bent(rates) - gear.ratio * first.bent(rates)

        value = second.value - gear.ratio * first.value - gear.offset
        return Scalar(value, [b - gear.ratio * a for a, b in zip(first.row, second.row, strict=True)], bent)

    def _apart(self, start: MovingPoint, end: MovingPoint, axis: int) -> Scalar:
        rows = (start.row_x, end.row_x) if axis == 0 else (start.row_y, end.row_y)

        def bent(rates: JointRates) -> Number:
            return rates.point(end)[axis] - rates.point(start)[axis]

        value = end.x - start.x if axis == 0 else end.y - start.y
        return Scalar(value, [a - b for a, b in zip(rows[1], rows[0], strict=True)], bent)


def _straight(rates: JointRates) -> Number:
    return 0.0


def _unknown(rates: JointRates) -> Number:
    raise NotImplementedError("the second derivative of a distance is not needed by any law")


__all__ = ["GROUND", "BodyFrame", "JointRates", "Kinematics", "MovingPoint", "Row", "Scalar", "added", "dot", "scaled"]
