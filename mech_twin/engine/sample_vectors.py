# SPDX-License-Identifier: Apache-2.0
"""Samples as rows of numbers: one layout for each role defines kernel arguments, sample, run columns and message.

=========  ==========================================================================================
linkage    regime; command; position, velocity, effort of each joint; memory; residuals
motor      command; position, velocity, effort of each joint
forces     moment on the body; force x, force y, moment of each pin; quantities; residuals
body       regime; pressing force; position, velocity, effort of each joint; memory; residuals
event      a row of an event table: see `EventLayout`
load       time, kind, contact, moment before, moment after, impulse
=========  ==========================================================================================

Step and time are not in a row: a kernel gets the step, and the time is the step times the coupling step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate, chain
from operator import itemgetter
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar, get_type_hints

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
Made = TypeVar("Made")
SampleOf = TypeVar("SampleOf", bound=tuple[Any, ...])
# columns of a row of the event table; then position, velocity, effort of each coordinate before, and after
TIME, KIND, CONTACT, PRE_VELOCITY, POST_VELOCITY, IMPULSE, PERIOD, SIDES = range(8)
EVENT_WIDTH = 8
# columns of a row of the loads
LOAD_TIME, LOAD_KIND, LOAD_CONTACT, MOMENT_BEFORE, MOMENT_AFTER, LOAD_IMPULSE = range(6)
LOAD_WIDTH = 6
# rows of the roles: fixed indices, and where the threes of numbers of the joints or pins begin
REGIME, COMMAND, PRESSING_FORCE = 0, 1, 1
MOTOR_COMMAND, BODY_MOMENT = 0, 0
LINKAGE_JOINTS, MOTOR_JOINTS, BODY_JOINTS, PINS = 2, 1, 2, 1
FEW_ROWS = 8  # initial length of a table; a kernel that needs more returns a longer one
RESET_CONTACT = "linkage"


class EventNumbers(NamedTuple):
    """Events as arrays, shape (events,), in time order: step, time (s), kind, velocities (m/s), impulse (N s)."""

    step: NDArray[np.int64]
    time_s: Array
    kind: NDArray[np.str_]
    pre_velocity_m_per_s: Array
    post_velocity_m_per_s: Array
    impulse_ns: Array


def threes(make: Callable[[float, float, float], Made], numbers: Sequence[float]) -> tuple[Made, ...]:
    """Return the objects made from consecutive triples of numbers."""
    return tuple(map(make, numbers[::3], numbers[1::3], numbers[2::3]))


def event_of(kind: str, contact: str, before: int, numbers: Sequence[float]) -> Event:
    """Return an event from its numbers in the order of its fields; the first ``before`` coordinates are before it."""
    time_s, pre, post, impulse, period, *coordinates = numbers
    sides = threes(Coordinate, coordinates)
    return Event(time_s, kind, contact, pre, post, impulse, int(period), sides[:before], sides[before:])


def load_of(kind: str, contact: str, numbers: Sequence[float]) -> Load:
    """Return a load from its numbers in the order of its fields."""
    return Load(numbers[0], kind, contact, *numbers[1:])


@dataclass(frozen=True)
class EventLayout:
    """Event table of a role: its kinds and contacts by number, and how many coordinates an event gives.

    A row: time (s), kind, contact, velocities before and after (m/s), impulse (N s), period, 1 if coordinates are
    given; then position, velocity, effort of each coordinate before the event, and of each after.  A row of the
    loads caused by such events: time (s), kind, contact, moments before and after (N m), impulse (N m s).
    """

    kinds: tuple[str, ...] = ()
    contacts: tuple[str, ...] = ()
    coordinates: int = 0

    @property
    def width(self) -> int:
        """Columns of the table."""
        return EVENT_WIDTH + 6 * self.coordinates

    def table(self) -> Array:
        """Return a table with room for a few events."""
        return np.empty((FEW_ROWS, self.width))

    def events(self, rows: Array) -> tuple[Event, ...]:
        """Return the events of a table."""
        return tuple(map(self._event, rows.tolist()))

    def _event(self, row: list[float]) -> Event:
        sides = row[EVENT_WIDTH:] if row[SIDES] else []
        return event_of(*self._names(row), self.coordinates, [row[TIME], *row[PRE_VELOCITY:SIDES], *sides])

    def loads(self, rows: Array) -> tuple[Load, ...]:
        """Return the loads of a table."""
        return tuple(load_of(*self._names(row), [row[0], *row[3:]]) for row in rows.tolist())

    def _names(self, row: Sequence[float]) -> tuple[str, str]:
        return self._kinds[int(row[KIND])], self._contacts[int(row[CONTACT])]

    def kind_names(self, rows: Array) -> NDArray[np.str_]:
        """Return the kinds of a table's events."""
        return np.array(self._kinds)[rows[:, KIND].astype(np.int64)]

    def rows(self, entries: Sequence[Event] | Sequence[Load]) -> Array:
        """Return the table of at least one event, or load.

        Raises
        ------
        ValueError
            If the role has no such kind or contact.
        """
        table = []
        for one in entries:
            row = [one.time_s, self._kinds.index(one.kind), self._contacts.index(one.contact), *one[3:7]]
            if isinstance(one, Event):
                row += [1.0, *chain(*one.pre, *one.post)] if one.pre else [0.0] * (self.width - SIDES)
            table.append(row)
        return np.array(table, np.float64)

    @cached_property
    def _kinds(self) -> tuple[str, ...]:
        return (*self.kinds, RESET)

    @cached_property
    def _contacts(self) -> tuple[str, ...]:
        return (*self.contacts, RESET_CONTACT, GIVEN_STATE)


