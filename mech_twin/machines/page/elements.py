# SPDX-License-Identifier: Apache-2.0
"""The elements of a page: bodies, joints, drives, springs, dampers, friction, contacts, loads, outputs.

A point is named ``body.point``; ``body`` alone is the origin of the body's frame.
"""

import math
import re
from functools import partial
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from mech_twin.declarations.quantity import RANGES, Parameters, choice, quantity
from mech_twin.machines.page.rods import ContactRod
from mech_twin.machines.page.tables import TableRows, TurnRows, table
from mech_twin.parts.induction_motor import InductionMotorParameters, motor_constants

RPM, DEGREE = math.pi / 30.0, math.pi / 180.0
NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


def _plain(name: str) -> str:
    if not NAME.fullmatch(name):
        raise ValueError(f"'{name}' is no name: expected small letters, digits and _, a letter first, at most 40")
    return name


Name = Annotated[str, AfterValidator(_plain)]


def _inside(most: float, vector: tuple[float, float]) -> tuple[float, float]:
    if not all(abs(x) <= most for x in vector):
        raise ValueError(f"expected two numbers up to {most:g}")
    return vector


Vector = Annotated[tuple[float, float], AfterValidator(partial(_inside, RANGES["N"][1]))]
Place = Annotated[tuple[float, float], AfterValidator(partial(_inside, RANGES["m"][1]))]


def vector(unit: str, meaning: str, **options: Any) -> Any:
    """Return the field of two numbers, x and y."""
    return Field(description=meaning, json_schema_extra={"unit": unit, "live": False}, **options)


def only(element: Parameters, kind: str, needed: tuple[str, ...], allowed: tuple[str, ...] = ()) -> None:
    """Refuse an element that lacks a key of its kind, or has one of another kind; at its default that says nothing."""
    given = {key for key in element.model_fields_set if getattr(element, key) is not None}
    fields = type(element).model_fields
    spoken = {key for key in given if getattr(element, key) != fields[key].default}
    for key in needed:
        if key not in given:
            raise ValueError(f"kind {kind} needs the key {key}")
    surplus = sorted(spoken - set(needed) - set(allowed) - {"kind"})
    if surplus:
        usable = ", ".join(sorted({*needed, *allowed}))
        raise ValueError(f"kind {kind} has no key {surplus[0]}; expected {usable}")


def one_of(element: Parameters, *keys: str) -> str:
    """Return which of some keys is given; exactly one must be."""
    given = [key for key in keys if getattr(element, key) is not None]
    if len(given) != 1:
        raise ValueError(f"expected exactly one of {', '.join(keys)}, got {', '.join(given) or 'none'}")
    return given[0]


class Ground(Parameters):
    """What stands still."""

    points_m: dict[Name, Place] = vector("m", "points by name", default={})


class BodyElement(Parameters):
    """A rigid body in its own frame."""

    mass_kg: float = quantity("kg", "mass", default=0.0, ge=0.0)
    inertia_kg_m2: float = quantity("kg m2", "inertia about the centre of mass", default=0.0, ge=0.0)
    centre_m: Place = vector("m", "centre of mass", default=(0.0, 0.0))
    points_m: dict[Name, Place] = vector("m", "points by name", default={})


class JointElement(Parameters):
    """A joint between a point of a body and one of another; start values of the second against the first."""

    kind: Literal["revolute", "slider", "weld", "free"] = choice(
        "a pin, a guide, a firm connection, or none (three freedoms)"
    )
    between: tuple[str, str] = choice("the two points, the first of ground or of the body that carries the joint")
    direction_deg: float | None = quantity(
        "deg", "direction of a guide in the first body's frame", default=None, ge=-360.0, le=360.0
    )
    turned_deg: float | None = quantity(
        "deg", "angle of the second body in the first's frame, of slider and weld", default=None, ge=-360.0, le=360.0
    )
    start_deg: float | None = quantity("deg", "angle at the start, or near it where a loop decides", default=None)
    start_m: float | None = quantity("m", "travel at the start, or near it where a loop decides", default=None)
    start_x_m: float | None = quantity("m", "place of a free body at the start", default=None)
    start_y_m: float | None = quantity("m", "place of a free body at the start", default=None)
    start_rad_per_s: float | None = quantity("rad/s", "angular speed at the start", default=None)
    start_m_per_s: float | None = quantity("m/s", "speed at the start", default=None)
    start_x_m_per_s: float | None = quantity("m/s", "speed of a free body at the start", default=None)
    start_y_m_per_s: float | None = quantity("m/s", "speed of a free body at the start", default=None)

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Self:
        turning = ("start_deg", "start_rad_per_s")
        allowed = {
            "revolute": turning,
            "slider": ("direction_deg", "turned_deg", "start_m", "start_m_per_s"),
            "weld": ("turned_deg",),
            "free": (*turning, "start_x_m", "start_y_m", "start_x_m_per_s", "start_y_m_per_s"),
        }[self.kind]
        only(self, self.kind, ("between",), allowed)
        return self

    def starts(self) -> tuple[float | None, ...]:
        """Return the start of each coordinate (rad, m), None where it is not told."""
        angle = None if self.start_deg is None else self.start_deg * DEGREE
        return {
            "revolute": (angle,), "slider": (self.start_m,), "weld": (), "free": (self.start_x_m, self.start_y_m, angle)
        }[self.kind]  # fmt: skip

    def speeds(self) -> tuple[float | None, ...]:
        """Return the speed of each coordinate at the start, None where it is not told."""
        return {
            "revolute": (self.start_rad_per_s,),
            "slider": (self.start_m_per_s,),
            "weld": (),
            "free": (self.start_x_m_per_s, self.start_y_m_per_s, self.start_rad_per_s),
        }[self.kind]


