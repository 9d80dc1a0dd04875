# SPDX-License-Identifier: Apache-2.0
"""Layout of a page's state, controls and values, and lengths at its start: the reference of springs and gaps."""

import math
from dataclasses import dataclass
from functools import cached_property

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.machines.page.assembly import CLOSED, Assembly
from mech_twin.machines.page.elements import DEGREE
from mech_twin.machines.page.force_elements import CouplingElement, SpringElement
from mech_twin.machines.page.parameters import Page, distinct
from mech_twin.machines.page.tables import Rows, bends_of, instants
from mech_twin.mechanics.kinematics import Kinematics

HERTZ = 1.5  # exponent of a compliant contact
NO_GAP = -1.0
NEAR_M = 1e-11  # beyond its gap, where it gives no force, a compliant contact counts as changed: it stays so


@dataclass(frozen=True)
class StatePlaces:
    """Indices and names of the numbers of a page in state, controls and values."""

    page: Page
    assembly: Assembly

    @cached_property
    def free(self) -> int:
        """Number of free coordinates."""
        return len(self.assembly.split.free)

    @cached_property
    def driven(self) -> int:
        """Number of driven coordinates."""
        return len(self.assembly.split.driven)

    @cached_property
    def dependent(self) -> int:
        """Number of dependent coordinates."""
        return len(self.assembly.split.dependent)

    @cached_property
    def laws(self) -> tuple[str, ...]:
        """Names of the laws: rigid contacts, layers, joints with friction or resistance, contacts with friction."""
        return (*self.rigid, *self.layers, *self.resisted, *self.rubbing)

    @cached_property
    def rigid(self) -> tuple[str, ...]:
        """Rigid contacts, with a given restitution or that of a blow on a rod."""
        return tuple(name for name, c in self.page.contacts.items() if c.rigid)

    @cached_property
    def layers(self) -> tuple[str, ...]:
        """Contacts with a layer."""
        return tuple(name for name, c in self.page.contacts.items() if c.layer_m_n is not None)

    @cached_property
    def compliant(self) -> tuple[str, ...]:
        """Contacts with a stiffness."""
        return tuple(name for name, c in self.page.contacts.items() if c.stiffness_n_per_m is not None)

    @cached_property
    def touching(self) -> tuple[str, ...]:
        """Contacts with a normal force: rigid ones, layers and compliant ones."""
        return (*self.rigid, *self.layers, *self.compliant)

    @cached_property
    def resisted(self) -> dict[str, str]:
        """Joint of each law of resistance, by the law's name: its element's, or the joint's if there are several."""
        page = self.page
        found: dict[str, list[str]] = {}
        for name, friction in page.friction.items():
            found.setdefault(friction.joint, []).append(name)
        for name, load in page.loads.items():
            if load.joint is not None and load.resists:
                found.setdefault(load.joint, []).append(name)
        for name, contact in page.contacts.items():
            if contact.gives_way_n is not None:
                found.setdefault(contact.joint or "", []).append(name)
        for name, drive in page.drives.items():
            if (drive.gear_efficiency or 1.0) < 1.0:
                found.setdefault(drive.joint, []).append(distinct("drives", f"{name}_gear", page.named))
        for name, coupling in page.couplings.items():
            if coupling.efficiency < 1.0:
                found.setdefault(coupling.joints[1], []).append(distinct("couplings", f"{name}_loss", page.named))
        return {names[0] if len(names) == 1 else joint: joint for joint, names in found.items()}

    @cached_property
    def rubbing(self) -> dict[str, str]:
        """The contact of each law of friction along a line, by the law's name."""
        rubbing = (name for name, c in self.page.contacts.items() if c.friction > 0.0)
        return {distinct("contacts", f"{name}_friction", self.page.named): name for name in rubbing}

    @cached_property
    def motors(self) -> tuple[str, ...]:
        """Drives that give a force or torque."""
        return tuple(name for name, drive in self.page.drives.items() if drive.kind != "constant_speed")

    @cached_property
    def tabled(self) -> tuple[str, ...]:
        """Drives by table."""
        return tuple(name for name, drive in self.page.drives.items() if drive.kind == "table")

    @cached_property
    def programs(self) -> dict[str, tuple[float, ...]]:
        """Switching instants (s) of each drive that is a function of time; the last is the period."""
        found: dict[str, tuple[float, ...]] = {}
        for name, drive in self.page.drives.items():
            if drive.kind == "program":
                found[name] = (drive.first_s or 0.5, drive.period_s or 1.0)
            elif drive.table_s_n is not None or drive.table_s_nm is not None:
                found[name] = tuple(instants(drive.rows, drive.period_s or math.inf))
        return found

    @cached_property
    def gases(self) -> tuple[str, ...]:
        """Gas springs."""
        return tuple(name for name, spring in self.page.springs.items() if spring.gas is not None)

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """Springs between points that have a force where these meet, so that none leads beyond."""
        between = ((name, spring) for name, spring in self.page.springs.items() if spring.between is not None)
        return tuple(name for name, spring in between if spring.rate_n_per_m is None or spring.free_m != 0.0)

    @cached_property
    def ports(self) -> dict[str, int]:
        """The gas spring of each port."""
        found: dict[str, int] = {}
        for i, name in enumerate(self.gases):
            gas = self.page.springs[name].gas
            found |= {f"{name}_{port}": i for port in (gas.ports if gas is not None else {})}
        return found

    @cached_property
    def backlashes(self) -> tuple[str, ...]:
        """Names of both ends of the backlash of each coupling."""
        slack = [name for name, coupling in self.page.couplings.items() if coupling.backlash > 0.0]
        return tuple(f"{name}_{end}" for name in slack for end in ("forward", "backward"))

    @cached_property
    def bends(self) -> tuple[str, ...]:
        """Names of the kinks of tables, where a force is not smooth."""
        page, found = self.page, list[str]()
        for name, spring in page.springs.items():
            rows = spring.table_m_n if spring.table_m_n is not None else spring.table_deg_nm
            found += self._bends(name, rows, held=False)
        for name, load in page.loads.items():
            found += self._bends(name, load.resisting if load.over_speed is None else load.over_speed, held=True)
        for name in self.tabled:
            if name not in self.programs:
                found += self._bends(name, page.drives[name].rows, held=True)
        return tuple(found)

    @cached_property
    def resets(self) -> dict[str, int]:
        """The free coordinate of each reset.

        Raises
        ------
        ConfigurationError
            If the joint depends on a loop or has a prescribed speed.
        """
        free = [self.assembly.coordinates[j] for j in self.assembly.split.free]
        for name, reset in self.page.resets.items():
            if reset.joint not in free:
                raise ConfigurationError(
                    f"resets.{name}.joint: '{reset.joint}' follows other joints or a drive; expected one of "
                    f"{', '.join(n for n in free if n in self.page.joints) or 'none, no joint of the page is free'}"
                )
        return {name: free.index(reset.joint) for name, reset in self.page.resets.items()}

    @staticmethod
    def _bends(name: str, rows: Rows | None, *, held: bool) -> list[str]:
        return [] if rows is None else [f"{name}_bend_{i}" for i in range(len(bends_of(rows, held=held)))]

    @cached_property
    def switches(self) -> tuple[str, ...]:
        """Elements with an event function of their own."""
        touched = (*self.compliant, *self.backlashes, *self.layers)
        return (*self.programs, *self.ports, *touched, *self.bends, *self.resets)

    @cached_property
    def worked(self) -> tuple[str, ...]:
        """Elements whose work is integrated besides that of driven coordinates and laws."""
        loads = [name for name, load in self.page.loads.items() if not load.resists]
        shafts = [name for name, coupling in self.page.couplings.items() if coupling.damping > 0.0]
        return (*self.motors, *self.page.dampers, *shafts, *self.gases, *loads, *self.compliant)

    @cached_property
    def driven_names(self) -> tuple[str, ...]:
        """The drive of each driven coordinate."""
        of_joint = {d.joint: name for name, d in self.page.drives.items() if d.kind == "constant_speed"}
        return tuple(of_joint[self.assembly.coordinates[j]] for j in self.assembly.split.driven)

    @cached_property
    def motion(self) -> int:
        """Index in the state where the work integrals begin."""
        return 2 * self.free + self.dependent + 2 * self.driven

    @property
    def books(self) -> tuple[str, ...]:
        """Names of the work integrals in their order in the state; the last are the works of impacts and resets."""
        return (*self.driven_names, *self.worked, *self.laws, distinct("all", "impacts", self.page.named), *self.resets)

    @property
    def state(self) -> int:
        """Length of the state: motion, work integrals, and the gas amount of each gas spring relative to the start."""
        return self.motion + len(self.books) + len(self.gases)

    @property
    def motor_controls(self) -> int:
        """Index in the controls where the drives begin; each has force, its slope by speed, reference speed."""
        return self.driven

    @property
    def switch_controls(self) -> int:
        """Index in the controls where the switches begin; each has regime and time of the next change (s)."""
        return self.motor_controls + 3 * len(self.motors)

    @property
    def found_controls(self) -> int:
        """Index in the controls of the loop's results: accelerations, forces of laws, efforts of driven coordinates."""
        return self.switch_controls + 2 * len(self.switches)

    @property
    def controls(self) -> int:
        """Numbers in the controls."""
        return self.found_controls + self.free + len(self.laws) + self.driven


