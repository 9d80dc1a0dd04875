# SPDX-License-Identifier: Apache-2.0
r"""Equations of motion of a structure with loops, reduced to its free coordinates, and the forces in its joints.

Coordinates of the tree: free q, driven r(t), dependent z, with closures Phi(q, r, z) = 0::

    Phi_z Z = -(Phi_q, Phi_r),   z' = Z (q', r'),   Phi_z zeta = -(Phi'' with s'' = 0),   z'' = Z (q'', r'') + zeta
    M q'' = h + sum w_i lam_i,   M = sum B' m B,   h = sum B' (F - m b),   B = J_q + J_z Z

where b is the acceleration with q'' = 0

No derivative of M is needed.
A force in a joint follows from the bodies outside of it, tips inward.
That of a loop: Phi_z' mu = (what the dependent coordinates lack).

Source: P. E. Nikravesh, Planar Multibody Dynamics, 2nd ed., CRC Press 2018, chapters 5, 9 and 12.

What acts on a structure, along joints, between points or on a body, becomes efforts of the motion and loads on bodies.
"""

from collections.abc import Sequence
from typing import NamedTuple

from mech_twin.mechanics.code_generation import Number, is_zero, magnitude, square_root, total
from mech_twin.mechanics.kinematics import JointRates, Kinematics, MovingPoint, Row, Scalar, dot
from mech_twin.mechanics.linear_solve import solution, transposed
from mech_twin.mechanics.structure import COORDINATES, FREE, GROUND, REVOLUTE, SLIDER, WELD, Split, Structure, Vector


class JointEffort(NamedTuple):
    """A force along a scalar of the motion: positive where it makes the scalar grow."""

    along: Scalar
    size: Number


class AppliedLoad(NamedTuple):
    """A force (N) at a place, and a moment (N m), on a body."""

    body: int
    x: Number
    y: Number
    force_x: Number
    force_y: Number
    moment: Number


class BodyWrench(NamedTuple):
    """Force (N), and moment about the origin of the machine (N m)."""

    x: Number = 0.0
    y: Number = 0.0
    moment: Number = 0.0


class JointForces(NamedTuple):
    """What joints and gears hold.

    Attributes
    ----------
    wrenches : list of BodyWrench
        Of each joint on its second body, the moment being about the joint's second point.
    gears : list of Number
        Of each gear along its second joint (N m or N); along the first it is minus the ratio times that.
    lack : list of Number
        Of each coordinate of the tree beside the loads; 0 where all efforts are among them.
    sizes : list of Number
        The sum of the magnitudes of which a lack is the difference.
    """

    wrenches: list[BodyWrench]
    gears: list[Number]
    lack: list[Number]
    sizes: list[Number]