BODILY = ("position", "velocity", "effort")  # numbers of a joint, and columns of a message
EFFORT = 2
MARK = "~"  # prefix of the rows of a message that are no joints
MOST_REMEMBERED = 1024  # a recorder that writes in batches reads them again
NUMBERED = 3  # fields of a sample before its numbers: step, time, names
WORDS = {"memory": "memory", "quantities": "", "residuals": "residual"}  # before each name of a list
LAYOUTS: dict[type, Any] = {}  # of the samples of a role


class RowNumber(NamedTuple):
    """A number of a row: its column name in a run, and its row and column in a message."""

    column: str
    row: str
    place: int


@dataclass(frozen=True)
class SampleLayout(Generic[SampleOf]):
    """Layout of the samples of a role as a row: scalars, triples of each joint or pin, named numbers.

    Each subclass belongs to one type of sample (``kind``), whose fields give its scalars (``scalars``) and its lists
    of named numbers (``lists``).

    Attributes
    ----------
    bodies : tuple of str
        Names of the joints, or pins, each with the three numbers ``threes``.
    named, residuals : tuple of str
        Names in the memory, or of the quantities, and of the residuals.
    events : EventLayout
        Table of the role's events, or of the events that cause its loads.
    """

    kind: ClassVar[Any]
    scalars: ClassVar[tuple[str, ...]]
    lists: ClassVar[tuple[str, ...]]
    of_pins: ClassVar[bool]
    threes: ClassVar[tuple[str, ...]]
    bodies: tuple[str, ...]
    named: tuple[str, ...] = ()
    residuals: tuple[str, ...] = ()
    events: EventLayout = EventLayout()

    def __init_subclass__(cls, kind: Any, **more: Any) -> None:
        super().__init_subclass__(**more)
        fields = [*get_type_hints(kind).items()][NUMBERED:]
        cls.kind, cls.of_pins = kind, "pins" in kind._fields
        cls.scalars = tuple(name for name, of in fields if of in (int, float))
        cls.lists = tuple(name for name, of in fields if of is Named)
        cls.threes = Wrench._fields if cls.of_pins else BODILY
        LAYOUTS[kind] = cls

    @classmethod
    def of(cls, sample: SampleOf) -> tuple[tuple[str, ...], ...]:
        """Return the names in a sample: of joints or pins, then of each list."""
        return (sample[2], *[getattr(sample, name).names for name in cls.lists])

    @classmethod
    def numbers(cls, sample: SampleOf) -> Array:
        """Return a sample as a row."""
        bodily = sample[NUMBERED] if cls.of_pins else zip(*sample[NUMBERED : NUMBERED + 3], strict=True)
        single = [getattr(sample, name) for name in cls.scalars]
        lists = [getattr(sample, name).values for name in cls.lists]
        return np.array([*single, *chain.from_iterable(bodily), *chain.from_iterable(lists)], np.float64)

    @cached_property
    def entries(self) -> tuple[RowNumber, ...]:
        """Description of each number of a row."""
        place = EFFORT if self.of_pins else 0
        found = [RowNumber(name, MARK + name, place) for name in self.scalars]
        for body in self.bodies:
            for column, what in enumerate(self.threes):
                row = (f"{body}/{what}", EFFORT) if self.of_pins else (body, column)
                found.append(RowNumber(f"{body}.{what}", *row))
        for field, names in zip(self.lists, (self.named, self.residuals), strict=False):
            word = WORDS[field]
            marked = f"{MARK}{word}/" if word else ""
            found += [RowNumber(f"{word}.{name}" if word else name, marked + name, place) for name in names]
        return tuple(found)

    @property
    def size(self) -> int:
        """Numbers in a row."""
        return len(self.entries)

    def sample(self, step: int, time_s: float, row: Sequence[float], *more: Any) -> SampleOf:
        """Return a sample from a row (a list); ``more`` are its events, or its loads."""
        picked, makes = self._cuts
        parts = [*picked(tuple(row))]
        for place, make in makes:
            parts[place] = make(parts[place])
        made: SampleOf = self.kind(step, time_s, self.bodies, *parts, *more)
        return made

    def of_row(self, step: int, time_s: float, row: Array, *more: Any) -> SampleOf:
        """Return a sample as `sample` does, and cache its row, which must not be changed afterwards."""
        made = self.sample(step, time_s, row.tolist(), *more)
        _remember(made, row)
        return made

    @cached_property
    def _cuts(self) -> tuple[Any, list[tuple[int, Any]]]:
        """Getter of a sample's fields from a row (a tuple), and the constructors of its compound fields."""
        single = len(self.scalars)
        begin = single + 3 * len(self.bodies)
        end = begin + len(self.named)
        cuts: dict[str, tuple[int | slice, Any]] = {name: (place, None) for place, name in enumerate(self.scalars)}
        cuts["regime"] = REGIME, int
        cuts |= {name: (slice(single + place, begin, 3), None) for place, name in enumerate(BODILY)}
        cuts["wrenches"] = slice(single, begin), partial(threes, Wrench)
        cuts["memory"] = cuts["quantities"] = slice(begin, end), partial(Named, self.named)
        cuts["residuals"] = slice(end, end + len(self.residuals)), partial(Named, self.residuals)
        found = [cuts[name] for name in self.kind._fields[NUMBERED:] if name in cuts]
        return itemgetter(*[cut for cut, _ in found]), [(at, make) for at, (_, make) in enumerate(found) if make]


