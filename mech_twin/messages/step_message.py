# SPDX-License-Identifier: Apache-2.0
"""The step message: one complete sample as the named rows of a sensor_msgs/JointState, and rows that nodes add.

A publishing node adds its source number, and a mark of the configuration that the sample was computed with.

Samples become step messages by the layouts of `engine.sample_vectors`: ``linkage``, ``motor``, ``force``, ``body``.

Rows of joints, or of pins and derived quantities, come first with their own names.  Other content of a sample follows
in rows whose names begin with ``~``, so that a reader can filter the joints by name; then events or loads, and rows
added by the publishing node.  Every number is transmitted as the same float64.  The index of each number is computed
once for the row names of a stream.
"""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from itertools import groupby
from operator import itemgetter
from typing import Any, Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mech_twin.engine.sample_vectors import (
    BODILY,
    LAYOUTS,
    MARK,
    WORDS,
    Array,
    SampleLayout,
    SampleOf,
    event_of,
    load_of,
    row_of,
)
from mech_twin.engine.trajectory import FIELDS
from mech_twin.messages.cdr import HEAD, STAMP, AnyStep, received_message, row_layout, stamp_of
from mech_twin.messages.topics import (
    BODY_JOINT_STATES,
    FORCE_JOINT_STATES,
    JOINT_STATES,
    MOTOR_JOINT_STATES,
    STEP_BODY,
    STEP_FORCES,
    STEP_LINKAGE,
    STEP_MOTOR,
    Topic,
)
from mech_twin.samples import BodySample, EffortCommand, Event, ForceSample, LinkageSample, Load, MotorSample, Sample

STEP = "~step"
REVISION = "~revision"
TARGET = "~target"
ASKED = "~asked"
HELD = "~held"
SOURCE = "~source"
EVENT = "~event/"
LOAD = "~load/"
LARGEST_STEP = 2.0**53
SHOWN_NAMES = 6
ANONYMOUS = 0.0  # source number of unsigned messages
Names = tuple[str, ...]
Indices = NDArray[np.int64]
ABSENT = {"~regime": 0.0, "~command": 1.0}  # defaults of rows that a message lacks
LOAD_COLUMNS = (Load._fields[0], *Load._fields[3:])
Numbers = Sequence[float]


class MessageError(ValueError):
    """A message is not a valid sample; the text gives the reason."""


def set_stamp(header: Any, time_s: float) -> None:
    """Set the stamp of a header to a time (s), rounded to the nanosecond."""
    header.stamp.sec, header.stamp.nanosec = stamp_of(time_s)


def stamp_s(header: Any) -> float:
    """Return the stamp of a header in seconds."""
    return float(header.stamp.sec + header.stamp.nanosec * 1e-9)


class Row(NamedTuple):
    """One bookkeeping row of a step message: its name, and its number in each column."""

    name: str
    position: float
    velocity: float = 0.0
    effort: float = 0.0


def marked(message: AnyStep, name: str, absent: float = 0.0, column: str = "position") -> float:
    """Return a number of a named row of a step message, or ``absent`` if there is no such row."""
    return float(getattr(message, column)[message.name.index(name)]) if name in message.name else absent


def step_index(message: AnyStep) -> int | None:
    """Return the step number of a message without decoding the rest; None if it has no step row.

    Raises
    ------
    MessageError
        If the positions are not one per row, or the step is not an integer below 2^53.
    """
    if len(message.name) != len(message.position):
        raise MessageError(f"{len(message.name)} rows, but {len(message.position)} positions")
    step = marked(message, STEP)
    if not abs(step) < LARGEST_STEP or step != int(step):
        raise MessageError(f"step {step} is no step index")
    return int(step) if STEP in message.name else None


class ConfigurationMark(NamedTuple):
    """The configuration of a sample: its revision, and the source number of the node that published it."""

    revision: int = 0
    source: float = 0.0


def configuration_mark(message: AnyStep) -> ConfigurationMark:
    """Return the mark of the configuration that the sample was computed with; revision 0 if there is none."""
    return ConfigurationMark(int(marked(message, REVISION)), marked(message, REVISION, column="velocity"))


