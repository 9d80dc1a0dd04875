# SPDX-License-Identifier: Apache-2.0
"""Samples as rows of numbers, declared once for each role: kernel, sample, column of a run and message follow from it.

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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate, chain
from operator import itemgetter
from types import MappingProxyType
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
    Sample,
    Wrench,
)

Array = NDArray[np.float64]
SampleOf = TypeVar("SampleOf", bound=tuple[Any, ...])
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


BODILY = ("position", "velocity", "effort")  # what a joint has three of, and the columns of a message
EFFORT = 2
MARK = "~"  # before the rows of a message that are no joints and no efforts of their own
MOST_REMEMBERED = 256  # a recorder that writes in batches reads them again
NUMBERED = 3  # fields of a sample before its numbers: step, time, names


class RowNumber(NamedTuple):
    """A number of a row: its column in a run, and its row and column in a message."""

    column: str
    row: str
    place: int = 0


def _wrenches(numbers: tuple[float, ...]) -> tuple[Wrench, ...]:
    return tuple(map(Wrench, numbers[::3], numbers[1::3], numbers[2::3]))


@dataclass(frozen=True)
class SampleLayout(Generic[SampleOf]):
    """What the samples of a role hold, in the order of a row: single numbers, threes, named numbers.

    Attributes
    ----------
    kind : type
        The sample.
    scalars : mapping
        Fields that are one number, and what each is where a message does not say: a whole number, a number, or None.
    bodies, threes
        Field that names joints or pins, and what each of them has three of.
    lists : mapping
        Fields of named numbers, and the word before each name; none where the name stands alone.
    place : int
        Column of a message for numbers that are no joint's.
    """

    kind: ClassVar[Any]
    scalars: ClassVar[Mapping[str, float | None]]
    bodies: ClassVar[str] = "joints"
    threes: ClassVar[tuple[str, str, str]] = BODILY
    lists: ClassVar[Mapping[str, str]] = MappingProxyType({})
    place: ClassVar[int] = 0

    @classmethod
    def of(cls, sample: SampleOf) -> tuple[tuple[str, ...], ...]:
        """Return the names in a sample: of joints or pins, then of each list."""
        return (sample[2], *[getattr(sample, name).names for name in cls.lists])

    @classmethod
    def numbers(cls, sample: SampleOf) -> Array:
        """Return a sample as a row."""
        threes = sample[NUMBERED] if cls.bodies == "pins" else zip(*sample[NUMBERED : NUMBERED + 3], strict=True)
        single = [getattr(sample, name) for name in cls.scalars]
        lists = [getattr(sample, name).values for name in cls.lists]
        return np.array([*single, *chain.from_iterable(threes), *chain.from_iterable(lists)], np.float64)

    @cached_property
    def entries(self) -> tuple[RowNumber, ...]:
        """What each number of a row is."""
        found = [RowNumber(name, MARK + name, self.place) for name in self.scalars]
        for body in getattr(self, self.bodies):
            if self.bodies == "pins":
                found += [RowNumber(f"{body}.{what}", f"{body}/{what}", EFFORT) for what in self.threes]
            else:
                found += [RowNumber(f"{body}.{what}", body, place) for place, what in enumerate(self.threes)]
        for (_, word), names in zip(self.lists.items(), self._names[1:], strict=True):
            marked = f"{MARK}{word}/" if word else ""
            found += [RowNumber(f"{word}.{name}" if word else name, marked + name, self.place) for name in names]
        return tuple(found)

    @property
    def size(self) -> int:
        """Numbers in a row."""
        return len(self.entries)

    def sample(self, step: int, time_s: float, row: Sequence[float], *more: Any) -> SampleOf:
        """Return a row (a list) as a sample; ``more`` are its events, or its loads."""
        picked, makes = self._cuts
        parts = [*picked(tuple(row))]
        for place, make in makes:
            parts[place] = make(parts[place])
        made: SampleOf = self.kind(step, time_s, self._names[0], *parts, *more)
        return made

    def of_row(self, step: int, time_s: float, row: Array, *more: Any) -> SampleOf:
        """Return a row that nobody changes any more as a sample, which remembers it; see `sample`."""
        made = self.sample(step, time_s, row.tolist(), *more)
        _remember(made, row)
        return made

    @cached_property
    def _names(self) -> tuple[tuple[str, ...], ...]:
        return tuple(getattr(self, name) for name in (self.bodies, *self.lists))

    @cached_property
    def _cuts(self) -> tuple[Any, list[tuple[int, Any]]]:
        """What picks the fields of a sample from a row (a tuple), and those that are made of what was picked."""
        single = len(self.scalars)
        begin = single + 3 * len(self._names[0])
        ends = [*accumulate(map(len, self._names[1:]), initial=begin)]
        places: dict[str, int | slice] = {name: place for place, name in enumerate(self.scalars)}
        places |= {name: slice(*ends[place : place + 2]) for place, name in enumerate(self.lists)}
        places |= {name: slice(single + place, begin, 3) for place, name in enumerate(BODILY)}
        places["wrenches"] = slice(single, begin)
        makes: dict[str, Any] = {name: int for name, value in self.scalars.items() if isinstance(value, int)}
        makes |= {name: partial(Named, names) for name, names in zip(self.lists, self._names[1:], strict=True)}
        makes["wrenches"] = _wrenches
        fields = [name for name in self.kind._fields[NUMBERED:] if name in places]
        picked = itemgetter(*[places[name] for name in fields])
        return picked, [(place, makes[name]) for place, name in enumerate(fields) if name in makes]


@dataclass(frozen=True)
class _StatefulLayout(SampleLayout[SampleOf]):
    """Row of a sample that has joints, memory and residuals."""

    lists = MappingProxyType({"memory": "memory", "residuals": "residual"})
    joints: tuple[str, ...]
    memory: tuple[str, ...]
    residuals: tuple[str, ...]
    events: EventLayout = EventLayout()


class LinkageLayout(_StatefulLayout[LinkageSample]):
    """Row of a linkage sample."""

    kind = LinkageSample
    scalars = MappingProxyType({"regime": 0, "command": 1.0})


class BodyLayout(_StatefulLayout[BodySample]):
    """Row of a body sample."""

    kind = BodySample
    scalars = MappingProxyType({"regime": 0, "pressing_force_n": None})


@dataclass(frozen=True)
class MotorLayout(SampleLayout[MotorSample]):
    """Row of a motor sample; the effort asked of it is not in it."""

    kind = MotorSample
    scalars = MappingProxyType({"command": 1.0})
    joints: tuple[str, ...]


@dataclass(frozen=True)
class ForceLayout(SampleLayout[ForceSample]):
    """Row of a force sample; ``loads`` are the events a load may stand for, ``reads_events`` whether they matter."""

    kind = ForceSample
    scalars = MappingProxyType({"body_moment_nm": None})
    bodies = "pins"
    threes = Wrench._fields
    lists = MappingProxyType({"quantities": "", "residuals": "residual"})
    place = EFFORT
    pins: tuple[str, ...]
    quantities: tuple[str, ...]
    residuals: tuple[str, ...]
    loads: EventLayout = EventLayout()
    reads_events: bool = False

    def load_rows(self, loads: Sequence[Load]) -> Array:
        """Return loads as a table, (loads, 6)."""
        kinds, contacts = self.loads._kinds, self.loads._contacts
        rows = [(load[0], kinds.index(load.kind), contacts.index(load.contact), *load[3:]) for load in loads]
        return np.array(rows, dtype=float).reshape(len(rows), LOAD_WIDTH)

    def load_samples(self, rows: Array) -> tuple[Load, ...]:
        """Return a table as loads."""
        kinds, contacts = self.loads._kinds, self.loads._contacts
        return tuple(Load(row[0], kinds[int(row[1])], contacts[int(row[2])], *row[3:]) for row in rows.tolist())


LAYOUTS: dict[type, Any] = {
    LinkageSample: LinkageLayout, MotorSample: MotorLayout, ForceSample: ForceLayout, BodySample: BodyLayout
}  # fmt: skip
# rows of the newest samples, which are held so that no other takes their place
_newest: dict[int, tuple[Sample, Array]] = {}
_older: dict[int, tuple[Sample, Array]] = {}


def _remember(sample: Any, row: Array) -> None:
    global _newest, _older
    if len(_newest) >= MOST_REMEMBERED:
        _older, _newest = _newest, {}
    _newest[id(sample)] = sample, row


def row_of(sample: Sample) -> Array:
    """Return a sample as a row, which is not to be changed: several read it."""
    known = _newest.get(id(sample)) or _older.get(id(sample))
    if known is None:
        known = sample, LAYOUTS[type(sample)].numbers(sample)
        _remember(*known)
    return known[1]


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
    def roles(self) -> dict[str, SampleLayout[Any]]:
        """The rows in their order."""
        always: dict[str, SampleLayout[Any]] = {"linkage": self.linkage, "motor": self.motor, "forces": self.forces}
        return always if self.body is None else {**always, "body": self.body}

    @cached_property
    def places(self) -> Places:
        """Where each role's row begins."""
        sizes = [layout.size for layout in self.roles.values()]
        return Places(*accumulate([1, *sizes, *[0] * (len(Places._fields) - 1 - len(sizes))]))

    @cached_property
    def columns(self) -> dict[str, int]:
        """The place of each number by the name of its column."""
        names = [f"{role}.{number.column}" for role, layout in self.roles.items() for number in layout.entries]
        return {name: place for place, name in enumerate(("time_s", *names))}

    @property
    def table_width(self) -> int:
        """Columns of a table that takes the events of linkage and body."""
        return max(self.linkage.events.width, EVENT_WIDTH if self.body is None else self.body.events.width)

    def row(self, frame: Frame) -> Array:
        """Return a frame as a row."""
        return np.concatenate([[frame.linkage.time_s], *[row_of(getattr(frame, role)) for role in self.roles]])

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
