# SPDX-License-Identifier: Apache-2.0
"""What acts on a structure: along joints, between points, on a body; as efforts of the motion and loads on bodies."""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.mechanics.dynamics import AppliedLoad, JointEffort, ReducedSystem
from mech_twin.mechanics.kinematics import JointRates, MovingPoint, Scalar
from mech_twin.mechanics.recording import Number
from mech_twin.mechanics.structure import GROUND, REVOLUTE, SLIDER, Vector


class Action(NamedTuple):
    """One action: along scalars of the motion, for its equations; on the bodies, for the forces in the joints."""

    efforts: list[JointEffort]
    loads: list[AppliedLoad]


def joint_action(at: ReducedSystem, number: int, size: Number, part: int = 0) -> Action:
    """Return a force or moment of a joint, on its second body and back on its first, along one of its coordinates."""
    joint, structure = at.structure.joints[number], at.structure
    scalar = at.motion.joint_coordinates(number)[part]
    efforts = [JointEffort(scalar, size)]
    if joint.kind == REVOLUTE or part == 2:
        return Action(efforts, _both(joint.first, joint.second, (0.0, 0.0), (0.0, 0.0), size))
    axis = joint.axis if joint.kind == SLIDER else ((1.0, 0.0), (0.0, 1.0))[part]
    x, y = at.motion.frames[joint.first].turned(axis)
    end = at.motion.point(joint.second, structure.joints[number].second_at)
    return Action(efforts, _both(joint.first, joint.second, (end.x, end.y), (size * x, size * y), 0.0))


def line_action(at: ReducedSystem, start: MovingPoint, end: MovingPoint, size: Number) -> Action:
    """Return a force between two points, positive where it drives them apart."""
    distance = at.motion.distance(start, end)
    x, y = (end.x - start.x) / distance.value, (end.y - start.y) / distance.value
    loads = _both(start.body, end.body, (end.x, end.y), (size * x, size * y), 0.0)
    return Action([JointEffort(distance, size)], loads)


def force_action(point: MovingPoint, force: Vector) -> Action:
    """Return a force on a point, in the axes of the machine."""
    efforts = [JointEffort(place(point, axis), force[axis]) for axis in (0, 1)]
    return Action(efforts, [AppliedLoad(point.body, point.x, point.y, force[0], force[1], 0.0)])


def moment_action(at: ReducedSystem, body: int, size: Number) -> Action:
    """Return a moment on a body."""
    return Action([JointEffort(at.motion.angle(GROUND, body), size)], [AppliedLoad(body, 0.0, 0.0, 0.0, 0.0, size)])


def contact_action(at: ReducedSystem, line: MovingPoint, point: MovingPoint, normal: Vector, size: Number) -> Action:
    """Return a force on a point along the normal of a line through another, and back on the body of the line."""
    x, y = at.motion.frames[line.body].turned(normal)
    efforts = [JointEffort(at.motion.along(normal, line, point), size)]
    return Action(efforts, _both(line.body, point.body, (point.x, point.y), (size * x, size * y), 0.0))


def place(point: MovingPoint, axis: int) -> Scalar:
    """Return a coordinate of a point as a scalar of the motion."""

    def bent(rates: JointRates) -> Number:
        return rates.point(point)[axis]

    return Scalar((point.x, point.y)[axis], (point.row_x, point.row_y)[axis], bent)


def _both(first: int, second: int, spot: Vector, force: Vector, moment: Number) -> list[AppliedLoad]:
    return [
        AppliedLoad(second, spot[0], spot[1], force[0], force[1], moment),
        AppliedLoad(first, spot[0], spot[1], -force[0], -force[1], -moment),
    ]