def numbers_of(message: AnyStep, *more: float) -> tuple[float, ...]:
    """Return the columns of a step message, with one number between columns as in its bytes, followed by ``more``.

    Raises
    ------
    MessageError
        If a column has not one number per row, or a number is not finite.
    """
    names, columns = message.name, (message.position, message.velocity, message.effort)
    if not names:
        raise MessageError("no rows: 'name' is empty")
    numbers = (*columns[0], 0.0, *columns[1], 0.0, *columns[2], *more)
    if all(len(column) == len(names) for column in columns) and math.isfinite(sum(numbers)):
        return numbers
    for title, column in zip(BODILY, columns, strict=True):
        if len(column) != len(names):
            found = f"has {len(column)} number{'' if len(column) == 1 else 's'}" if column else "is empty"
            shown = ", ".join(names[:SHOWN_NAMES]) + (", ..." if len(names) > SHOWN_NAMES else "")
            raise MessageError(f"column {title} {found}, expected {len(names)}: one for each of {shown}")
        for name, number in zip(names, column, strict=True):
            if not math.isfinite(number):
                raise MessageError(f"{title} of '{name}' is {number}, not finite")
    return numbers


def step_and_time(stamp: float, step_row: tuple[float, float] | None, step_s: float | None) -> tuple[int, float]:
    """Return step index and exact time (s): from ``step_row``, else from the stamp and the step length (s).

    Raises
    ------
    MessageError
        If neither is known, the stamp contradicts the row, or the stamp is not a multiple of the step length.
    """
    if step_row is not None:
        step, time_s = int(step_row[0]), step_row[1]
    elif step_s is not None:
        step = round(stamp / step_s)
        time_s = step * step_s
    else:
        raise MessageError("no step row, and the coupling step is not known")
    if abs(stamp - time_s) > 2e-9 + 1e-12 * time_s:
        if step_row is None:
            raise MessageError(
                f"stamp {stamp:.9f} s lies between steps of {step_s:g} s; expected that of the step answered"
            )
        raise MessageError(f"stamp {stamp:.9f} s is not the time {time_s:.9f} s of its step")
    return step, time_s


def rows_of(sample: Sample) -> tuple[Row, ...]:
    """Return the rows of the optional parts of a sample (its last field)."""
    content: Any = sample[-1]
    if not content:
        return ()
    if isinstance(content, EffortCommand):
        return Row(ASKED, *content[:2]), Row(HELD, *content[2:])
    return tuple([row for index, part in enumerate(content) for row in _part_rows(str(index), part)])


def _part_rows(index: str, part: Event | Load) -> list[Row]:
    """Return the consecutive rows of an event or a load."""
    if isinstance(part, Load):
        head = f"{LOAD}{index}/{part.kind}/{part.contact}"
        numbers = zip(LOAD_COLUMNS, (part.time_s, *part[3:]), strict=True)
        return [Row(f"{head}/{column}", 0.0, 0.0, number) for column, number in numbers]
    head = f"{EVENT}{index}"
    return [
        Row(f"{head}/{part.kind}/{part.contact}", part.time_s, part.pre_velocity_m_per_s, part.impulse_ns),
        Row(f"{head}/after", float(part.period), part.post_velocity_m_per_s),
        *[Row(f"{head}/pre/{k}", *coordinate) for k, coordinate in enumerate(part.pre)],
        *[Row(f"{head}/post/{k}", *coordinate) for k, coordinate in enumerate(part.post)],
    ]


def parts_of(kind: type[Sample], names: tuple[str, ...]) -> Callable[[Numbers], Any]:
    """Return a function that makes the last field of a role's sample from the numbers of a message with these rows.

    Raises
    ------
    MessageError
        If an event, a load or the effort command lacks a row.
    """
    if kind is MotorSample:
        rows = [names.index(name) for name in (ASKED, HELD) if name in names]
        if len(rows) == 1:
            raise MessageError(f"one of the rows '{ASKED}' and '{HELD}' is missing")
        pick = itemgetter(*[row + column for row in rows for column in (0, len(names) + 1)]) if rows else None
        return lambda numbers: pick and EffortCommand(*pick(numbers))
    word = LOAD if kind is ForceSample else EVENT
    rows = [row for row, name in enumerate(names) if name.startswith(word)]
    parts = [_part(names, [*group]) for _, group in groupby(rows, lambda row: names[row].split("/")[1])]
    return lambda numbers: tuple([make(pick(numbers)) for pick, make in parts])


