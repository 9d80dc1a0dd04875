# SPDX-License-Identifier: Apache-2.0
"""Samples as rows of numbers, for kernels: where each number of a sample stands, and both ways of conversion.

=========  ==========================================================================================
linkage    regime; command; position, velocity, effort of each joint; memory; residuals
motor      command; position, velocity, effort of each joint
forces     moment on the body; force x, force y, moment of each pin; quantities; residuals
body       regime; pressing force; position, velocity, effort of each joint; memory; residuals
event      a row of an event table: see `EventLayout`
load       time, kind, contact, moment before, moment after, impulse
=========  ==========================================================================================

Step and time are not in a row: a kernel is told the step, and the time is the step times the coupling step.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.coupling import GIVEN_STATE, RESET
from mech_twin.samples import (
    BodySample,
    Coordinate,
    Event,
    ForceSample,
    Frame,
    LinkageSample,
    Load,
    MotorSample,
    Named,
    Wrench,
)

Array = NDArray[np.float64]
Moving = TypeVar("Moving", LinkageSample, BodySample)
# columns of a row of the event table; then position, velocity, effort of each coordinate before, and after
TIME, KIND, CONTACT, PRE_VELOCITY, POST_VELOCITY, IMPULSE, PERIOD, SIDES = range(8)
EVENT_WIDTH = 8
# columns of a row of the loads
LOAD_TIME, LOAD_KIND, LOAD_CONTACT, MOMENT_BEFORE, MOMENT_AFTER, LOAD_IMPULSE = range(6)
LOAD_WIDTH = 6
# rows of the roles: fixed places, and where what each joint, or each pin, has three of begins
REGIME, COMMAND, PRESSING_FORCE = 0, 1, 1
MOTOR_COMMAND, BODY_MOMENT = 0, 0
LINKAGE_JOINTS, MOTOR_JOINTS, BODY_JOINTS, PINS = 2, 1, 2, 1
FEW_ROWS = 8  # of a table at first; a kernel that needs more returns a longer one
RESET_CONTACT = "linkage"


class EventNumbers(NamedTuple):
    """Events as arrays, shape (events,), in time order: step, time (s), kind, velocities (m/s), impulse (N s)."""

    step: NDArray[np.int64]
    time_s: Array
    kind: NDArray[np.str_]
    pre_velocity_m_per_s: Array
    post_velocity_m_per_s: Array
    impulse_ns: Array


@dataclass(frozen=True)
class EventLayout:
    """Kinds and contacts of a role's events by their number in a table, and coordinates on either side of one.

    A row: time (s), kind, contact, velocities before and after (m/s), impulse (N s), period, 1 if the coordinates on
    either side are told; then position, velocity, effort of each coordinate before, and of each after.
    """

    kinds: tuple[str, ...] = ()
    contacts: tuple[str, ...] = ()
    coordinates: int = 0

    @property
    def width(self) -> int:
        """Columns of the table."""
        return EVENT_WIDTH + 6 * self.coordinates

    def table(self, rows: int = FEW_ROWS) -> Array:
        """Return an empty table."""
        return np.empty((rows, self.width))

    def events(self, rows: Array) -> tuple[Event, ...]:
        """Return the events of a table."""
        return tuple(map(self._event, rows.tolist()))

    def _event(self, row: list[float]) -> Event:
        time, kind, contact, before, after, impulse, period, sides = row[:EVENT_WIDTH]
        pre: tuple[Coordinate, ...] = ()
        post = pre
        if sides:
            told = [Coordinate(*row[i : i + 3]) for i in range(EVENT_WIDTH, len(row), 3)]
            pre, post = tuple(told[: self.coordinates]), tuple(told[self.coordinates :])
        return Event(
            time, self._kinds[int(kind)], self._contacts[int(contact)], before, after, impulse, int(period), pre, post
        )

    def kind_names(self, rows: Array) -> NDArray[np.str_]:
        """Return the kinds of a table's events."""
        return np.array(self._kinds)[rows[:, KIND].astype(np.int64)]

    def rows(self, events: Sequence[Event]) -> Array:
        """Return the table of events.

        Raises
        ------
        ValueError
            If an event's kind or contact is none of the role's.
        """
        table = np.zeros((len(events), self.width))
        for row, event in zip(table, events, strict=True):
            kind, contact = self._kinds.index(event.kind), self._contacts.index(event.contact)
            row[:SIDES] = event.time_s, kind, contact, *event[3:7]
            row[SIDES] = bool(event.pre)
            if event.pre:
                row[EVENT_WIDTH:] = [number for side in (*event.pre, *event.post) for number in side]
        return table

    @cached_property
    def _kinds(self) -> tuple[str, ...]:
        return (*self.kinds, RESET)

    @cached_property
    def _contacts(self) -> tuple[str, ...]:
        return (*self.contacts, RESET_CONTACT, GIVEN_STATE)