class ReducedSystem:
    """A structure at an instant, reduced to its led coordinates, free ones first.

    Parameters
    ----------
    s : sequence of Number
        Coordinates of the tree, in its order.
    led_speeds : sequence of Number
        Speeds of free and driven coordinates.
    driven_accelerations : sequence of Number
        Of the driven ones.
    """

    def __init__(
        self,
        structure: Structure,
        split: Split,
        s: Sequence[Number],
        led_speeds: Sequence[Number],
        driven_accelerations: Sequence[Number],
    ) -> None:
        self.structure, self.split, self.led_speeds = structure, split, led_speeds
        self.motion = Kinematics(structure, s)
        self.closures = self.motion.closures()
        self.by_dependent = [[c.row[j] for j in split.dependent] for c in self.closures]
        right = [[-c.row[j] for j in split.led] for c in self.closures]
        self.follow = solution(self.by_dependent, right)[0] if split.dependent else []
        speeds: list[Number] = [0.0] * structure.size
        for j, speed in zip(split.led, led_speeds, strict=True):
            speeds[j] = speed
        for j, row in zip(split.dependent, self.follow, strict=True):
            speeds[j] = dot(row, led_speeds)
        self.rates = JointRates(self.motion, speeds)
        bent = [[-c.bent(self.rates)] for c in self.closures]
        self.zeta = [row[0] for row in solution(self.by_dependent, bent)[0]] if split.dependent else []
        self.driven_accelerations = driven_accelerations

    def reduced(self, row: Row) -> Row:
        """Return a row over all coordinates as one over the led ones."""
        found = []
        for k, j in enumerate(self.split.led):
            through = [row[i] * z[k] for i, z in zip(self.split.dependent, self.follow, strict=True)]
            found.append(total([row[j], *through]))
        return found

    def bent(self, row: Row, left: Number) -> Number:
        """Return the second derivative of what has this row with q'' = 0; ``left`` with all accelerations 0."""
        reduced = self.reduced(row)
        driven = dot(reduced[len(self.split.free) :], self.driven_accelerations)
        through = [row[i] * z for i, z in zip(self.split.dependent, self.zeta, strict=True)]
        return total([left, *through, driven])

    def second(self, scalar: Scalar) -> Number:
        """Return the second derivative of a scalar with q'' = 0."""
        return self.bent(scalar.row, scalar.bent(self.rates))

    def speed(self, scalar: Scalar) -> Number:
        """Return the first derivative of a scalar."""
        return dot(scalar.row, self.rates.speeds)

    def correction(self) -> tuple[list[Number], list[Number], list[Number]]:
        """Return the error of the dependent coordinates, the error of the closures, and their regularity."""
        if not self.split.dependent:
            return [], [], []
        missed = [c.value for c in self.closures]
        scales = [square_root(total([x * x for x in column])) for column in transposed(self.by_dependent)]
        found, regular = solution(self.by_dependent, [[-m] for m in missed], scales)
        return [row[0] for row in found], missed, regular

    def equations(
        self, efforts: Sequence[JointEffort], gravity: Vector, inertias: Sequence[JointEffort] = ()
    ) -> tuple[list[Row], Row]:
        """Return mass and force over the led coordinates: ``M a = h`` of those that are free.

        ``inertias`` are masses or inertias that move along scalars, as rotors behind a gear.
        """
        size = len(self.split.led)
        mass: list[Row] = [[0.0] * size for _ in range(size)]
        force: Row = [0.0] * size
        for number, body in enumerate(self.structure.bodies):
            if number == GROUND or (is_zero(body.mass) and is_zero(body.inertia)):
                continue
            at = self.motion.point(number, body.centre)
            left = self.rates.point(at)
            angle = self.motion.frames[number].row_angle
            rows = [self.reduced(at.row_x), self.reduced(at.row_y), self.reduced(angle)]
            bent = [self.bent(at.row_x, left[0]), self.bent(at.row_y, left[1]), self.bent(angle, 0.0)]
            weights = (body.mass, body.mass, body.inertia)
            pulls = (gravity[0], gravity[1], 0.0)
            for row, b, weight, pull in zip(rows, bent, weights, pulls, strict=True):
                if not is_zero(weight):
                    _add_inertia(mass, force, row, weight, pull - b)
        for rotor in inertias:
            moving = self.reduced(rotor.along.row)
            _add_inertia(mass, force, moving, rotor.size, -self.second(rotor.along))
        for i in range(size):
            for j in range(i):
                mass[j][i] = mass[i][j]
        for effort in efforts:
            for i, share in enumerate(self.reduced(effort.along.row)):
                force[i] = force[i] + share * effort.size
        return mass, force

    def accelerations(self, free: Sequence[Number]) -> list[Number]:
        """Return the accelerations of all coordinates, those of the free ones being known."""
        found: list[Number] = [0.0] * self.structure.size
        led = [*free, *self.driven_accelerations]
        for j, a in zip(self.split.led, led, strict=True):
            found[j] = a
        for j, row, z in zip(self.split.dependent, self.follow, self.zeta, strict=True):
            found[j] = dot(row, led) + z
        return found

    def kinetic_energy(self, inertias: Sequence[JointEffort] = ()) -> Number:
        """Return the kinetic energy (J)."""
        speeds = [self.speed(rotor.along) for rotor in inertias]
        terms = [0.5 * rotor.size * (v * v) for rotor, v in zip(inertias, speeds, strict=True)]
        for number, body in enumerate(self.structure.bodies):
            if number != GROUND:
                u, v = self.rates.velocity(self.motion.point(number, body.centre))
                w = self.rates.omega[number]
                terms += [0.5 * body.mass * (u * u + v * v), 0.5 * body.inertia * (w * w)]
        return total(terms)

    def weight_energy(self, gravity: Vector) -> Number:
        """Return the potential energy of the weights (J)."""
        terms: list[Number] = []
        for number, body in enumerate(self.structure.bodies):
            if number != GROUND:
                at = self.motion.point(number, body.centre)
                terms.append(-(body.mass * (gravity[0] * at.x + gravity[1] * at.y)))
        return total(terms)

    def joint_wrenches(
        self, accelerations: Sequence[Number], loads: Sequence[AppliedLoad], gravity: Vector
    ) -> JointForces:
        """Return the forces in joints and gears under loads."""
        lack, size = self._lacking(accelerations, loads, gravity)
        mu = self._loop_multipliers(lack)
        held: list[BodyWrench] = [BodyWrench()] * len(self.structure.joints)
        loops = self._loop_wrenches(mu)
        for number, w in loops.items():
            held[number] = w
        teeth = mu[len(mu) - len(self.structure.gears) :]
        for number, w in (*loops.items(), *self._gear_wrenches(teeth)):
            joint = self.structure.joints[number]
            lack[joint.second] = _less(lack[joint.second], w)
            lack[joint.first] = _plus(lack[joint.first], w)
            for body in (joint.first, joint.second):
                size[body] = size[body] + _magnitude(w)
        needs, sizes = [0.0] * self.structure.size, [0.0] * self.structure.size  # type: list[Number], list[Number]
        for branch in reversed(self.structure.branches):
            joint, w = self.structure.joints[branch.joint], lack[branch.child]
            if branch.parent != GROUND:
                lack[branch.parent] = _plus(lack[branch.parent], w)
                size[branch.parent] = size[branch.parent] + size[branch.child]
            on_second = w if branch.child == joint.second else BodyWrench(-w.x, -w.y, -w.moment)
            held[branch.joint] = on_second
            for i in range(COORDINATES[joint.kind]):
                needs[branch.coordinate + i] = self._along(branch.joint, i, on_second)
                sizes[branch.coordinate + i] = size[branch.child]
        return JointForces([self._about_joint(number, w) for number, w in enumerate(held)], teeth, needs, sizes)

    def _second_point(self, number: int) -> MovingPoint:
        joint = self.structure.joints[number]
        return self.motion.point(joint.second, joint.second_at)

    def _about_joint(self, number: int, w: BodyWrench) -> BodyWrench:
        at = self._second_point(number)
        return BodyWrench(w.x, w.y, w.moment - (at.x * w.y - at.y * w.x))

    def _along(self, number: int, i: int, w: BodyWrench) -> Number:
        """Return the part of a wrench that works on a coordinate of a joint."""
        joint, about = self.structure.joints[number], self._about_joint(number, w)
        frame = self.motion.frames[joint.first]
        if joint.kind == REVOLUTE or (joint.kind == FREE and i == 2):
            return about.moment
        axis = joint.axis if joint.kind == SLIDER else ((1.0, 0.0), (0.0, 1.0))[i]
        x, y = frame.turned(axis)
        return x * about.x + y * about.y

    def _lacking(
        self, accelerations: Sequence[Number], loads: Sequence[AppliedLoad], gravity: Vector
    ) -> tuple[list[BodyWrench], list[Number]]:
        """Return the wrench that each body lacks for its acceleration beside weight and loads; and magnitudes."""
        found: list[BodyWrench] = []
        sizes: list[Number] = [0.0] * len(self.structure.bodies)
        for number, body in enumerate(self.structure.bodies):
            if number == GROUND:
                found.append(BodyWrench())
                continue
            at, frame = self.motion.point(number, body.centre), self.motion.frames[number]
            left = self.rates.point(at)
            ax = dot(at.row_x, accelerations) + left[0] - gravity[0]
            ay = dot(at.row_y, accelerations) + left[1] - gravity[1]
            fx, fy = body.mass * ax, body.mass * ay
            turning = body.inertia * dot(frame.row_angle, accelerations)
            found.append(BodyWrench(fx, fy, turning + at.x * fy - at.y * fx))
            sizes[number] = _magnitude(found[number])
            for axis in gravity:  # in free fall the weight is all that there is
                sizes[number] = sizes[number] + magnitude(body.mass * axis)
        for load in loads:
            if load.body != GROUND:
                moment = load.moment + load.x * load.force_y - load.y * load.force_x
                given = BodyWrench(load.force_x, load.force_y, moment)
                found[load.body] = _less(found[load.body], given)
                sizes[load.body] = sizes[load.body] + _magnitude(given)
        return found, sizes

    def _loop_multipliers(self, lack: Sequence[BodyWrench]) -> list[Number]:
        if not self.split.dependent:
            return []
        right: list[Row] = []
        for j in self.split.dependent:
            terms = []
            for number, w in enumerate(lack):
                frame = self.motion.frames[number]
                about = w.moment - (frame.x * w.y - frame.y * w.x)
                terms += [frame.row_x[j] * w.x, frame.row_y[j] * w.y, frame.row_angle[j] * about]
            right.append([total(terms)])
        return [row[0] for row in solution(transposed(self.by_dependent), right)[0]]

    def _loop_wrenches(self, mu: Sequence[Number]) -> dict[int, BodyWrench]:
        """Return the wrench of each loop's joint on its second body, about the origin."""
        found: dict[int, BodyWrench] = {}
        place = 0
        for number in self.structure.loops:
            joint, at = self.structure.joints[number], self._second_point(number)
            if joint.kind == FREE:
                found[number] = BodyWrench()
                continue
            if joint.kind == SLIDER:
                x, y = self.motion.frames[joint.first].turned((-joint.axis[1], joint.axis[0]))
                fx, fy = mu[place] * x, mu[place] * y
                place += 1
            else:
                fx, fy = mu[place], mu[place + 1]
                place += 2
            moment: Number = 0.0
            if joint.kind in (SLIDER, WELD):
                moment = mu[place]
                place += 1
            found[number] = BodyWrench(fx, fy, moment + at.x * fy - at.y * fx)
        return found

    def _gear_wrenches(self, teeth: Sequence[Number]) -> list[tuple[int, BodyWrench]]:
        """Return the wrench of each gear on the second body of both its joints, about the origin."""
        found = []
        for gear, mu in zip(self.structure.gears, teeth, strict=True):
            for number, size in ((gear.first, -(gear.ratio * mu)), (gear.second, mu)):
                joint, at = self.structure.joints[number], self._second_point(number)
                if joint.kind == REVOLUTE:
                    found.append((number, BodyWrench(moment=size)))
                else:
                    x, y = self.motion.frames[joint.first].turned(joint.axis)
                    found.append((number, BodyWrench(size * x, size * y, size * (at.x * y - at.y * x))))
        return found


