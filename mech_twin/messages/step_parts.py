# SPDX-License-Identifier: Apache-2.0
"""Optional parts of a step message: events of linkage and body, loads of the forces, effort command of a motor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import Any

from mech_twin.engine.sample_vectors import event_of, load_of
from mech_twin.messages.step_message import ASKED, EVENT, HELD, LOAD, MessageError, Row
from mech_twin.samples import EffortCommand, Event, ForceSample, Load, MotorSample, Sample

LOAD_COLUMNS = (Load._fields[0], *Load._fields[3:])
Numbers = Sequence[float]


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