def _part(names: tuple[str, ...], rows: list[int]) -> tuple[Callable[[Numbers], Any], Callable[[Numbers], Any]]:
    """Return the getter of the numbers of an event or load in these rows, and the function that makes it of them."""
    head, *others = [names[row].split("/") for row in rows]
    if len(head) > 3:
        pre, post = (sum(words[2:3] == [side] for words in others) for side in ("pre", "post"))
        loaded = names[rows[0]].startswith(LOAD)
        make = partial(load_of, head[2], head[3]) if loaded else partial(event_of, head[2], head[3], pre)
        count = len(LOAD_COLUMNS) if loaded else 5 + 3 * (pre + post)
        found = _part_rows(head[1], make(range(1, count + 1)))  # each number is its own index, from 1
        if [row.name for row in found] == [names[row] for row in rows]:
            stride = len(names) + 1
            at = {n: rows[i] + stride * k for i, row in enumerate(found) for k, n in enumerate(row[1:]) if n}
            return itemgetter(*[at[n] for n in sorted(at)]), make
    raise MessageError(f"'{names[rows[0]]}' has not all its rows")


@lru_cache(maxsize=1024)
def _write_form(kind: Any, of: tuple[Names, ...], more: Names) -> tuple[bytes, Array, Indices, Indices]:
    """Return bytes from frame to numbers, zeroed columns, and indices in them of a sample vector and of added rows.

    One extra number follows the columns: it takes entries of the sample vector that are not in the message.
    """
    entries = kind(*of).entries
    own = dict.fromkeys(entry.row for entry in entries)
    names = tuple(row for row in own if not row.startswith(MARK))
    if more:
        names = (*names, more[0], *(row for row in own if row.startswith(MARK)), *more[1:])
    rows, (block, columns) = len(names), row_layout(names)
    zeros, stride = [0.0] * rows, rows + 1  # the number of rows precedes each next column
    raw = block + columns.pack(*zeros, rows, *zeros, rows, *zeros)
    begin = len(raw) - 8 * (3 * stride - 1)
    at = {name: place for place, name in enumerate(names)}
    return (
        raw[:begin],
        np.frombuffer(raw + bytes(8), np.float64, offset=begin).copy(),
        np.array([at[entry.row] + stride * entry.place if entry.row in at else -1 for entry in entries], np.int64),
        np.array([at[name] + stride * column for name in more for column in range(3)], np.int64),
    )


@lru_cache(maxsize=1024)
def _read_form(kind: Any, names: Names) -> tuple[SampleLayout[Any], Any, int | None, Any]:
    """Return the layout of a sample, the getter of its vector, the index of its step, the maker of its last field.

    Getter and index refer to the numbers of a message followed by those of `ABSENT`.

    Raises
    ------
    MessageError
        If a name occurs twice, a row is missing, or an event or a load is incomplete.
    """
    if len(set(names)) != len(names):
        double = next(name for i, name in enumerate(names) if name in names[:i])
        raise MessageError(f"row name '{double}' stands twice")
    bodies = plain = tuple(name for name in names if not name.startswith(MARK))
    first, of_pins = f"/{kind.threes[0]}", set[str]()
    if kind.of_pins:
        bodies = tuple(name.removesuffix(first) for name in plain if name.endswith(first))
        of_pins = {f"{pin}/{what}" for pin in bodies for what in kind.threes}
    lists = []
    for word in map(WORDS.get, kind.lists):
        mark = f"{MARK}{word}/" if word else ""
        listed = [name for name in (names if word else plain) if name.startswith(mark) and name not in of_pins]
        lists.append(tuple(name.removeprefix(mark) for name in listed))
    layout, stride = kind(bodies, *lists), len(names) + 1
    at = {name: place for place, name in enumerate(ABSENT, 3 * stride - 1)}
    at |= {name: place for place, name in enumerate(names)}
    for row in (entry.row for entry in layout.entries if entry.row not in at):
        pin = f"; a pin has {', '.join(kind.threes)}" if row in of_pins else ""
        raise MessageError(f"row '{row}' is missing{pin}")
    places = [at[entry.row] + stride * entry.place for entry in layout.entries]
    return layout, itemgetter(*places, 0), at.get(STEP), parts_of(kind.kind, names)  # one more: always a tuple


