# SPDX-License-Identifier: Apache-2.0
"""The equations of a page and the functions generated from them, its initial state, and the constants of its drives.

The equations, numerical or symbolic, are those of its structure under the forces of its elements.

State: free coordinates q and their speeds u, dependent z, driven r and their speeds w, then the work integrals.
Controls: accelerations of the driven coordinates, output of each drive, regimes of the elements with a switch.  For the
force analysis also results of the loop: accelerations of q, forces of the laws, efforts of the driven coordinates.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.compiled_roles import failed
from mech_twin.engine.hybrid.loop import TOO_MANY
from mech_twin.engine.sample_vectors import EventLayout
from mech_twin.errors import MotionError
from mech_twin.machines.page.assembly import structure_of
from mech_twin.machines.page.elements import RPM, DriveElement
from mech_twin.machines.page.force_laws import ElementForces, PageNumbers, rotor_inertia
from mech_twin.machines.page.state_places import StatePlaces
from mech_twin.machines.page.step import (
    DC,
    DRIVE_WIDTH,
    EFFORT,
    INDUCTION,
    MOTOR_NUMBERS,
    PROGRAM,
    SPEED,
    TABLE,
)
from mech_twin.mechanics.code_generation import Generated, Number, Recording, generated, total
from mech_twin.mechanics.dynamics import Action, ReducedSystem, joint_action
from mech_twin.mechanics.kinematics import Kinematics, dot
from mech_twin.mechanics.structure import FREE, Vector
from mech_twin.parts.induction_motor import motor_constants

FAILURES = (
    "more events in a coupling step than are followed", "no step is short enough for the motion",
    "more steps in a coupling step than are taken: a loop near a dead point, or a rate too stiff",
    "contacts contradict each other, or a given speed", "more events than the log takes",
    "", "", "", "", "a loop comes to a dead point, where its closures no longer determine the joints",
)  # fmt: skip
Array = NDArray[np.float64]


class PageInstant(ElementForces):
    """A page at an instant."""

    def __init__(
        self, places: StatePlaces, number: PageNumbers, controls: Sequence[Number], t: Number, state: Sequence[Number]
    ) -> None:
        self.places, self.page, self.number = places, places.page, number
        self.controls, self.t = controls, t
        assembly = places.assembly
        n, nz, nr = places.free, places.dependent, places.driven
        split = assembly.split
        s: list[Number] = [0.0] * (n + nz + nr)
        driven = 2 * n + nz
        for group, begin in ((split.free, 0), (split.dependent, 2 * n), (split.driven, driven)):
            for i, j in enumerate(group):
                s[j] = state[begin + i]
        speeds = [*state[n : 2 * n], *state[driven + nr : driven + 2 * nr]]
        self.gravity: Vector = (number(self.page.gravity_m_per_s2[0]), number(self.page.gravity_m_per_s2[1]))
        self.at = ReducedSystem(
            structure_of(self.page, number, places.assembly.offsets), split, s, speeds, list(controls[:nr])
        )
        self.motion: Kinematics = self.at.motion
        self.amounts = state[places.motion + len(places.books) :]
        self.put_together()

    def power(self, action: Action) -> Number:
        """Return the power of an action (W)."""
        return dot([effort.size for effort in action.efforts], [self.at.speed(e.along) for e in action.efforts])

    def equations(self) -> list[Number]:
        """Return the values for the event loop: see `ValuePlaces`."""
        n, nr = self.places.free, self.places.driven
        acting = [*self.actions.values(), *self.conservative.values()]
        efforts = [effort for action in acting for effort in action.efforts]
        mass, force = self.at.equations(efforts, self.gravity, self.inertias)
        out: list[Number] = [x for row in mass[:n] for x in row[:n]]
        out += force[:n]
        for i in range(n, n + nr):
            out += [*mass[i][:n], force[i]]
        for law in self.laws:
            reduced = self.at.reduced(law.scalar.row)
            drift = dot(reduced[n:], self.at.led_speeds[n:])
            out += [*reduced, drift, self.at.second(law.scalar), law.scalar.value, law.low, law.high]
        out += [self.at.rates.speeds[j] for j in self.places.assembly.split.dependent]
        out += [self.power(self.actions[name]) for name in self.places.worked]
        for value, rate in self.signals:
            out += [value, rate]
        return [*out, *self.amount_rates, *self.refills]

    def correction(self) -> list[Number]:
        """Return the Newton corrections of the dependent coordinates, the closure errors, and their regularity."""
        lack, missed, regular = self.at.correction()
        return [*lack, *missed, *regular]

    def energies(self) -> list[Number]:
        """Return kinetic and potential energy (J)."""
        stored: Number = self.at.weight_energy(self.gravity)
        for energy in self.potentials.values():
            stored = stored + energy
        return [self.at.kinetic_energy(self.inertias), stored]

    def joint_motion(self) -> list[Number]:
        """Return position and speed of each coordinate of all joints."""
        out: list[Number] = []
        for number in range(len(self.page.joints)):
            for scalar in self.motion.joint_coordinates(number):
                out += [scalar.value, self.at.speed(scalar)]
        return out

    def outputs(self) -> dict[str, Number]:
        """Return the outputs of the page besides the joints, by name with unit."""
        out: dict[str, Number] = {}
        for name, output in self.page.outputs.items():
            if output.point is not None:
                point = self.point(output.point)
                u, v = self.at.rates.velocity(point)
                out |= {f"{name}_x_m": point.x, f"{name}_y_m": point.y}
                out |= {f"{name}_x_m_per_s": u, f"{name}_y_m_per_s": v}
            elif output.distance is not None:
                first, second = map(self.point, output.distance)
                distance = self.motion.distance(first, second)
                out |= {f"{name}_m": distance.value, f"{name}_m_per_s": self.at.speed(distance)}
            elif output.angle is not None:
                angle = self.motion.angle(*map(self.places.assembly.body_number, output.angle))
                out |= {f"{name}_rad": angle.value, f"{name}_rad_per_s": self.at.speed(angle)}
        return out

    def reactions(self) -> JointReactions:
        """Return the force analysis from the accelerations, law forces and efforts found by the loop."""
        places = self.places
        n, m, begin = places.free, len(places.laws), places.found_controls
        accelerations = self.at.accelerations(list(self.controls[begin : begin + n]))
        forces = self.controls[begin + n : begin + n + m]
        held = self.controls[begin + n + m : begin + n + m + places.driven]
        laws = {name: law.action(f) for name, law, f in zip(places.laws, self.laws, forces, strict=True)}
        leading = [
            joint_action(self.at, self.joint(self.page.drives[name].joint), effort)
            for name, effort in zip(places.driven_names, held, strict=True)
        ]
        rotors = []
        for drive, rotor in zip([d for d in self.page.drives.values() if rotor_inertia(d)], self.inertias, strict=True):
            turned = dot(rotor.along.row, accelerations) + rotor.along.bent(self.at.rates)
            rotors.append(joint_action(self.at, self.joint(drive.joint), -(rotor.size * turned)))
        acting = [*self.actions.values(), *self.conservative.values(), *laws.values(), *leading, *rotors]
        loads = [load for action in acting for load in action.loads]
        found = self.at.joint_wrenches(accelerations, loads, self.gravity)
        teeth = dict(zip(places.assembly.firm, found.gears, strict=True))
        pins: dict[str, tuple[Number, Number, Number]] = {}
        for number, (name, joint) in enumerate(self.page.joints.items()):
            if joint.kind != FREE:
                pins[name] = found.wrenches[number]
        for name in places.touching:
            touching = [laws[name] if name in laws else self.actions[name]]
            touching += [laws[law] for law, contact in places.rubbing.items() if contact == name]
            on = [act.loads[0] for act in touching]
            pins[name] = (total([w.force_x for w in on]), total([w.force_y for w in on]), on[0].moment)
        quantities: dict[str, Number] = {}
        for name in places.motors:
            quantities |= self._effort(name, self.actions[name], self.page.drives[name].turns)
        for name, action in zip(places.driven_names, leading, strict=True):
            quantities |= self._effort(name, action, self.page.drives[name].turns)
        for name, spring in self.page.springs.items():
            unit = "moment_nm" if spring.turns else "force_n"
            acts = self.actions if spring.gas is not None else self.conservative
            quantities[f"{name}_{unit}"] = acts[name].efforts[0].size
        for name, coupling in self.page.couplings.items():
            passed_on = teeth[name] if coupling.firm else self.passed_on(name)
            quantities[f"{name}_{'force_n' if coupling.slides else 'moment_nm'}"] = -passed_on
        for name, damper in self.page.dampers.items():
            quantities[f"{name}_{'moment_nm' if damper.turns else 'force_n'}"] = self.actions[name].efforts[0].size
        for name, joint_name in places.resisted.items():
            unit = "moment_nm" if self.page.joints[joint_name].kind == "revolute" else "force_n"
            quantities[f"{name}_{unit}"] = laws[name].efforts[0].size
        return JointReactions(pins, quantities | self.outputs(), found.lack, found.sizes)

    def _effort(self, name: str, action: Action, turns: bool) -> dict[str, Number]:
        unit = "torque_nm" if turns else "force_n"
        return {f"{name}_{unit}": action.efforts[0].size, f"{name}_power_w": self.power(action)}


class JointReactions(NamedTuple):
    """Force analysis: wrenches by pin, quantities by name, residual effort of each coordinate, size of its terms."""

    pins: dict[str, tuple[Number, Number, Number]]
    quantities: dict[str, Number]
    lack: list[Number]
    sizes: list[Number]


def failures_of(places: StatePlaces) -> tuple[str, ...]:
    """Return the texts of a page's failures: those of every page, then of gas springs and lines (`beyond_elements`)."""
    used_up = "expected more than area times way; the motion presses the gas beyond zero volume"
    ends = {name: " and ".join(places.page.springs[name].between or ()) for name in places.lines}
    apart = "expected a contact that keeps its ends apart;"
    return (
        *FAILURES,
        *(f"springs.{name}.gas.volume_m3: {used_up}" for name in places.gases),
        *(f"springs.{name}.between: {apart} {points} pass each other" for name, points in ends.items()),
    )