@dataclass(frozen=True)
class _MovingLayout(Generic[Moving]):
    """Row of a sample that has joints, memory and residuals; ``kind`` is its class, ``second`` the number beside."""

    kind: ClassVar[Any]
    second: ClassVar[str]
    joints: tuple[str, ...]
    memory: tuple[str, ...]
    residuals: tuple[str, ...]
    events: EventLayout = EventLayout()

    @property
    def size(self) -> int:
        """Numbers in a row."""
        return 3 * len(self.joints) + 2 + len(self.memory) + len(self.residuals)

    def names(self) -> list[str]:
        """Return the column of each number, without the name of the role."""
        return [
            "regime", self.second, *_joint_names(self.joints),
            *(f"memory.{name}" for name in self.memory), *(f"residual.{name}" for name in self.residuals),
        ]  # fmt: skip

    def row(self, sample: LinkageSample | BodySample) -> Array:
        """Return a sample as a row."""
        head: tuple[float, float] = (sample.regime, getattr(sample, self.second))
        joints: tuple[float, ...] = tuple(joint_numbers(sample.position, sample.velocity, sample.effort))
        return np.array((*head, *joints, *sample.memory.values, *sample.residuals.values), dtype=float)

    def sample(self, step: int, time_s: float, row: Sequence[float], events: tuple[Event, ...]) -> Moving:
        """Return a row (a list) as a sample."""
        begin = 2 + 3 * len(self.joints)
        end = begin + len(self.memory)
        made: Moving = self.kind(
            step,
            time_s,
            self.joints,
            tuple(row[2:begin:3]),
            tuple(row[3:begin:3]),
            tuple(row[4:begin:3]),
            int(row[0]),
            row[1],
            Named(self.memory, tuple(row[begin:end])),
            Named(self.residuals, tuple(row[end:])),
            events,
        )
        return made


class LinkageLayout(_MovingLayout[LinkageSample]):
    """Row of a linkage sample."""

    kind = LinkageSample
    second = "command"


class BodyLayout(_MovingLayout[BodySample]):
    """Row of a body sample."""

    kind = BodySample
    second = "pressing_force_n"


@dataclass(frozen=True)
class MotorLayout:
    """Row of a motor sample."""

    joints: tuple[str, ...]

    @property
    def size(self) -> int:
        """Numbers in a row."""
        return 3 * len(self.joints) + 1

    def names(self) -> list[str]:
        """Return the column of each number, without the name of the role."""
        return ["command", *_joint_names(self.joints)]

    def row(self, sample: MotorSample) -> Array:
        """Return a sample as a row."""
        return motor_row(sample)

    def sample(self, step: int, time_s: float, row: Sequence[float]) -> MotorSample:
        """Return a row (a list) as a sample."""
        return MotorSample(step, time_s, self.joints, tuple(row[1::3]), tuple(row[2::3]), tuple(row[3::3]), row[0])


@dataclass(frozen=True)
class ForceLayout:
    """Row of a force sample; ``loads`` are the events a load may stand for, ``reads_events`` whether they matter."""

    pins: tuple[str, ...]
    quantities: tuple[str, ...]
    residuals: tuple[str, ...]
    loads: EventLayout = EventLayout()
    reads_events: bool = False

    @property
    def size(self) -> int:
        """Numbers in a row."""
        return 3 * len(self.pins) + len(self.quantities) + 1 + len(self.residuals)

    def names(self) -> list[str]:
        """Return the column of each number, without the name of the role."""
        wrenches = [f"{pin}.{name}" for pin in self.pins for name in Wrench._fields]
        return ["body_moment_nm", *wrenches, *self.quantities, *(f"residual.{name}" for name in self.residuals)]

    def row(self, sample: ForceSample) -> Array:
        """Return a sample as a row."""
        pins = [number for wrench in sample.wrenches for number in wrench]
        quantities, residuals = sample.quantities.values, sample.residuals.values
        return np.array((sample.body_moment_nm, *pins, *quantities, *residuals), dtype=float)

    def sample(self, step: int, time_s: float, row: Sequence[float], loads: tuple[Load, ...]) -> ForceSample:
        """Return a row (a list) as a sample."""
        begin = 1 + 3 * len(self.pins)
        end = begin + len(self.quantities)
        return ForceSample(
            step,
            time_s,
            self.pins,
            tuple(map(Wrench, row[1:begin:3], row[2:begin:3], row[3:begin:3])),
            Named(self.quantities, tuple(row[begin:end])),
            row[0],
            Named(self.residuals, tuple(row[end:])),
            loads,
        )

    def load_rows(self, loads: Sequence[Load]) -> Array:
        """Return loads as a table, (loads, 6)."""
        kinds, contacts = self.loads._kinds, self.loads._contacts
        rows = [(load[0], kinds.index(load.kind), contacts.index(load.contact), *load[3:]) for load in loads]
        return np.array(rows, dtype=float).reshape(len(rows), LOAD_WIDTH)

    def load_samples(self, rows: Array) -> tuple[Load, ...]:
        """Return a table as loads."""
        kinds, contacts = self.loads._kinds, self.loads._contacts
        return tuple(Load(row[0], kinds[int(row[1])], contacts[int(row[2])], *row[3:]) for row in rows.tolist())


