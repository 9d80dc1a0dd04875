# SPDX-License-Identifier: Apache-2.0
"""A page: a planar machine with names of its user's, and what its elements are joined to."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from functools import cached_property
from typing import Self

from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, choice, quantity
from mech_twin.engine.coupling import Coupling
from mech_twin.machines.page.elements import (
    BodyElement,
    Contact,
    DriveElement,
    Ground,
    JointElement,
    LoadElement,
    Name,
    Output,
    Supply,
    Vector,
    vector,
)
from mech_twin.machines.page.force_elements import CouplingElement, Damper, FrictionElement, Reset, SpringElement

GROUND = "ground"
MOST_BODIES, MOST_ELEMENTS = 30, 60
GROUPS = ("joints", "couplings", "drives", "springs", "dampers", "friction", "contacts", "loads", "resets", "outputs")
USUAL_STEP_S = 0.001
DOWN = (0.0, -9.80665)


def distinct(whose: str, name: str, taken: Container[str]) -> str:
    """Return a name that is not taken: the name itself, or with ``whose`` before it."""
    while name in taken:
        name = f"{whose}_{name}"
    return name


class Page(Parameters):
    """A planar machine from a page."""

    name: Name = choice("name of the machine", default="page")
    gravity_m_per_s2: Vector = vector("m/s2", "gravity, x and y", default=DOWN)
    ground: Ground = choice("what stands still", default=Ground())
    bodies: dict[Name, BodyElement] = choice("rigid bodies by name")
    joints: dict[Name, JointElement] = choice("joints by name")
    couplings: dict[Name, CouplingElement] = choice("elastic shafts, gears, belts and racks by name", default={})
    drives: dict[Name, DriveElement] = choice("drives by name", default={})
    supply: Supply = choice("supply of the drives", default=Supply())
    springs: dict[Name, SpringElement] = choice("springs by name", default={})
    dampers: dict[Name, Damper] = choice("dampers by name", default={})
    friction: dict[Name, FrictionElement] = choice("friction by name", default={})
    contacts: dict[Name, Contact] = choice("contacts and stops by name", default={})
    loads: dict[Name, LoadElement] = choice("loads by name", default={})
    resets: dict[Name, Reset] = choice("joints that are again as they start, by name", default={})
    outputs: dict[Name, Output] = choice("outputs by name", default={})
    coupling: Coupling = choice("coupling of the roles", default=Coupling(step_s=USUAL_STEP_S))
    settle_s: float = quantity("s", "time from the start that the numbers of a run leave out", default=0.0, ge=0.0)

    @model_validator(mode="after")
    def _of_a_size(self) -> Self:
        if GROUND in self.bodies:
            raise ValueError("bodies.ground: the ground is there already; its points stand under ground.points_m")
        if not self.bodies:
            raise ValueError("bodies: expected at least one body")
        if len(self.bodies) > MOST_BODIES:
            raise ValueError(f"bodies: expected at most {MOST_BODIES}, got {len(self.bodies)}")
        for group, elements in self.groups():
            if len(elements) > MOST_ELEMENTS:
                raise ValueError(f"{group}: expected at most {MOST_ELEMENTS}, got {len(elements)}")
        seen = {name: f"bodies.{name}" for name in self.bodies}
        for group, elements in self.groups():
            for name in elements:
                if name in seen:
                    raise ValueError(f"{group}.{name}: {seen[name]} has the same name; each element has its own")
                seen[name] = f"{group}.{name}"
        for where, name in self._derived_names():
            if name in seen:
                raise ValueError(f"{seen[name]}: a number of {where} has this name; expected another")
        return self

    def _derived_names(self) -> Iterator[tuple[str, str]]:
        """Yield the names that elements give to numbers of their own, with the element."""
        ends: dict[str, dict[str, tuple[str, ...]]] = {
            "joints": {name: ("x", "y", "angle") for name, joint in self.joints.items() if joint.kind == "free"},
            "outputs": {name: ("x", "y") for name, output in self.outputs.items() if output.point is not None},
            "springs": {name: tuple(s.gas.ports) for name, s in self.springs.items() if s.gas is not None},
            "couplings": {name: ("forward", "backward") for name, c in self.couplings.items() if c.backlash > 0.0},
        }
        for group, elements in ends.items():
            for name, parts in elements.items():
                yield from ((f"{group}.{name}", f"{name}_{part}") for part in parts)

    @model_validator(mode="after")
    def _joined_to_what_is_there(self) -> Self:
        for where, point in self._points():
            self.check_point(where, point)
        for group, elements in self.groups():
            for name, element in elements.items():
                joint = getattr(element, "joint", None)
                if joint is not None and getattr(element, "kind", "") != "unbalance":
                    self._check_joint(f"{group}.{name}.joint", joint, element)
        for name, drive in self.drives.items():
            others = [other for other, d in self.drives.items() if d.joint == drive.joint and other != name]
            if others and drive.kind == "constant_speed":
                raise ValueError(
                    f"drives.{name}.joint: '{drive.joint}' has a given speed already and cannot be driven by "
                    f"drives.{others[0]} too"
                )
        self._check_names_inside()
        self._check_what_moves()
        return self

    def _check_what_moves(self) -> None:
        """Refuse a joint, spring, damper or contact of a body with itself, and a load on the ground."""
        for group in ("joints", "springs", "dampers"):
            for name, element in getattr(self, group).items():
                bodies = {point.partition(".")[0] for point in element.between or ()}
                if len(bodies) == 1:
                    raise ValueError(f"{group}.{name}.between: both points are of {bodies.pop()}; expected two bodies")
        for name, contact in self.contacts.items():
            ends = [point.partition(".")[0] for point in (contact.point, contact.line) if point is not None]
            if len(ends) == 2 and ends[0] == ends[1]:
                raise ValueError(f"contacts.{name}: point and line are of {ends[0]}; expected two bodies")
        for name, load in self.loads.items():
            if GROUND in (load.body, (load.point or "").partition(".")[0]):
                raise ValueError(f"loads.{name}: acts on the ground, which stands still; expected a body")

    def _check_names_inside(self) -> None:
        """Refuse joints and bodies that stand deeper in an element and are not there."""
        for name, contact in self.contacts.items():
            if contact.rod is not None:
                self._check_rod(f"contacts.{name}", contact)
        for name, coupling in self.couplings.items():
            for joint, turns in zip(coupling.joints, (True, not coupling.slides), strict=True):
                self._check_joint(f"couplings.{name}.joints", joint, coupling, turns=turns)
            if coupling.joints[0] == coupling.joints[1]:
                raise ValueError(f"couplings.{name}.joints: '{coupling.joints[0]}' stands twice; expected two joints")
        for name, spring in self.springs.items():
            for port, opening in (spring.gas.ports if spring.gas is not None else {}).items():
                self._check_joint(f"springs.{name}.gas.ports.{port}.joint", opening.joint, opening, turns=False)
        for name, load in self.loads.items():
            if load.body is not None:
                self._check_body(f"loads.{name}.body", load.body)
        for name, reset in self.resets.items():
            self._check_revolute(f"resets.{name}.by", reset.by)
        for name, output in self.outputs.items():
            for body in output.angle or ():
                self._check_body(f"outputs.{name}.angle", body)

    @cached_property
    def named(self) -> frozenset[str]:
        """Names of all bodies and elements."""
        return frozenset((*self.bodies, *(name for _, elements in self.groups() for name in elements)))

    @cached_property
    def expanded(self) -> Page:
        """The page with a body and a joint for each unbalance: a mass on an arm that a constant speed turns."""
        shaken = {name: drive for name, drive in self.drives.items() if drive.kind == "unbalance"}
        if not shaken:
            return self
        bodies, joints, drives = dict(self.bodies), dict(self.joints), dict(self.drives)
        for name, drive in shaken.items():
            mass, shaft = (distinct("drives", f"{name}_{part}", self.named) for part in ("mass", "shaft"))
            bodies[mass] = BodyElement(mass_kg=drive.mass_kg or 0.0, centre_m=(drive.radius_m or 0.0, 0.0))
            joints[shaft] = JointElement(
                kind="revolute", between=(drive.point or "", mass), start_deg=drive.start_deg or 0.0
            )
            drives[name] = DriveElement(kind="constant_speed", joint=shaft, speed_rpm=drive.speed_rpm)
        there = {key: getattr(self, key) for key in type(self).model_fields}
        return Page(**there | {"bodies": bodies, "joints": joints, "drives": drives})

    def groups(self) -> Iterator[tuple[str, Mapping[str, Parameters]]]:
        """Yield the groups of elements that are joined to others."""
        for group in GROUPS:
            yield group, getattr(self, group)

    def _check_rod(self, where: str, contact: Contact) -> None:
        """Refuse a rod that does not stand on the ground, or that a turning joint strikes."""
        if contact.line is not None:
            if self.point(contact.line)[0] != GROUND:
                raise ValueError(f"{where}.line: '{contact.line}' moves; a rod stands on the ground")
        elif contact.joint is not None:
            if contact.turns:
                raise ValueError(f"{where}.rod: '{contact.joint}' turns; expected a slider, or a point on a line")
            if GROUND not in (self.point(point)[0] for point in self.joints[contact.joint].between):
                raise ValueError(f"{where}.rod: no body of '{contact.joint}' is the ground; a rod stands on it")

    def _points(self) -> Iterator[tuple[str, str]]:
        for group, elements in self.groups():
            for name, element in elements.items():
                for key in ("between", "distance"):
                    for point in getattr(element, key, None) or ():
                        yield f"{group}.{name}.{key}", point
                for key in ("point", "line"):
                    point = getattr(element, key, None)
                    if point is not None:
                        yield f"{group}.{name}.{key}", point

    def _check_body(self, where: str, body: str) -> None:
        if body != GROUND and body not in self.bodies:
            raise ValueError(f"{where}: no body '{body}'; expected one of {', '.join((GROUND, *self.bodies))}")

    def check_point(self, where: str, point: str) -> None:
        """Refuse a point that no body has."""
        body, dot, name = point.partition(".")
        self._check_body(where, body)
        there = self.ground.points_m if body == GROUND else self.bodies[body].points_m
        if dot and name not in there:
            known = ", ".join(there) or f"none; write it under {body}.points_m"
            raise ValueError(f"{where}: {body} has no point '{name}'; expected one of {known}")

    def _check_joint(self, where: str, name: str, element: Parameters, *, turns: bool | None = None) -> None:
        if name not in self.joints:
            raise ValueError(f"{where}: no joint '{name}'; expected one of {', '.join(self.joints)}")
        kind = self.joints[name].kind
        if kind not in ("revolute", "slider"):
            raise ValueError(f"{where}: '{name}' is of kind {kind}; expected a revolute or a slider")
        if turns is not None and turns != (kind == "revolute"):
            raise ValueError(f"{where}: '{name}' is a {kind}; expected a {'revolute' if turns else 'slider'} there")
        turns = getattr(element, "turns", None) if turns is None else turns
        if turns is not None and turns != (kind == "revolute"):
            unit = "rpm, deg, or N m" if kind == "revolute" else "m, m/s, or N"
            raise ValueError(f"{where}: '{name}' is a {kind}; expected keys in {unit}")

    def _check_revolute(self, where: str, name: str) -> None:
        there = [joint for joint, element in self.joints.items() if element.kind == "revolute"]
        if name not in there:
            raise ValueError(f"{where}: no revolute '{name}'; expected one of {', '.join(there) or 'none'}")

    def point(self, name: str) -> tuple[str, tuple[float, float]]:
        """Return the body of a point and its place in the body's frame."""
        body, dot, point = name.partition(".")
        there = self.ground.points_m if body == GROUND else self.bodies[body].points_m
        return body, there[point] if dot else (0.0, 0.0)