def failure_of(
    page: str, failures: tuple[str, ...], status: int, begin_s: float, events: EventLayout, log: Array
) -> MotionError:
    """Return the error for a failed step, naming the page and the elements with most of its events.

    Parameters
    ----------
    page : str
        Name of the page.
    failures : tuple of str
        Texts of the statuses from -1 downwards.
    status : int
        Status returned by the kernel.
    begin_s : float
        Start of the step (s).
    events : EventLayout
        Layout of ``log``.
    log : ndarray
        Events of the step; a full table is replaced by one of twice its length and 8 rows more.
    """
    error = f"{page}: {failed(failures, status, begin_s)}"
    filled = (len(log) - 8) // 2 - 2 * len(events.contacts) - 2
    if status != TOO_MANY:
        return MotionError(error)
    if filled <= 0:  # changes of contacts that stay closed, which are no events
        return MotionError(f"{error}; give contacts that rest on each other a stiffness")
    counts = Counter(event.contact for event in events.events(log[:filled]))
    most = ", ".join(name for name, _ in counts.most_common(3))
    return MotionError(
        f"{error}, most of {most}; give a contact that stays pressed while another strikes restitution 0"
    )


class Functions(NamedTuple):
    """The generated functions of a page, its numbers, and the names of the results."""

    instant: Generated
    correction: Generated
    report: Generated
    reactions: Generated
    numbers: tuple[float, ...]
    pins: tuple[str, ...]
    quantities: tuple[str, ...]