class Places(NamedTuple):
    """Where the rows of the roles begin in the row of a frame, after the time at 0; ``end`` is its length."""

    linkage: int
    motor: int
    forces: int
    body: int
    end: int


@dataclass(frozen=True)
class FrameLayout:
    """Row of a frame: the time (s), then the rows of linkage, motor, forces and, where there is one, body."""

    linkage: LinkageLayout
    motor: MotorLayout
    forces: ForceLayout
    body: BodyLayout | None = None

    @cached_property
    def places(self) -> Places:
        """Where each role's row begins."""
        motor = 1 + self.linkage.size
        forces = motor + self.motor.size
        body = forces + self.forces.size
        return Places(1, motor, forces, body, body + (0 if self.body is None else self.body.size))

    @cached_property
    def columns(self) -> dict[str, int]:
        """The place of each number by the name of its column."""
        told = {"linkage": self.linkage.names(), "motor": self.motor.names(), "forces": self.forces.names()}
        if self.body is not None:
            told["body"] = self.body.names()
        names = [f"{role}.{name}" for role, of_role in told.items() for name in of_role]
        return {name: place for place, name in enumerate(("time_s", *names))}

    @property
    def table_width(self) -> int:
        """Columns of a table that takes the events of linkage and body."""
        return max(self.linkage.events.width, EVENT_WIDTH if self.body is None else self.body.events.width)

    def row(self, frame: Frame) -> Array:
        """Return a frame as a row."""
        rows = [np.array([frame.linkage.time_s]), self.linkage.row(frame.linkage), self.motor.row(frame.motor)]
        rows.append(self.forces.row(frame.forces))
        if self.body is not None and frame.body is not None:
            rows.append(self.body.row(frame.body))
        return np.concatenate(rows)

    def frame(
        self,
        step: int,
        row: Sequence[float],
        events: tuple[Event, ...] = (),
        body_events: tuple[Event, ...] = (),
        loads: tuple[Load, ...] = (),
    ) -> Frame:
        """Return a row (a list) as a frame."""
        at, time_s = self.places, row[0]
        body = None
        if self.body is not None:
            body = self.body.sample(step, time_s, row[at.body :], body_events)
        return Frame(
            self.linkage.sample(step, time_s, row[1 : at.motor], events),
            self.motor.sample(step, time_s, row[at.motor : at.forces]),
            self.forces.sample(step, time_s, row[at.forces : at.body], loads),
            body,
        )


def joint_numbers(position: Sequence[float], velocity: Sequence[float], effort: Sequence[float]) -> Iterable[float]:
    """Return position, velocity and effort of each joint in turn."""
    return chain.from_iterable(zip(position, velocity, effort, strict=True))


def motion_row(sample: LinkageSample) -> Array:
    """Return a linkage sample as a row without its residuals: what motor and force analysis read."""
    joints = joint_numbers(sample.position, sample.velocity, sample.effort)
    return np.array((sample.regime, sample.command, *joints, *sample.memory.values), dtype=float)


def motor_row(sample: MotorSample) -> Array:
    """Return a motor sample as a row."""
    return np.array((sample.command, *joint_numbers(sample.position, sample.velocity, sample.effort)), dtype=float)


def body_row(sample: BodySample) -> Array:
    """Return a body sample as a row without memory and residuals: what a linkage reads."""
    joints = joint_numbers(sample.position, sample.velocity, sample.effort)
    return np.array((sample.regime, sample.pressing_force_n, *joints), dtype=float)


def _joint_names(joints: Iterable[str]) -> list[str]:
    """Return the column of each joint's number."""
    return [f"{joint}.{kind}" for joint in joints for kind in ("position", "velocity", "effort")]
