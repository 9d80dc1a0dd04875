# SPDX-License-Identifier: Apache-2.0
"""A step message read: its rows checked and found by name, for whoever makes a sample of them.

Where everything stands is worked out once for each order of names.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from mech_twin.messages.identity import of_the_same
from mech_twin.messages.joint_state_cdr import AnyStep, StepMessage
from mech_twin.messages.step_message import EVENT, MARK, MEMORY, RESIDUAL, STEP, MessageError, stamp_s
from mech_twin.samples import Coordinate, Event, Named

COLUMNS = ("position", "velocity", "effort")
SHOWN_NAMES = 6


class Layout(NamedTuple):
    """Where everything stands in a step message with these row names."""

    joints: tuple[str, ...]
    joint_rows: tuple[int, ...]
    scalars: dict[str, int]
    memory: tuple[str, ...]
    memory_rows: tuple[int, ...]
    residuals: tuple[str, ...]
    residual_rows: tuple[int, ...]
    events: tuple[EventPlaces, ...]


class EventPlaces(NamedTuple):
    """Rows of one event."""

    kind: str
    contact: str
    head: int
    after: int
    pre: tuple[int, ...]
    post: tuple[int, ...]


@of_the_same
@lru_cache(maxsize=1024)
def layout(names: tuple[str, ...]) -> Layout:
    """Return where everything stands.

    Raises
    ------
    MessageError
        If a name stands twice or an event is incomplete.
    """
    if len(set(names)) != len(names):
        double = next(name for i, name in enumerate(names) if name in names[:i])
        raise MessageError(f"row name '{double}' stands twice")
    rows = {name: i for i, name in enumerate(names)}
    joints = {n: i for n, i in rows.items() if not n.startswith(MARK)}
    memory = {n.removeprefix(MEMORY): i for n, i in rows.items() if n.startswith(MEMORY)}
    residuals = {n.removeprefix(RESIDUAL): i for n, i in rows.items() if n.startswith(RESIDUAL)}
    scalars = {n: i for n, i in rows.items() if n.startswith(MARK) and not n.startswith((MEMORY, RESIDUAL, EVENT))}
    return Layout(
        tuple(joints), tuple(joints.values()), scalars, tuple(memory), tuple(memory.values()),
        tuple(residuals), tuple(residuals.values()), _event_layouts(rows),
    )  # fmt: skip


def _is_index(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 10


def _event_layouts(rows: dict[str, int]) -> tuple[EventPlaces, ...]:
    parts = {tuple(name.split("/")): i for name, i in rows.items() if name.startswith(EVENT)}
    heads = {
        int(p[1]): (p, i) for p, i in parts.items() if len(p) == 4 and _is_index(p[1]) and p[2] not in ("pre", "post")
    }
    found = []
    for index, (head, row) in sorted(heads.items()):
        after = rows.get(f"{EVENT}{index}/after")
        if after is None:
            raise MessageError(f"event {index} has no row 'after'")
        sides = [
            tuple(i for p, i in parts.items() if p[1] == str(index) and p[2] == side and len(p) == 4)
            for side in ("pre", "post")
        ]
        found.append(EventPlaces(head[2], head[3], row, after, *sides))
    return tuple(found)


class Table(NamedTuple):
    """A checked step message: its layout and its columns."""

    layout: Layout
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]

    def joints(self, column: Sequence[float]) -> tuple[float, ...]:
        """Return the joints' entries of one column."""
        return _picked(column, self.layout.joint_rows)

    def scalar(self, name: str, absent: float | None = None) -> float:
        """Return a bookkeeping number; without ``absent`` a missing row is an error."""
        row = self.layout.scalars.get(name)
        if row is not None:
            return self.position[row]
        if absent is None:
            raise MessageError(f"row '{name}' is missing")
        return absent

    def memory(self) -> Named:
        """Return the memory rows."""
        return Named(self.layout.memory, _picked(self.position, self.layout.memory_rows))

    def residuals(self) -> Named:
        """Return the residual rows."""
        return Named(self.layout.residuals, _picked(self.position, self.layout.residual_rows))

    def events(self) -> tuple[Event, ...]:
        """Return the events of the step."""
        return tuple([self._event(rows) for rows in self.layout.events])

    def _event(self, rows: EventPlaces) -> Event:
        return Event(
            self.position[rows.head],
            rows.kind,
            rows.contact,
            self.velocity[rows.head],
            self.velocity[rows.after],
            self.effort[rows.head],
            int(self.position[rows.after]),
            tuple(self._coordinate(i) for i in rows.pre),
            tuple(self._coordinate(i) for i in rows.post),
        )

    def _coordinate(self, row: int) -> Coordinate:
        return Coordinate(self.position[row], self.velocity[row], self.effort[row])


