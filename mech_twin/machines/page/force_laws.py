# SPDX-License-Identifier: Apache-2.0
"""Forces of the elements of a page at an instant: actions, potentials, laws, and event functions of switches."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from mech_twin.machines.page.assembly import exact_turn
from mech_twin.machines.page.elements import DEGREE, RPM, Contact, DriveElement
from mech_twin.machines.page.force_elements import GasCharge, SpringElement
from mech_twin.machines.page.state_places import HERTZ, NEAR_M, NO_GAP, StartLengths, StatePlaces
from mech_twin.machines.page.system import LEAST_VOLUME
from mech_twin.machines.page.tables import Line, Rows, line, repeats, scaled_rows, wrapped
from mech_twin.mechanics.code_generation import Number, Recording, larger, power, sine, smaller, total
from mech_twin.mechanics.dynamics import (
    Action,
    JointEffort,
    ReducedSystem,
    contact_action,
    force_action,
    joint_action,
    line_action,
    moment_action,
)
from mech_twin.mechanics.kinematics import JointRates, Kinematics, MovingPoint, Scalar

UNKNOWN = math.nan  # rate of a signal that is not told


class Law(NamedTuple):
    """A law of contact or friction: its coordinate, force bounds, restitution, and the action of its force."""

    scalar: Scalar
    low: Number
    high: Number
    restitution: float
    action: Callable[[Number], Action]


class PageNumbers:
    """The numbers of a page, plain or as leaves of a symbolic recording; 0, 1 and -1 are constants of the code."""

    def __init__(self, recording: Recording | None) -> None:
        self.values: list[float] = []
        self._recording = recording

    def __call__(self, value: float) -> Number:
        """Return a number of the page, registered as a leaf if symbols are recorded."""
        if self._recording is None or value in (0.0, 1.0, -1.0) or math.isinf(value):
            return float(value)
        self.values.append(float(value))
        return self._recording.leaf(f"numbers[{len(self.values) - 1}]")


class ElementForces:
    """The elements of a page at an instant; subclasses give the reduced system ``at`` and its motion."""

    places: StatePlaces
    at: ReducedSystem
    motion: Kinematics
    number: PageNumbers
    controls: Sequence[Number]
    t: Number
    amounts: Sequence[Number]

    def put_together(self) -> None:
        """Evaluate the forces of all elements."""
        self.page = self.places.page
        self.actions: dict[str, Action] = {}
        self.conservative: dict[str, Action] = {}
        self.potentials: dict[str, Number] = {}
        self.found_signals: dict[str, tuple[Number, Number]] = {}
        self.at_full_supply: dict[str, Number] = {}
        self.pressing: dict[str, Number] = {}
        self.amount_rates: list[Number] = []
        self.volumes: list[Number] = []  # of gas springs, over those at the start
        self.refills: list[Number] = []
        self.lines: list[Number] = []  # direction of each spring between points that has a force where they meet
        self.inertias = self._rotors()
        self._drives()
        self._springs()
        self._couplings()
        self._dampers()
        self._loads()
        for name, reset in self.page.resets.items():
            self.watch(
                name, sine(0.5 * (self.coordinate(reset.by).value - self.number(reset.at_deg * DEGREE))), UNKNOWN
            )
        self.laws = [self._contact(self.page.contacts[name]) for name in self.places.rigid]
        self.laws += [self._layer(name) for name in self.places.layers]
        self.laws += [self._resistance(joint) for joint in self.places.resisted.values()]
        self._compliant()
        self.laws += [self._rubbing(name) for name in self.places.rubbing.values()]
        self.signals = [self.found_signals[name] for name in self.places.switches]

    def regime(self, switch: str) -> Number:
        """Return the regime of a switch: 0, or 1 after its signal became negative."""
        return self.controls[self.places.switch_controls + 2 * self.places.switches.index(switch)]

    def watch(self, switch: str, value: Number, rate: Number) -> None:
        """Make a value the event function of a switch, whose regime is 1 while the value is negative."""
        sign = 1.0 - 2.0 * self.regime(switch)
        self.found_signals[switch] = (sign * value + NEAR_M, sign * rate)

    def point(self, name: str) -> MovingPoint:
        """Return a point by its name."""
        body, place = self.page.point(name)
        return self.motion.point(self.places.assembly.body_number(body), (self.number(place[0]), self.number(place[1])))

    def joint(self, name: str) -> int:
        """Return the index of a joint."""
        return self.places.assembly.joint_number(name)

    def coordinate(self, joint: str) -> Scalar:
        """Return the coordinate of a revolute or a slider."""
        return self.motion.joint_coordinates(self.joint(joint))[0]

    def _rotors(self) -> list[JointEffort]:
        found = []
        for drive in self.page.drives.values():
            inertia = rotor_inertia(drive)
            if inertia:
                found.append(JointEffort(self.coordinate(drive.joint), self.number(inertia)))
        return found

    def _drives(self) -> None:
        places = self.places
        for name, times in places.programs.items():
            following = self.controls[places.switch_controls + 2 * places.switches.index(name) + 1]
            self.found_signals[name] = (following - self.t if times else 0.0, -1.0)
        for i, name in enumerate(places.motors):
            drive = self.page.drives[name]
            place = places.motor_controls + 3 * i
            first, second, third = self.controls[place : place + 3]
            if drive.kind == "program":
                phase = self.regime(name)
                effort = (1.0 - phase) * first + phase * second
            elif drive.kind == "table":
                self.at_full_supply[name] = self._by_table(name, drive)
                effort = first * self.at_full_supply[name]
            elif drive.kind in ("constant_torque", "constant_force"):
                effort = first
            else:
                effort = first + second * (self.at.speed(self.coordinate(drive.joint)) - third)
            self.actions[name] = joint_action(self.at, self.joint(drive.joint), effort)

    def _by_table(self, name: str, drive: DriveElement) -> Number:
        """Return force or torque of a drive by table, at its own shaft, under full supply."""
        coordinate, ratio = self.coordinate(drive.joint), self.number(drive.gear_ratio or 1.0)
        if drive.table_s_n is not None or drive.table_s_nm is not None:
            period = drive.period_s
            t = self.t if period is None else wrapped(self.t, 0.0, self.number(period))
            return line(drive.rows, self.number, held=True).at(t)
        if drive.table_rpm_nm is not None or drive.table_m_per_s_n is not None:
            rows = drive.rows if drive.table_rpm_nm is None else scaled_rows(drive.rows, RPM)
            speed = ratio * self.at.speed(coordinate)
            return self._watched(name, line(rows, self.number, held=True), speed, UNKNOWN)
        return self._over_place(name, drive.rows, coordinate, turns=drive.table_deg_nm is not None)

    def _watched(self, name: str, made: Line, x: Number, rate: Number) -> Number:
        for i, (place, _) in enumerate(made.bends):
            self.watch(f"{name}_bend_{i}", x - place, rate)
        return made.at(x)

    def _over_place(self, name: str, rows: Rows, coordinate: Scalar, *, turns: bool) -> Number:
        """Return the value of a table over travel or angle."""
        x, rate = coordinate.value, self.at.speed(coordinate)
        if not turns:
            return self._watched(name, line(rows, self.number, held=True), x, rate)
        made = line(scaled_rows(rows, DEGREE), self.number, held=True)
        if not repeats(rows):
            return self._watched(name, made, x, rate)
        for i, (place, _) in enumerate(made.bends):
            self.watch(f"{name}_bend_{i}", sine(0.5 * (x - place)), UNKNOWN)
        return made.at(wrapped(x, made.first_x, 2.0 * math.pi))

    def _springs(self) -> None:
        start = StartLengths(self.places)
        for name, spring in self.page.springs.items():
            scalar = self._along(spring.between, spring.joint)
            if name in self.places.lines:
                one, other = map(self.point, spring.between or ())
                self.lines += [other.x - one.x, other.y - one.y]
            if spring.gas is not None:
                force = self._gas(name, spring.gas, scalar.value - self.number(start.length(spring)))
                self.actions[name] = self._act_along(spring.between, spring.joint, force)
                continue
            rows = self._rows(spring)
            if rows is not None:
                made = line(rows, self.number, held=False)
                force = self._watched(name, made, scalar.value, self.at.speed(scalar))
                self.potentials[name] = -made.area(scalar.value)
            else:
                rate = self.number(
                    spring.rate_n_per_m if spring.rate_n_per_m is not None else spring.rate_nm_per_rad or 0.0
                )
                stretch = scalar.value - self.number(start.free(spring))
                self.potentials[name], force = 0.5 * rate * (stretch * stretch), -(rate * stretch)
            self.conservative[name] = self._act_along(spring.between, spring.joint, force)

    @staticmethod
    def _rows(spring: SpringElement) -> Rows | None:
        return spring.table_m_n if spring.table_deg_nm is None else scaled_rows(spring.table_deg_nm, DEGREE)

    def _gas(self, name: str, gas: GasCharge, way: Number) -> Number:
        """Return the force (N) of a gas spring whose chamber is longer by ``way`` (m) than at the start."""
        number, amount = self.number, self.amounts[self.places.gases.index(name)]
        volume = 1.0 + number(gas.area_m2 / gas.volume_m3) * way  # over that at the start
        closed: Number = 1.0
        for port, opening in gas.ports.items():
            travel = self.coordinate(opening.joint)
            limit, sign = (
                (opening.open_above_m, -1.0) if opening.open_above_m is not None else (opening.open_below_m, 1.0)
            )
            value = sign * (travel.value - number(limit or 0.0))
            self.watch(f"{name}_{port}", value, sign * self.at.speed(travel))
            closed = closed * (1.0 - self.regime(f"{name}_{port}"))
        self.volumes.append(volume)
        pressure = number(gas.pressure_pa) * power(amount / larger(volume, LEAST_VOLUME), number(gas.exponent))
        excess = closed * (pressure - number(gas.ambient_pa))
        self.amount_rates.append(-(number(gas.leak_per_s / gas.pressure_pa) * excess))
        self.refills.append(number((gas.ambient_pa / gas.pressure_pa) ** (1.0 / gas.exponent)) * volume)
        return number(gas.area_m2) * excess

    def _couplings(self) -> None:
        for name, coupling in self.page.couplings.items():
            if coupling.firm:
                continue
            first, second = (self.coordinate(joint) for joint in coupling.joints)
            factor, begun = self.number(coupling.factor), StartLengths(self.places).twist(coupling)
            row = [factor * a - b for a, b in zip(first.row, second.row, strict=True)]
            twist = Scalar(factor * first.value - second.value - self.number(begun), row, _unbent)
            speed, carried, carries = self.at.speed(twist), twist.value, 1.0  # type: Number, Number, Number
            if coupling.backlash > 0.0:
                play = self.number(0.5 * coupling.backlash)
                self.watch(f"{name}_forward", play - twist.value, -speed)
                self.watch(f"{name}_backward", play + twist.value, speed)
                carried = larger(twist.value - play, 0.0) + smaller(twist.value + play, 0.0)
                carries = self.regime(f"{name}_forward") + self.regime(f"{name}_backward")
            rate = self.number(coupling.rate)
            self.potentials[name] = 0.5 * rate * (carried * carried)
            self.conservative[name] = self._between_joints(coupling.joints, factor, -(rate * carried))
            if coupling.damping > 0.0:
                moment = -(carries * self.number(coupling.damping) * speed)
                self.actions[name] = self._between_joints(coupling.joints, factor, moment)

    def _between_joints(self, joints: tuple[str, str], factor: Number, size: Number) -> Action:
        """Return the action of a coupling effort: ``factor * size`` on the first joint, ``-size`` on the second."""
        first, second = (
            joint_action(self.at, self.joint(joints[0]), factor * size),
            joint_action(self.at, self.joint(joints[1]), -size),
        )
        return Action([*first.efforts, *second.efforts], [*first.loads, *second.loads])

    def passed_on(self, coupling: str) -> Number:
        """Return the effort of a coupling on its second joint (N m or N), without its loss."""
        acts = [of[coupling] for of in (self.conservative, self.actions) if coupling in of]
        return total([act.efforts[1].size for act in acts])

    def _dampers(self) -> None:
        for name, damper in self.page.dampers.items():
            rate = damper.rate_ns_per_m if damper.rate_ns_per_m is not None else damper.rate_nms_per_rad
            speed = self.at.speed(self._along(damper.between, damper.joint))
            size = -(self.number(rate or 0.0) * speed)
            self.actions[name] = self._act_along(damper.between, damper.joint, size)

    def _along(self, between: tuple[str, str] | None, joint: str | None) -> Scalar:
        if joint is not None:
            return self.coordinate(joint)
        assert between is not None
        return self.motion.distance(self.point(between[0]), self.point(between[1]))

    def _act_along(self, between: tuple[str, str] | None, joint: str | None, size: Number) -> Action:
        if joint is not None:
            return joint_action(self.at, self.joint(joint), size)
        assert between is not None
        return line_action(self.at, self.point(between[0]), self.point(between[1]), size)

    def _loads(self) -> None:
        for name, load in self.page.loads.items():
            if load.point is not None and load.force_n is not None:
                force = self.number(load.force_n[0]), self.number(load.force_n[1])
                self.actions[name] = force_action(self.point(load.point), force)
            elif load.body is not None:
                body = self.places.assembly.body_number(load.body)
                self.actions[name] = moment_action(self.at, body, self.number(load.torque_nm or 0.0))
            elif load.joint is not None and load.over_speed is not None:
                rows = load.over_speed if load.table_rpm_nm is None else scaled_rows(load.over_speed, RPM)
                speed = self.at.speed(self.coordinate(load.joint))
                size = self._watched(name, line(rows, self.number, held=True), speed, UNKNOWN)
                self.actions[name] = joint_action(self.at, self.joint(load.joint), size)

    def _gap(self, contact: Contact) -> tuple[Scalar, Callable[[Number], Action]]:
        """Return the gap of a contact, and the action of its force."""
        if contact.joint is not None:
            joint, scalar = self.joint(contact.joint), self.coordinate(contact.joint)
            least = contact.least_m if contact.least_m is not None else contact.least_deg
            turns = contact.least_deg is not None or contact.most_deg is not None
            limit = least if least is not None else contact.most_m if contact.most_m is not None else contact.most_deg
            at = self.number((limit or 0.0) * (DEGREE if turns else 1.0))
            sign = 1.0 if least is not None else -1.0
            row = [sign * x for x in scalar.row]

            def bent(rates: object, sign: float = sign, scalar: Scalar = scalar) -> Number:
                return sign * scalar.bent(rates)  # type: ignore[arg-type]

            gap = Scalar(sign * (scalar.value - at), row, bent)
            return gap, lambda size: joint_action(self.at, joint, sign * size)
        assert contact.point is not None
        assert contact.line is not None
        x, y = exact_turn(contact.normal_deg or 0.0)
        normal = self.number(x), self.number(y)
        line, point = self.point(contact.line), self.point(contact.point)
        return self.motion.along(normal, line, point), lambda size: contact_action(self.at, line, point, normal, size)

    def _contact(self, contact: Contact) -> Law:
        gap, action = self._gap(contact)
        return Law(gap, 0.0, math.inf, float(contact.restitution or 0.0), action)

    def _layer(self, name: str) -> Law:
        """Return the law of a layer: from 0 to the force of its depth, against the motion into it."""
        contact = self.page.contacts[name]
        gap, action = self._gap(contact)
        self.watch(name, gap.value, self.at.speed(gap))
        force = line(contact.layer_m_n or (), self.number, held=True).at(larger(-gap.value, 0.0))
        return Law(gap, 0.0, self.regime(name) * force, NO_GAP, action)

    def _compliant(self) -> None:
        places = self.places
        for name in places.compliant:
            contact = self.page.contacts[name]
            gap, action = self._gap(contact)
            speed = self.at.speed(gap)
            depth = larger(-gap.value, 0.0)
            damped = larger(1.0 - self.number(contact.damping_s_per_m) * speed, 0.0)
            force = self.number(contact.stiffness_n_per_m or 0.0) * power(depth, HERTZ) * damped
            self.actions[name], self.pressing[name] = action(force), force
            self.watch(name, gap.value, speed)

    def _rubbing(self, name: str) -> Law:
        """Return the friction law along the line of a contact; a rigid one's normal force is that of the last step."""
        contact, places = self.page.contacts[name], self.places
        x, y = exact_turn(contact.normal_deg or 0.0)
        along = self.number(y), self.number(-x)
        line, point = self.point(contact.line or ""), self.point(contact.point or "")
        pressing = self.pressing.get(name)
        if pressing is None:
            found = self.controls[places.found_controls + places.free + places.laws.index(name)]
            pressing = larger(found, 0.0)
        most = self.number(contact.friction) * pressing
        scalar = self.motion.along(along, line, point)
        return Law(scalar, -most, most, NO_GAP, lambda size: contact_action(self.at, line, point, along, size))

    def _resistance(self, joint: str) -> Law:
        """Return the merged law of all resistances of a joint: friction, loads, a yielding wall, gear losses."""
        low, high = 0.0, 0.0
        coordinate, bounds = self.coordinate(joint), list[tuple[Number, Number]]()
        for friction in self.page.friction.values():
            if friction.joint == joint:
                size = friction.coulomb_n if friction.coulomb_n is not None else friction.coulomb_nm or 0.0
                low, high = low - size, high + size
        for contact in self.page.contacts.values():
            if contact.joint == joint and contact.gives_way_n is not None:
                low -= contact.gives_way_n
        for name, load in self.page.loads.items():
            if load.joint == joint and load.resisting is not None:
                force = self._over_place(name, load.resisting, coordinate, turns=load.table_deg_nm is not None)
                bounds.append((
                    0.0 if load.against == "backward" else -force, 0.0 if load.against == "forward" else force,
                ))  # fmt: skip
            elif load.joint == joint:
                low -= load.against_forward_n or load.against_forward_nm or 0.0
                high += load.against_backward_n or load.against_backward_nm or 0.0
        geared = [
            (drive.gear_efficiency or 1.0, self.actions[name].efforts[0].size)
            for name, drive in self.page.drives.items()
            if drive.joint == joint and (drive.gear_efficiency or 1.0) < 1.0
        ]
        geared += [
            (coupling.efficiency, self.passed_on(name))
            for name, coupling in self.page.couplings.items()
            if coupling.joints[1] == joint and coupling.efficiency < 1.0
        ]
        for eta, moment in geared:  # output from eta M to M / eta
            ends = self.number(eta - 1.0) * moment, self.number(1.0 / eta - 1.0) * moment
            bounds.append((smaller(*ends), larger(*ends)))
        least, most = self.number(low), self.number(high)
        for one, other in bounds:
            least, most = least + one, most + other
        number = self.joint(joint)
        return Law(coordinate, least, most, NO_GAP, lambda size: joint_action(self.at, number, size))


def _unbent(rates: JointRates) -> Number:
    raise NotImplementedError("the second derivative of a twist is not needed by any law")


def rotor_inertia(drive: DriveElement) -> float:
    """Return the inertia of a drive's rotor, seen at the joint (kg m2)."""
    ratio = drive.gear_ratio or 1.0
    own = drive.motor.rotor_inertia_kg_m2 if drive.motor is not None else drive.rotor_inertia_kg_m2 or 0.0
    return own * ratio * ratio