def functions_of(places: StatePlaces) -> Functions:
    """Return the functions of a page, generated for its structure."""
    recording = Recording()
    number = PageNumbers(recording)
    controls: list[Number] = [recording.leaf(f"controls[{i}]") for i in range(places.controls)]
    state: list[Number] = [recording.leaf(f"state[{i}]") for i in range(places.state)]
    now = PageInstant(places, number, controls, recording.leaf("t"), state)
    reactions = now.reactions()
    wrenches = [x for wrench in reactions.pins.values() for x in wrench]
    made = generated(
        {
            "instant": now.equations(),
            "correction": now.correction(),
            "report": [
                *now.joint_motion(),
                *now.energies(),
                *(now.at_full_supply[name] for name in places.tabled),
                *now.volumes,
                *now.lines,
            ],
            "reactions": [*wrenches, *reactions.quantities.values(), *reactions.lack, *reactions.sizes],
        }
    )
    return Functions(
        made["instant"], made["correction"], made["report"], made["reactions"], tuple(number.values),
        tuple(reactions.pins), tuple(reactions.quantities),
    )  # fmt: skip


def start_state(places: StatePlaces) -> list[float]:
    """Return the state at the start, with all work integrals zero."""
    assembly = places.assembly
    split, s, speeds = assembly.split, assembly.start, assembly.start_speeds
    n = places.free
    return [
        *(float(s[j]) for j in split.free), *map(float, speeds[:n]), *(float(s[j]) for j in split.dependent),
        *(float(s[j]) for j in split.driven), *map(float, speeds[n:]), *[0.0] * len(places.books),
        *[1.0] * len(places.gases),
    ]  # fmt: skip


def drive_row(drive: DriveElement, places: StatePlaces, name: str) -> Array:
    """Return the constants of a drive for the kernels."""
    row = np.zeros(DRIVE_WIDTH)
    column, ratio = places.assembly.columns.index(drive.joint), drive.gear_ratio or 1.0
    first = second = switched = 0.0
    kind = {
        "constant_speed": SPEED,
        "program": PROGRAM,
        "table": TABLE,
        "dc_motor": DC,
        "induction_motor": INDUCTION,
    }.get(drive.kind, EFFORT)
    if kind == SPEED:
        first = (drive.speed_rpm or 0.0) * RPM if drive.speed_m_per_s is None else drive.speed_m_per_s
    elif kind == EFFORT:
        first = drive.torque_nm if drive.torque_nm is not None else drive.force_n or 0.0
    elif kind == PROGRAM:
        first, second = drive.levels_n or drive.levels_nm or (0.0, 0.0)
        switched = places.switches.index(name)
    elif kind == TABLE:
        switched = places.tabled.index(name)
    elif kind == DC:
        first, second = drive.stall_torque_nm or 0.0, (drive.no_load_speed_rpm or 0.0) * RPM
    row[:MOTOR_NUMBERS] = kind, column, ratio, first, second, switched
    if drive.motor is not None:
        row[MOTOR_NUMBERS:] = [float(x) for x in motor_constants(drive.motor)]
    return row