class LinkageLayout(SampleLayout[LinkageSample], kind=LinkageSample):
    """Row of a linkage sample."""


class MotorLayout(SampleLayout[MotorSample], kind=MotorSample):
    """Row of a motor sample; the effort asked of it is not in it."""


@dataclass(frozen=True)
class ForceLayout(SampleLayout[ForceSample], kind=ForceSample):
    """Row of a force sample; ``reads_events`` says whether the linkage's events matter."""

    reads_events: bool = False


class BodyLayout(SampleLayout[BodySample], kind=BodySample):
    """Row of a body sample."""


# rows of the newest samples, by id; the samples are kept alive so that an id stays unique
_remembered: dict[int, tuple[Sample, Array]] = {}


def _remember(sample: Any, row: Array) -> None:
    if len(_remembered) >= MOST_REMEMBERED:
        _remembered.clear()
    _remembered[id(sample)] = sample, row


def row_of(sample: Sample) -> Array:
    """Return a sample as a row, which is shared and must not be changed."""
    known = _remembered.get(id(sample))
    if known is None:
        known = sample, LAYOUTS[type(sample)].numbers(sample)
        _remember(*known)
    return known[1]


class Places(NamedTuple):
    """Indices where the rows of the roles begin in the row of a frame, whose first number is the time; its length."""

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
        return {name: role for name in Frame._fields if (role := getattr(self, name)) is not None}

    @cached_property
    def places(self) -> Places:
        """Where each role's row begins."""
        sizes = [self.roles[name].size if name in self.roles else 0 for name in Frame._fields]
        return Places(*accumulate(sizes, initial=1))

    @cached_property
    def columns(self) -> dict[str, int]:
        """Index of each number by the name of its column."""
        names = [f"{role}.{number.column}" for role, layout in self.roles.items() for number in layout.entries]
        return {name: place for place, name in enumerate(("time_s", *names))}

    def row(self, frame: Frame) -> Array:
        """Return a frame as a row."""
        return np.concatenate([[frame.linkage.time_s], *[row_of(getattr(frame, role)) for role in self.roles]])

    def frame(
        self, step: int, row: Sequence[float], events: tuple[Event, ...] = (), body_events: tuple[Event, ...] = ()
    ) -> Frame:
        """Return a frame from a row (a list)."""
        cuts = zip(self.roles.values(), self.places, self.places[1:], ((events,), (), (), (body_events,)), strict=False)
        samples = [role.sample(step, row[0], row[begin:end], *more) for role, begin, end, more in cuts]
        return Frame(*samples, *[None] * (len(Frame._fields) - len(samples)))