class StepCodec(Generic[SampleOf]):
    """Encodes and decodes the samples of a role.

    Parameters
    ----------
    kind : type
        Class of the sample.
    steps, joint_states : Topic
        Topics of the step messages, and of the plain joint states.

    Attributes
    ----------
    field : str
        The field of a frame that the samples fill.
    """

    def __init__(self, kind: type[SampleOf], steps: Topic, joint_states: Topic) -> None:
        self.layout: Any = LAYOUTS[kind]
        self.field, self.steps, self.joint_states = FIELDS[kind], steps, joint_states

    def to_bytes(self, sample: Any, marks: tuple[Row, ...] = ()) -> bytes:
        """Return a sample as CDR of a step message, with the rows added by the publishing node; padding is 0."""
        more = (*rows_of(sample), *marks)
        numbers = (*sample[:2], 0.0, *[number for row in more for number in row[1:]])
        return self._written(sample, (STEP, *[row[0] for row in more]), numbers)

    def shown(self, sample: Any) -> bytes:
        """Return CDR of a plain joint state: only the joints of a sample, or its efforts."""
        return self._written(sample, (), ())

    def _written(self, sample: Any, more: Names, numbers: tuple[float, ...]) -> bytes:
        block, zeros, at, more_at = _write_form(self.layout, self.layout.of(sample), more)
        columns = zeros.copy()
        columns[at] = row_of(sample)
        columns[more_at] = numbers
        return b"".join((HEAD, STAMP.pack(*stamp_of(sample[1])), block, columns.data[:-1]))

    def to_message(self, sample: Any) -> JointState:
        """Return a sample as a ROS message."""
        message: JointState = deserialize_message(self.to_bytes(sample), JointState)
        return message

    def from_message(self, message: AnyStep, step_s: float | None = None) -> SampleOf:
        """Return the sample of a message.

        A message without bookkeeping rows comes from a user's own motor node, or a measured linkage.

        Raises
        ------
        MessageError
            If the message is not a sample of the role.
        """
        names, numbers = tuple(message.name), numbers_of(message, *ABSENT.values())
        layout, pick, at, make_last = _read_form(self.layout, names)
        step_row = None if at is None else (numbers[at], numbers[at + len(names) + 1])
        step, time_s = step_and_time(stamp_s(message.header), step_row, step_s)
        made: SampleOf = layout.sample(step, time_s, pick(numbers), make_last(numbers))
        return made

    def received(self, raw: bytes, step_s: float, joints: Names | None = None) -> SampleOf:
        """Return the sample of a received step message, its joints in the given order, if any.

        Cached, because several nodes of one process receive the same bytes.

        Raises
        ------
        CdrError
            If it is not a JointState.
        MessageError
            If it is not a sample of the role, or a joint is missing.
        """
        made: SampleOf = _received(self, raw, step_s, joints)
        return made


@lru_cache(maxsize=8)
def _received(codec: StepCodec[Any], raw: bytes, step_s: float, joints: Names | None) -> Any:
    sample = codec.from_message(received_message(raw), step_s)
    return sample if joints is None else arranged(sample, joints)


linkage = StepCodec(LinkageSample, STEP_LINKAGE, JOINT_STATES)
motor = StepCodec(MotorSample, STEP_MOTOR, MOTOR_JOINT_STATES)
force = StepCodec(ForceSample, STEP_FORCES, FORCE_JOINT_STATES)
body = StepCodec(BodySample, STEP_BODY, BODY_JOINT_STATES)
CODECS: tuple[StepCodec[Any], ...] = (linkage, motor, force, body)


def arranged(sample: Any, joints: Names) -> Any:
    """Return the sample with its joints in this order, matched by name.

    Raises
    ------
    MessageError
        If a joint is missing.
    """
    if sample.joints == joints:
        return sample
    missing = [name for name in joints if name not in sample.joints]
    if missing:
        raise MessageError(f"joint {', '.join(missing)} is missing; there are {', '.join(sample.joints) or 'none'}")
    rows = [sample.joints.index(name) for name in joints]
    columns = {c: tuple(getattr(sample, c)[row] for row in rows) for c in ("position", "velocity", "effort")}
    return sample._replace(joints=joints, **columns)
