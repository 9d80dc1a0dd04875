# SPDX-License-Identifier: Apache-2.0
"""What a step message has some of: events of linkage and body, loads of the forces, the effort asked of a motor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from mech_twin.messages.step_message import ASKED, EVENT, HELD, LOAD, MessageError, Row
from mech_twin.samples import Coordinate, EffortCommand, Event, ForceSample, Load, MotorSample, Sample

LOAD_COLUMNS = ("time_s", "moment_before_nm", "moment_after_nm", "impulse_nms")
Columns = tuple[Sequence[float], ...]


def rows_of(sample: Sample) -> tuple[Row, ...]:
    """Return the rows of what a sample has some of."""
    if not sample[-1]:
        return ()
    if isinstance(sample, MotorSample):
        asked = sample.asked
        return () if asked is None else (Row(ASKED, *asked[:2]), Row(HELD, *asked[2:]))
    if isinstance(sample, ForceSample):
        return tuple(row for index, load in enumerate(sample.loads) for row in _load_rows(index, load))
    return tuple(row for index, event in enumerate(sample.events) for row in _event_rows(index, event))


def parts_of(kind: type[Sample], names: tuple[str, ...]) -> Callable[[Columns], tuple[Any, ...]]:
    """Return what makes the last field of a role's sample of the columns of a message with these row names.

    Raises
    ------
    MessageError
        If an event, a load or the effort asked has not all its rows.
    """
    if kind is MotorSample:
        rows = [names.index(name) for name in (ASKED, HELD) if name in names]
        if len(rows) == 1:
            raise MessageError(f"one of the rows '{ASKED}' and '{HELD}' is missing")
        return lambda of: (EffortCommand(*(column[row] for row in rows for column in of[:2])),) if rows else ()
    if kind is ForceSample:
        heads = [_load(names, row) for row, name in enumerate(names) if _is_load(name)]
        return lambda of: (
            tuple([Load(of[2][at], kind, contact, *of[2][at + 1 : at + 4]) for kind, contact, at in heads]),
        )
    places = _event_places(names)
    return lambda of: (tuple([_event(place, of) for place in places]),)


def _is_load(name: str) -> bool:
    return name.startswith(LOAD) and name.endswith(f"/{LOAD_COLUMNS[0]}")


def _load_rows(index: int, load: Load) -> list[Row]:
    head = f"{LOAD}{index}/{load.kind}/{load.contact}"
    values = (load.time_s, load.moment_before_nm, load.moment_after_nm, load.impulse_nms)
    return [Row(f"{head}/{column}", 0.0, 0.0, value) for column, value in zip(LOAD_COLUMNS, values, strict=True)]


def _load(names: tuple[str, ...], row: int) -> tuple[str, str, int]:
    """Return kind, contact and first row of a load, whose rows stand together."""
    parts = names[row].split("/")
    expected = tuple("/".join((*parts[:-1], column)) for column in LOAD_COLUMNS)
    if len(parts) != 5 or names[row : row + len(expected)] != expected:
        raise MessageError(f"load '{names[row]}' has not all its rows")
    return parts[2], parts[3], row


def _event_rows(index: int, event: Event) -> list[Row]:
    head = f"{EVENT}{index}/"
    rows = [
        Row(f"{head}{event.kind}/{event.contact}", event.time_s, event.pre_velocity_m_per_s, event.impulse_ns),
        Row(f"{head}after", float(event.period), event.post_velocity_m_per_s),
    ]
    for side, coordinates in (("pre", event.pre), ("post", event.post)):
        rows += [Row(f"{head}{side}/{k}", *coordinate) for k, coordinate in enumerate(coordinates)]
    return rows


class EventPlaces(NamedTuple):
    """Rows of one event."""

    kind: str
    contact: str
    head: int
    after: int
    pre: tuple[int, ...]
    post: tuple[int, ...]


def _event_places(names: tuple[str, ...]) -> tuple[EventPlaces, ...]:
    parts = {tuple(name.split("/")): row for row, name in enumerate(names) if name.startswith(EVENT)}
    heads = {
        int(p[1]): (p, row)
        for p, row in parts.items()
        if len(p) == 4 and p[1].isascii() and p[1].isdigit() and len(p[1]) < 10 and p[2] not in ("pre", "post")
    }
    found = []
    for index, (head, row) in sorted(heads.items()):
        after = parts.get((EVENT[:-1], str(index), "after"))
        if after is None:
            raise MessageError(f"event {index} has no row 'after'")
        sides = [tuple(row for p, row in parts.items() if p[1:-1] == (str(index), side)) for side in ("pre", "post")]
        found.append(EventPlaces(head[2], head[3], row, after, *sides))
    return tuple(found)


def _event(place: EventPlaces, columns: Columns) -> Event:
    position, velocity, effort = columns
    head, after = place.head, place.after
    pre, post = (tuple([Coordinate(*[of[row] for of in columns]) for row in side]) for side in (place.pre, place.post))
    return Event(
        position[head], place.kind, place.contact, velocity[head], velocity[after], effort[head], int(position[after]),
        pre, post,
    )  # fmt: skip