def _picked(column: Sequence[float], rows: Sequence[int]) -> tuple[float, ...]:
    if not rows:
        return ()
    first, last = rows[0], rows[-1]
    if last - first + 1 == len(rows):  # rows ascend, so they stand together
        return tuple(column[first : last + 1])
    return tuple([column[i] for i in rows])


def _columns(message: AnyStep) -> tuple[Sequence[float], ...]:
    if isinstance(message, StepMessage):
        return message.position, message.velocity, message.effort
    return message.position.tolist(), message.velocity.tolist(), message.effort.tolist()


def table(message: AnyStep) -> Table:
    """Return the checked content of a step message.

    Raises
    ------
    MessageError
        If the columns have not one entry a row, or hold a number that is not finite.
    """
    names = tuple(message.name)
    columns = _columns(message)
    if not names:
        raise MessageError("no rows: 'name' is empty")
    position, velocity, effort = columns
    whole = len(position) == len(velocity) == len(effort) == len(names)
    if whole and math.isfinite(sum(position) + sum(velocity) + sum(effort)):
        return Table(layout(names), position, velocity, effort)
    for title, column in zip(COLUMNS, columns, strict=True):
        if len(column) != len(names):
            raise MessageError(_wrong_length(title, len(column), names))
        if not math.isfinite(sum(column)) and not all(map(math.isfinite, column)):
            row = next(i for i, number in enumerate(column) if not math.isfinite(number))
            raise MessageError(f"{title} of '{names[row]}' is {column[row]}, not finite")
    return Table(layout(names), *columns)


def _wrong_length(column: str, length: int, names: tuple[str, ...]) -> str:
    found = "is empty" if length == 0 else f"has {length} number{'' if length == 1 else 's'}"
    shown = ", ".join(names[:SHOWN_NAMES]) + (", ..." if len(names) > SHOWN_NAMES else "")
    return f"column {column} {found}, expected {len(names)}: one for each of {shown}"


def step_and_time(message: AnyStep, content: Table, step_s: float | None) -> tuple[int, float]:
    """Return the step index and its exact time: from the step row, else from the stamp and the step's length.

    Raises
    ------
    MessageError
        If neither is known, or the stamp contradicts the row, or the stamp lies off the grid.
    """
    row = content.layout.scalars.get(STEP)
    stamp = stamp_s(message.header)
    if row is not None:
        step, time_s = int(content.position[row]), content.velocity[row]
    elif step_s is not None:
        step = round(stamp / step_s)
        time_s = step * step_s
    else:
        raise MessageError("no step row, and the coupling step is not known")
    if abs(stamp - time_s) > 2e-9 + 1e-12 * time_s:
        if row is None:
            raise MessageError(
                f"stamp {stamp:.9f} s lies between steps of {step_s:g} s; expected that of the step answered"
            )
        raise MessageError(f"stamp {stamp:.9f} s is not the time {time_s:.9f} s of its step")
    return step, time_s


def arranged(sample: Any, joints: tuple[str, ...]) -> Any:
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


class JointColumns(NamedTuple):
    """What every sample of joints begins with, in the order of its fields."""

    step: int
    time_s: float
    joints: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


def joint_columns(message: AnyStep, content: Table, step_s: float | None) -> JointColumns:
    """Return step, time and joints of a checked step message; see `step_and_time` for what is refused."""
    step, time_s = step_and_time(message, content, step_s)
    columns = (content.joints(column) for column in (content.position, content.velocity, content.effort))
    return JointColumns(step, time_s, content.layout.joints, *columns)