def _add_inertia(mass: list[Row], force: Row, row: Row, weight: Number, pull: Number) -> None:
    """Add what moves along a reduced row to the lower half of the mass, and to the force."""
    for i, share in enumerate(row):
        force[i] = force[i] + weight * (share * pull)
        for j in range(i + 1):
            mass[i][j] = mass[i][j] + weight * (share * row[j])


def _magnitude(w: BodyWrench) -> Number:
    return magnitude(w.moment) + magnitude(w.x) + magnitude(w.y)


def _less(a: BodyWrench, b: BodyWrench) -> BodyWrench:
    return BodyWrench(a.x - b.x, a.y - b.y, a.moment - b.moment)


def _plus(a: BodyWrench, b: BodyWrench) -> BodyWrench:
    return BodyWrench(a.x + b.x, a.y + b.y, a.moment + b.moment)


class Action(NamedTuple):
    """One action: along scalars of the motion, for its equations; on the bodies, for the forces in the joints."""

    efforts: list[JointEffort]
    loads: list[AppliedLoad]


def joint_action(at: ReducedSystem, number: int, size: Number) -> Action:
    """Return a force or moment of a joint, on its second body and back on its first, along its first coordinate."""
    joint, structure = at.structure.joints[number], at.structure
    scalar = at.motion.joint_coordinates(number)[0]
    efforts = [JointEffort(scalar, size)]
    if joint.kind == REVOLUTE:
        return Action(efforts, _both(joint.first, joint.second, (0.0, 0.0), (0.0, 0.0), size))
    x, y = at.motion.frames[joint.first].turned(joint.axis if joint.kind == SLIDER else (1.0, 0.0))
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