class StartLengths:
    """Lengths and angles of the springs at the start, where a preload is defined."""

    def __init__(self, places: StatePlaces) -> None:
        self._places = places

    def free(self, spring: SpringElement) -> float:
        """Return the free length, travel (m) or angle (rad) of a spring."""
        if spring.free_m is not None:
            return spring.free_m
        if spring.free_deg is not None:
            return spring.free_deg * DEGREE
        preload = spring.preload_n if spring.preload_n is not None else spring.preload_nm or 0.0
        rate = spring.rate_n_per_m if spring.rate_n_per_m is not None else spring.rate_nm_per_rad or 0.0
        return self.length(spring) + (preload / rate if rate else 0.0)

    def twist(self, coupling: CouplingElement) -> float:
        """Return ratio times the first joint minus the second joint of a coupling at the start (rad or m)."""
        assembly = self._places.assembly
        motion = Kinematics(assembly.structure, assembly.start.tolist())
        first, second = (motion.joint_coordinates(assembly.joint_number(name))[0].value for name in coupling.joints)
        difference = coupling.factor * first - second
        assert isinstance(difference, float | int)
        return float(difference)

    def length(self, spring: SpringElement) -> float:
        """Return length, travel (m) or angle (rad) at the start."""
        assembly = self._places.assembly
        motion = Kinematics(assembly.structure, assembly.start.tolist())
        if spring.joint is not None:
            value = motion.joint_coordinates(assembly.joint_number(spring.joint))[0].value
        else:
            assert spring.between is not None
            first, second = (
                motion.point(assembly.body_number(body), place)
                for body, place in map(assembly.page.point, spring.between)
            )
            value = motion.distance(first, second).value
        assert isinstance(value, float | int)
        return float(value)


def check_lines(page: Page, assembly: Assembly) -> None:
    """Raise if the two points of a spring, damper or distance output coincide at the start.

    Raises
    ------
    ConfigurationError
        If two points coincide.
    """
    motion = Kinematics(assembly.structure, assembly.start.tolist())
    found = {f"springs.{name}.between": spring.between for name, spring in page.springs.items()}
    found |= {f"dampers.{name}.between": damper.between for name, damper in page.dampers.items()}
    found |= {f"outputs.{name}.distance": output.distance for name, output in page.outputs.items()}
    for where, between in found.items():
        if between is None:
            continue
        ends = [motion.point(assembly.body_number(body), at) for body, at in map(page.point, between)]
        apart = math.hypot(float(ends[0].x - ends[1].x), float(ends[0].y - ends[1].y))  # type: ignore[arg-type]
        if apart <= CLOSED * assembly.size_m:
            raise ConfigurationError(
                f"{where}: {between[0]} and {between[1]} coincide at the start, so their line has no direction; "
                "name the joint that slides instead, or move a point"
            )