TABLES = ("table_rpm_nm", "table_m_per_s_n", "table_deg_nm", "table_m_n", "table_s_nm", "table_s_n")


class DriveElement(Parameters):
    """What drives a joint."""

    kind: Literal[
        "constant_speed", "constant_torque", "constant_force", "program", "table", "dc_motor", "induction_motor",
        "unbalance",
    ] = choice("how it drives")  # fmt: skip
    joint: str = choice("joint that it drives; an unbalance has none", default="")
    speed_rpm: float | None = quantity("rpm", "speed of a turning joint at full supply", live=True, default=None)
    speed_m_per_s: float | None = quantity("m/s", "speed of a slider at full supply", live=True, default=None)
    torque_nm: float | None = quantity("N m", "torque at full supply", default=None)
    force_n: float | None = quantity("N", "force at full supply", default=None)
    levels_n: Vector | None = vector("N", "forces of the two phases of a program, of a slider", default=None)
    levels_nm: Vector | None = vector("N m", "torques of the two phases of a program, of a revolute", default=None)
    period_s: float | None = quantity("s", "period of a program", default=None, gt=0.0)
    first_s: float | None = quantity("s", "duration of a program's first phase", default=None, gt=0.0)
    stall_torque_nm: float | None = quantity("N m", "torque of a DC motor at rest", default=None, gt=0.0)
    no_load_speed_rpm: float | None = quantity("rpm", "speed of a DC motor without torque", default=None, gt=0.0)
    rotor_inertia_kg_m2: float | None = quantity("kg m2", "inertia of a DC motor's rotor", default=None, ge=0.0)
    motor: InductionMotorParameters | None = choice("name plate of an induction motor", default=None)
    gear_ratio: float | None = quantity("1", "speed of the motor over that of the joint", default=None)
    gear_efficiency: float | None = quantity(
        "1", "share of the power that the gear passes on, either way", default=None, gt=0.0, le=1.0
    )
    table_rpm_nm: TableRows | None = table("rpm, N m", "torque of the motor over its speed, held beyond", default=None)
    table_m_per_s_n: TableRows | None = table("m/s, N", "force over speed, held beyond", default=None)
    table_deg_nm: TurnRows | None = table(
        "deg, N m", "torque over the angle; of a table of 360 deg each turn", default=None
    )
    table_m_n: TableRows | None = table("m, N", "force over the travel, held beyond", default=None)
    table_s_nm: TableRows | None = table("s, N m", "torque over time, each period anew, or held", default=None)
    table_s_n: TableRows | None = table("s, N", "force over time, each period anew, or held", default=None)
    point: str | None = choice("point of a body on which an unbalance turns", default=None)
    mass_kg: float | None = quantity("kg", "mass of an unbalance, beside that of its body", default=None, gt=0.0)
    radius_m: float | None = quantity("m", "radius of an unbalance", default=None, gt=0.0)
    start_deg: float | None = quantity("deg", "angle of an unbalance at the start", default=None)

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Self:
        needed: dict[str, tuple[str, ...]] = {
            "constant_speed": (),
            "constant_torque": ("torque_nm",),
            "constant_force": ("force_n",),
            "program": ("period_s", "first_s"),
            "table": (),
            "dc_motor": ("stall_torque_nm", "no_load_speed_rpm"),
            "induction_motor": ("motor",),
            "unbalance": ("point", "mass_kg", "radius_m", "speed_rpm"),
        }
        allowed: dict[str, tuple[str, ...]] = {
            "constant_speed": ("speed_rpm", "speed_m_per_s"),
            "program": ("levels_n", "levels_nm"),
            "table": (*TABLES, "period_s", "rotor_inertia_kg_m2", "gear_ratio", "gear_efficiency"),
            "dc_motor": ("rotor_inertia_kg_m2", "gear_ratio", "gear_efficiency"),
            "induction_motor": ("gear_ratio", "gear_efficiency"),
            "unbalance": ("start_deg",),
        }
        own = () if self.kind == "unbalance" else ("joint",)
        only(self, self.kind, (*needed[self.kind], *own), allowed.get(self.kind, ()))
        if self.kind == "constant_speed":
            one_of(self, "speed_rpm", "speed_m_per_s")
        if self.kind == "program":
            one_of(self, "levels_n", "levels_nm")
            assert self.period_s is not None
            assert self.first_s is not None
            if self.first_s >= self.period_s:
                raise ValueError(f"first_s < period_s does not hold: {self.first_s:g} and {self.period_s:g}")
        if self.kind == "table":
            self._check_table(one_of(self, *TABLES))
        if self.gear_ratio == 0.0:
            raise ValueError("gear_ratio must not be 0")
        return self

    def _check_table(self, key: str) -> None:
        rows = getattr(self, key)
        if key.startswith("table_s_"):
            if rows[0][0] < 0.0 or (self.period_s is not None and rows[-1][0] > self.period_s):
                raise ValueError(f"{key}: expected times from 0 to period_s")
        elif self.period_s is not None:
            raise ValueError(f"{key} has no period_s: only a table over time has one")
        if key not in ("table_rpm_nm", "table_deg_nm", "table_s_nm") and self.gear_ratio is not None:
            raise ValueError(f"{key} has no gear_ratio: a slider has none")

    @property
    def rows(self) -> TableRows:
        """The table of a drive by table."""
        return next(rows for rows in (getattr(self, key) for key in TABLES) if rows is not None)

    @property
    def effort_limit(self) -> float:
        """Greatest effort that it can be asked for (N m or N); 0 where it follows a speed, times or a table."""
        if self.kind == "induction_motor" and self.motor is not None:
            return float(motor_constants(self.motor).breakdown_torque_nm)
        given = {"constant_torque": self.torque_nm, "constant_force": self.force_n, "dc_motor": self.stall_torque_nm}
        return abs(given.get(self.kind) or 0.0)

    @property
    def turns(self) -> bool:
        """Whether it drives a turning joint."""
        lengths = (
            self.force_n,
            self.levels_n,
            self.speed_m_per_s,
            self.table_m_per_s_n,
            self.table_m_n,
            self.table_s_n,
        )
        return all(x is None for x in lengths)


