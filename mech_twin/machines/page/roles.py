# SPDX-License-Identifier: Apache-2.0
"""Roles of a page: its drives, the machine itself, and its force analysis."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.compiled_roles import CompiledForces, CompiledLinkage, CompiledMotor
from mech_twin.engine.hybrid.complementarity import SOLVED
from mech_twin.engine.sample_vectors import COMMAND, Array, EventLayout, ForceLayout, LinkageLayout, MotorLayout
from mech_twin.errors import MotionError
from mech_twin.machines.page.assembly import Assembly
from mech_twin.machines.page.elements import DriveElement
from mech_twin.machines.page.equations import (
    Functions,
    PageInstant,
    drive_row,
    failure_of,
    failures_of,
    functions_of,
    start_state,
)
from mech_twin.machines.page.force_laws import PageNumbers
from mech_twin.machines.page.parameters import Page
from mech_twin.machines.page.rods import PageRods
from mech_twin.machines.page.state_places import StatePlaces, check_lines
from mech_twin.machines.page.step import (
    DRIVE_WIDTH,
    PROGRAM,
    TABLE,
    PageDrives,
    PageForces,
    PageMachine,
    effort_of,
    start_page,
)
from mech_twin.machines.page.system import BEND, KINDS, PHASE, PORT, RESET, TOUCH, PageSystem
from mech_twin.samples import LinkageSample

LIMITS = {"loop_closure_m": 1e-10, "energy_balance": 1e-7}
FORCE_LIMITS = {"drive_torque_routes": 1e-8}
TOLERANCE = 1e-12  # of the error of a step, in parts of the machine's size, and of its speeds
DEEP = 1e-9  # of the machine's size: a contact that begins deeper than this begins wrongly


@dataclass(frozen=True)
class PageModel:
    """Data shared by the roles of a page."""

    page: Page

    @cached_property
    def assembly(self) -> Assembly:
        """The structure in its pose at the start."""
        return Assembly(self.page)

    @cached_property
    def places(self) -> StatePlaces:
        """Layout of state, controls and values."""
        return StatePlaces(self.page, self.assembly)

    @cached_property
    def functions(self) -> Functions:
        """The generated functions."""
        return functions_of(self.places)

    @cached_property
    def start_state(self) -> list[float]:
        """The state at the start."""
        return start_state(self.places)

    @cached_property
    def start_instant(self) -> PageInstant:
        """The equations at the start, in numbers.

        Raises
        ------
        ConfigurationError
            A freedom has no inertia, or a contact begins inside.
        """
        places = self.places
        check_lines(self.page, self.assembly)
        controls = [0.0] * places.controls
        now = PageInstant(places, PageNumbers(None), controls, 0.0, self.start_state)
        n = places.free
        mass = np.array(now.equations()[: n * n], dtype=float).reshape(n, n)
        values, vectors = np.linalg.eigh(mass) if n else (np.array([1.0]), np.eye(1))
        if values[0] <= 1e-12 * values[-1] or values[0] <= 0.0:
            moved = self.assembly.coordinates[self.assembly.split.free[int(np.abs(vectors[:, 0]).argmax())]]
            raise ConfigurationError(
                f"joints.{moved}: a motion without inertia: give the bodies that it moves a mass or an inertia"
            )
        for name, law in zip(places.laws, now.laws, strict=True):
            value = float(law.scalar.value)  # type: ignore[arg-type]
            if law.restitution >= 0.0 and value < -DEEP * self.assembly.size_m:
                how = "line" if self.page.contacts[name].joint is None else "stop"
                unit = "rad" if name in self.turning_stops else "m"
                raise ConfigurationError(
                    f"contacts.{name}: begins {-value:.4g} {unit} behind its {how}; start its bodies further off"
                )
        return now

    @cached_property
    def turning_stops(self) -> frozenset[str]:
        """The contacts that are stops of a revolute: their gap is an angle."""
        return frozenset(
            name for name, c in self.page.contacts.items() if c.joint and self.page.joints[c.joint].kind == "revolute"
        )

    @cached_property
    def drives(self) -> Array:
        """A row for each drive, those of driven coordinates in the order of these."""
        rows = [drive_row(drive, self.places, name) for name, drive in self.ordered_drives.items()]
        return np.array(rows).reshape(len(rows), DRIVE_WIDTH)

    @cached_property
    def ordered_drives(self) -> dict[str, DriveElement]:
        """The drives: those with a given speed in the order of their coordinates, then the others."""
        names = (*self.places.driven_names, *self.places.motors)
        return {name: self.page.drives[name] for name in names}

    @cached_property
    def system(self) -> PageSystem:
        """The page for the loop; the functions' addresses are of this process."""
        p, f = self.places, self.functions
        n, nr = p.free, p.driven
        law_values = n * n + n + nr * (n + 1)
        timing = np.zeros((len(p.switches), 1 + max([1, *map(len, p.programs.values())])))
        for i, times in enumerate(p.programs.values()):
            timing[i, : 1 + len(times)] = len(times), *times
        kinds = [
            PHASE if name in p.programs else PORT if name in p.ports else BEND if name in p.bends
            else RESET if name in p.resets else TOUCH
            for name in p.switches
        ]  # fmt: skip
        for name, k in p.resets.items():
            timing[p.switches.index(name), :2] = self.start_state[k], self.start_state[n + k]
        changed = [{**p.ports, **p.resets}.get(name, 0) for name in p.switches]
        restitutions = [self.page.contacts[name].restitution or 0.0 for name in p.rigid]
        return PageSystem(
            f.instant.address(), f.correction.address(), np.array([*f.numbers, 0.0]), np.zeros(p.controls + 1),
            np.zeros(max(f.instant.size, f.report.size) + 1), np.zeros(f.correction.size),
            np.array([*restitutions, *[-1.0] * (len(p.laws) - len(p.rigid))], dtype=float), timing,
            np.array(kinds, dtype=np.int64), np.array(changed, dtype=np.int64),
            n, p.dependent, nr, len(p.laws), len(p.switches), len(p.programs), len(p.worked), p.switch_controls,
            law_values, law_values + len(p.laws) * (n + nr + 5), len(p.gases), self.rods.rows,
            np.array([p.laws.index(name) for name in self.rods.rods], dtype=np.int64),
            np.zeros(len(p.laws), dtype=np.int64), f.report.address(), 2 * len(self.assembly.columns), len(p.resets),
        )  # fmt: skip

    @cached_property
    def rods(self) -> PageRods:
        """The rods that contacts strike through."""
        return PageRods({name: c.rod for name, c in self.page.contacts.items() if c.rod is not None})

    @cached_property
    def tolerance(self) -> Array:
        """Largest error of a step for each number of the state."""
        p, size = self.places, self.assembly.size_m
        scale = [size if name in self.assembly.slides else 1.0 for name in self.assembly.coordinates]
        split = self.assembly.split
        q, z, r = ([scale[j] for j in group] for group in (split.free, split.dependent, split.driven))
        rough = 1e2  # speeds change by as much as positions in 10 ms
        motion = [*q, *(rough * x for x in q), *z, *r, *(rough * x for x in r)]
        books = [1e3 * self.energy_scale_j] * len(p.books)
        return TOLERANCE * np.array([*motion, *books, *[1.0] * len(p.gases)])

    @cached_property
    def energy_scale_j(self) -> float:
        """Energy scale (J): weight times size of the machine, and the energy of its springs at that size."""
        size = self.assembly.size_m
        weight = sum(body.mass_kg for body in self.page.bodies.values()) * 9.81 * size
        springs = sum(
            (s.rate_n_per_m or 0.0) * size**2 + (s.rate_nm_per_rad or 0.0) for s in self.page.springs.values()
        )
        return max(weight + springs, 1e-3)

    @cached_property
    def memory(self) -> tuple[str, ...]:
        """Names of the linkage's memory."""
        p = self.places
        coordinates, slides = self.assembly.coordinates, self.assembly.slides
        split = self.assembly.split

        def acceleration(j: int) -> str:
            name = coordinates[j]
            return f"{name}_acceleration_{'m_per_s2' if name in slides else 'rad_per_s2'}"

        turning = {name for name, joint in self.page.joints.items() if joint.kind == "revolute"}
        of_law = {name: name in self.turning_stops or p.resisted.get(name, "") in turning for name in p.laws}
        turns = {name: drive.turns for name, drive in self.page.drives.items()}
        efforts = [f"{name}_{'torque_nm' if turns[name] else 'force_n'}" for name in p.driven_names]
        names = [
            *(f"{name}_regime_1" for name in p.laws),
            *(f"{name}_{'layer' if name in p.laws else 'regime'}_1" for name in p.switches),  # a layer is a law's too
            *(f"{name}_work_j" for name in p.books), *(f"{name}_gas_1" for name in p.gases),
            *map(acceleration, split.free), *(f"{n}_{'moment_nm' if of_law[n] else 'force_n'}" for n in p.laws),
            *efforts, *map(acceleration, split.driven),
        ]  # fmt: skip
        for name in p.motors:
            unit = "nm" if self.page.drives[name].turns else "n"
            names += [f"{name}_given_{unit}", f"{name}_slope_1"]
            names += [f"{name}_given_speed_{'rad' if unit == 'nm' else 'm'}_per_s"]
        kept = [f"{coordinates[j]}_rest_{'m' if coordinates[j] in slides else 'rad'}" for j in split.driven]
        given = [f"{n}_full_supply_{'nm' if turns[n] else 'n'}" for n in p.tabled]
        return (*names, *given, *kept, "start_energy_j", "turned_over_j", "energy_j")

    @cached_property
    def linkage_layout(self) -> LinkageLayout:
        """Row of the linkage."""
        p = self.places
        events = EventLayout(KINDS, (*p.laws, *p.switches))
        return LinkageLayout(self.assembly.columns, self.memory, tuple(LIMITS), events)

    @cached_property
    def machine(self) -> PageMachine:
        """Constants of the linkage's kernel."""
        p, split = self.places, self.assembly.split
        order = (*split.free, *split.dependent, *split.driven)
        columns = [self.assembly.columns.index(self.assembly.coordinates[j]) for j in order]
        joints = len(self.assembly.columns)
        return PageMachine(
            self.system, self.drives,
            np.array(columns, dtype=np.int64),
            self.tolerance, np.zeros(self.functions.report.size), joints, len(p.books),
            len(p.books) + len(p.gases), len(p.tabled), len(p.motors),
            float(self.page.coupling.step_s),
        )  # fmt: skip