class Supply(Parameters):
    """Supply of the drives: what is in force at the start, and how fast it follows the command."""

    initial_fraction: float = quantity("1", "fraction of the supply in force at the start", ge=0.0, le=1.0, default=1.0)
    rate_per_s: float = quantity("1/s", "largest change of the fraction per second", gt=0.0, default=2.0)


class Contact(Parameters):
    """A point of a body on a line of another, or a stop of a joint: rigid, compliant, or a layer; or a wall."""

    point: str | None = choice("point that comes to the line", default=None)
    line: str | None = choice("point on the line, of ground or of another body", default=None)
    normal_deg: float | None = quantity(
        "deg", "direction in which the line pushes, in the frame of its body", default=None, ge=-360.0, le=360.0
    )
    joint: str | None = choice("joint that has a stop", default=None)
    least_m: float | None = quantity("m", "stop at the least travel of a slider", default=None)
    most_m: float | None = quantity("m", "stop at the greatest travel of a slider", default=None)
    least_deg: float | None = quantity("deg", "stop at the least angle of a revolute", default=None)
    most_deg: float | None = quantity("deg", "stop at the greatest angle of a revolute", default=None)
    restitution: float | None = quantity("1", "speed after an impact over that before", default=None, ge=0.0, le=1.0)
    stiffness_n_per_m: float | None = quantity("N/m", "stiffness of a compliant contact", default=None, gt=0.0)
    damping_s_per_m: float = quantity(
        "s/m", "damping d of a compliant contact: its force times (1 + d v)", default=0.0, ge=0.0
    )
    rod: ContactRod | None = choice(
        "rod on a wall that the contact strikes through: the blow is a wave in it, its restitution a result",
        default=None,
    )
    layer_m_n: TableRows | None = table(
        "m, N", "layer: depth from 0 on, and force while it is pressed; none while it is let go", default=None
    )
    gives_way_n: float | None = quantity(
        "N", "wall under a tool, its joint given: it gives way at this force and never comes back", default=None, gt=0.0
    )
    friction: float = quantity(
        "1", "coefficient of Coulomb friction along the line; none within an impact", default=0.0, ge=0.0, le=2.0
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        one_of(self, "point", "joint")
        law = one_of(self, "restitution", "stiffness_n_per_m", "layer_m_n", "gives_way_n", "rod")
        laws = (law, "damping_s_per_m") if law == "stiffness_n_per_m" else (law,)
        if self.layer_m_n is not None and (self.layer_m_n[0][0] != 0.0 or min(f for _, f in self.layer_m_n) < 0.0):
            raise ValueError("layer_m_n: expected depths from 0 on, and forces of 0 or more")
        if law == "gives_way_n":
            only(self, "wall", ("joint", law))
        elif self.point is not None:
            only(self, "point on line", ("point", "line", "normal_deg"), (*laws, "friction"))
        else:
            stop = one_of(self, "least_m", "most_m", "least_deg", "most_deg")
            if self.friction > 0.0:
                raise ValueError("friction: a stop has no line to rub along; expected the keys point and line")
            only(self, "stop", ("joint", stop), laws)
        return self

    @property
    def rigid(self) -> bool:
        """Whether its blows are impulses."""
        return self.restitution is not None or self.rod is not None

    @property
    def turns(self) -> bool | None:
        """Whether it is a stop of a turning joint; None of a point on a line."""
        return None if self.joint is None else self.least_deg is not None or self.most_deg is not None


class LoadElement(Parameters):
    """A constant force or moment on a body, a resistance of a joint, or a force of a joint by its speed."""

    point: str | None = choice("point on which a force acts", default=None)
    force_n: Vector | None = vector("N", "force, in the axes of the machine", default=None)
    body: str | None = choice("body on which a moment acts", default=None)
    torque_nm: float | None = quantity("N m", "moment, counter-clockwise", default=None)
    joint: str | None = choice("joint that is resisted", default=None)
    against_forward_n: float | None = quantity("N", "force against growing travel", live=True, default=None, ge=0.0)
    against_backward_n: float | None = quantity("N", "force against falling travel", live=True, default=None, ge=0.0)
    against_forward_nm: float | None = quantity(
        "N m", "moment against a growing angle", live=True, default=None, ge=0.0
    )
    against_backward_nm: float | None = quantity(
        "N m", "moment against a falling angle", live=True, default=None, ge=0.0
    )
    table_m_n: TableRows | None = table("m, N", "force against the motion, over the travel", default=None)
    table_deg_nm: TurnRows | None = table(
        "deg, N m", "moment against the motion, over the angle; of a table of 360 deg each turn", default=None
    )
    against: Literal["both", "forward", "backward"] | None = choice(
        "the motion that a table over travel or angle resists; both if absent", default=None
    )
    table_m_per_s_n: TableRows | None = table("m/s, N", "force along growing travel, over the speed", default=None)
    table_rpm_nm: TableRows | None = table("rpm, N m", "moment along a growing angle, over the speed", default=None)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        place = one_of(self, "point", "body", "joint")
        if place == "point":
            only(self, "force", ("point", "force_n"))
        elif place == "body":
            only(self, "moment", ("body", "torque_nm"))
        else:
            keys = ("against_forward_n", "against_backward_n", "against_forward_nm", "against_backward_nm")
            tables = ("table_m_n", "table_deg_nm", "table_m_per_s_n", "table_rpm_nm")
            given = [key for key in tables if getattr(self, key) is not None]
            if given:
                one_of(self, *tables)
                by_place = self.resisting is not None
                only(self, given[0], ("joint", given[0]), ("against",) if by_place else ())
                if by_place and min(f for _, f in self.resisting or ()) < 0.0:
                    raise ValueError(f"{given[0]}: a resistance is 0 or more; a force along the motion is a spring's")
                return self
            only(self, "resistance", ("joint",), keys)
            if all(getattr(self, key) is None for key in keys):
                raise ValueError(f"expected one of {', '.join((*keys, *tables))}")
        return self

    @property
    def resisting(self) -> TableRows | None:
        """The table of a resistance over travel or angle."""
        return self.table_m_n if self.table_m_n is not None else self.table_deg_nm

    @property
    def over_speed(self) -> TableRows | None:
        """The table of a force over speed."""
        return self.table_m_per_s_n if self.table_m_per_s_n is not None else self.table_rpm_nm

    @property
    def resists(self) -> bool:
        """Whether it resists a joint, as friction does."""
        return self.joint is not None and self.over_speed is None

    @property
    def turns(self) -> bool:
        """Whether it resists a turning joint."""
        turning = (self.against_forward_nm, self.against_backward_nm, self.table_deg_nm, self.table_rpm_nm)
        return any(x is not None for x in turning)


class Output(Parameters):
    """A number of the motion beside the joints: the position of a point, a distance, an angle."""

    point: str | None = choice("point whose position is reported", default=None)
    distance: tuple[str, str] | None = choice("two points whose distance is reported", default=None)
    angle: tuple[str, str] | None = choice("two bodies: the angle of the second in the first's frame", default=None)

    @model_validator(mode="after")
    def _one(self) -> Self:
        one_of(self, "point", "distance", "angle")
        return self