@dataclass(frozen=True)
class Drives(CompiledMotor):
    """The motor role: each drive of the page, at its own shaft."""

    shared: PageModel = field(repr=False)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the drives."""
        return tuple(self.shared.ordered_drives)

    @property
    def effort_limit(self) -> float:
        """Greatest effort that can be asked: of one motor or constant effort alone; else 0."""
        drives = tuple(self.shared.ordered_drives.values())
        return drives[0].effort_limit if len(drives) == 1 else 0.0

    @cached_property
    def model(self) -> PageDrives:
        """Constants of the kernel."""
        page, p = self.shared.page, self.shared.places
        switches = 2 + 3 * len(self.shared.assembly.columns) + len(p.laws)
        tables = self.shared.linkage_layout.size - 5 - p.driven - len(p.tabled)
        return PageDrives(
            self.shared.drives, switches, tables, float(page.supply.rate_per_s), float(page.coupling.step_s)
        )

    @cached_property
    def layout(self) -> MotorLayout:
        """Row of the samples."""
        return MotorLayout(self.joints)


@dataclass(frozen=True)
class PageLinkage(CompiledLinkage):
    """The linkage role: every body of the page, integrated by the event loop."""

    shared: PageModel = field(repr=False)
    regimes: tuple[str, ...] = ("free", "contact")
    residual_limits: Mapping[str, float] = field(default_factory=lambda: LIMITS)
    processor_only: str = "the mechanics of a page are generated for the processor"

    @property
    def step_s(self) -> float:  # type: ignore[override]
        """Coupling step (s)."""
        return self.shared.page.coupling.step_s

    @cached_property
    def failures(self) -> tuple[str, ...]:
        """Texts of the kernel's statuses from -1 downwards."""
        return failures_of(self.shared.places)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints' coordinates."""
        return self.shared.assembly.columns

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the free coordinates."""
        return tuple(self.shared.assembly.coordinates[j] for j in self.shared.assembly.split.free)

    def failure(self, status: int, begin_s: float, log: Array) -> MotionError:
        """Return the error for a failed step, naming the elements with most of its events."""
        return failure_of(self.shared.page.name, self.failures, status, begin_s, self.layout.events, log)

    @property
    def timed_drives(self) -> tuple[str, ...]:
        """Drives that are functions of time."""
        return tuple(self.shared.places.programs)

    @property
    def model(self) -> PageMachine:
        """Constants of the kernel."""
        return self.shared.machine

    @property
    def layout(self) -> LinkageLayout:
        """Row of the samples."""
        return self.shared.linkage_layout

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine in its pose at the start.

        Raises
        ------
        ConfigurationError
            Contacts contradict each other.
        """
        shared, places, model = self.shared, self.shared.places, self.shared.machine
        shared.start_instant  # noqa: B018 # refuses what cannot start
        row, y, time_s = np.zeros(self.layout.size), np.array(shared.start_state), step * self.step_s
        regimes = np.zeros(len(places.laws) + len(places.switches), dtype=np.int64)
        for i, times in enumerate(places.programs.values()):
            cycle = int(time_s // times[-1]) if times[-1] < math.inf else 0
            into = time_s - cycle * times[-1] if cycle else time_s
            regimes[len(places.laws) + i] = len(times) * cycle + sum(into >= x for x in times[:-1])
        for i, name in enumerate(places.switches[len(places.programs) :], len(places.laws) + len(places.programs)):
            value = shared.start_instant.found_signals[name][0]
            regimes[i] = 1 if isinstance(value, float) and value < 0.0 else 0
        fraction = shared.page.supply.initial_fraction
        self._start_controls(model, fraction)
        if start_page(model, time_s, y, regimes, row) != SOLVED:
            raise ConfigurationError("contacts: those that are closed at the start contradict each other")
        row[COMMAND] = fraction
        return self.layout.sample(step, time_s, row.tolist(), ())

    def _start_controls(self, model: PageMachine, fraction: float) -> None:
        """Fill the controls with the drives' output at the start; slopes by speed follow with the first step."""
        controls, p, now = model.system.controls, self.shared.places, self.shared.start_instant
        controls[:] = 0.0
        for i, name in enumerate(p.motors):
            row, place = self.shared.drives[len(p.driven_names) + i], p.motor_controls + 3 * i
            speed = row[2] * now.at.speed(now.coordinate(self.shared.page.drives[name].joint))
            controls[place] = row[2] * (fraction if int(row[0]) == TABLE else effort_of(row, speed, fraction))
            if int(row[0]) == PROGRAM:
                controls[place + 1] = fraction * row[4]


@dataclass(frozen=True)
class PageReactions(CompiledForces):
    """The force analysis: the force of each joint on its second body, of each contact on its point's body."""

    shared: PageModel = field(repr=False)
    residual_limits: Mapping[str, float] = field(default_factory=lambda: FORCE_LIMITS)

    @cached_property
    def pins(self) -> tuple[str, ...]:
        """Names of joints and contacts."""
        return self.shared.functions.pins

    @cached_property
    def acts_on(self) -> tuple[str, ...]:
        """The body that each wrench acts on."""
        page = self.shared.page
        found = []
        for name in self.pins:
            if name in page.joints:
                found.append(page.point(page.joints[name].between[1])[0])
            else:
                contact = page.contacts[name]
                point = contact.point or page.joints[contact.joint or ""].between[1]
                found.append(page.point(point)[0])
        return tuple(found)

    @cached_property
    def model(self) -> PageForces:
        """Constants of the kernel."""
        f = self.shared.functions
        return PageForces(
            self.shared.machine, f.reactions.address(), np.zeros(f.reactions.size), len(f.pins), len(f.quantities)
        )

    @cached_property
    def layout(self) -> ForceLayout:
        """Row of the samples."""
        return ForceLayout(self.pins, self.shared.functions.quantities, tuple(FORCE_LIMITS))
