# SPDX-License-Identifier: Apache-2.0
"""The step message: one whole sample as the named rows of a sensor_msgs/JointState.

The rows of the joints come first, under their own names.  What a sample carries beyond its joints follows in rows
whose names begin with ``~``, so that a reader who wants the joints only can drop them by name.  Every number travels
as the float64 it is: nothing is rounded on the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from mech_twin.messages.joint_state_cdr import AnyStep, Header, StepMessage, stamp_of
from mech_twin.samples import Event, Named

MARK = "~"
STEP = "~step"
REGIME = "~regime"
COMMAND = "~command"
REVISION = "~revision"
TARGET = "~target"
ASKED = "~asked"
HELD = "~held"
SOURCE = "~source"
MEMORY = "~memory/"
RESIDUAL = "~residual/"
EVENT = "~event/"
LARGEST_STEP = 2.0**53


class MessageError(ValueError):
    """A message that is no sample; the text says what is wrong with it."""


def set_stamp(header: Any, time_s: float) -> None:
    """Write a time into a header, rounded to the nanosecond a stamp can hold."""
    header.stamp.sec, header.stamp.nanosec = stamp_of(time_s)


def stamp_s(header: Any) -> float:
    """Return the time of a header in seconds."""
    return float(header.stamp.sec + header.stamp.nanosec * 1e-9)


class Row(NamedTuple):
    """One bookkeeping row of a step message: its name and its entry in each column."""

    name: str
    position: float
    velocity: float = 0.0
    effort: float = 0.0


@lru_cache(maxsize=1024)
def row_names(
    joints: tuple[str, ...],
    scalars: tuple[str, ...],
    memory: tuple[str, ...],
    residuals: tuple[str, ...],
    more: tuple[str, ...],
) -> tuple[str, ...]:
    """Return the names of all rows, the same tuple each time."""
    return (*joints, *scalars, *(MEMORY + name for name in memory), *(RESIDUAL + name for name in residuals), *more)


NOTHING = Named()


def packed(
    sample: Any,
    scalars: Sequence[Row],
    memory: Named = NOTHING,
    residuals: Named = NOTHING,
    events: tuple[Event, ...] = (),
    marks: tuple[Row, ...] = (),
) -> StepMessage:
    """Return a sample as a step message.

    Parameters
    ----------
    sample : LinkageSample, MotorSample or BodySample
        Its joints come first.
    scalars : sequence of Row
        Further numbers of the sample.
    memory, residuals, events
        Of the sample.
    marks : tuple of Row
        What the publishing node adds; last.
    """
    more = (*(row for i, e in enumerate(events) for row in _event_rows(i, e)), *marks) if events else marks
    names = row_names(
        sample.joints,
        tuple([row[0] for row in scalars]),
        memory.names,
        residuals.names,
        tuple([row[0] for row in more]),
    )
    padding = (0.0,) * (len(memory.values) + len(residuals.values))
    return StepMessage(
        Header(stamp_of(sample.time_s)),
        names,
        (*sample.position, *[r[1] for r in scalars], *memory.values, *residuals.values, *[r[1] for r in more]),
        (*sample.velocity, *[r[2] for r in scalars], *padding, *[r[2] for r in more]),
        (*sample.effort, *[r[3] for r in scalars], *padding, *[r[3] for r in more]),
    )


def _event_rows(index: int, event: Event) -> list[Row]:
    head = f"{EVENT}{index}/"
    rows = [
        Row(f"{head}{event.kind}/{event.contact}", event.time_s, event.pre_velocity_m_per_s, event.impulse_ns),
        Row(f"{head}after", float(event.period), event.post_velocity_m_per_s),
    ]
    rows += [Row(f"{head}pre/{k}", *coordinate) for k, coordinate in enumerate(event.pre)]
    rows += [Row(f"{head}post/{k}", *coordinate) for k, coordinate in enumerate(event.post)]
    return rows


def step_index(message: AnyStep) -> int | None:
    """Return the step of a message that is not decoded any further; None if it has no step row.

    Raises
    ------
    MessageError
        If its columns have not one entry a row, or the step is no whole number a float64 holds exactly.
    """
    names, position = message.name, message.position
    if len(names) != len(position):
        raise MessageError(f"{len(names)} rows, but {len(position)} positions")
    if STEP not in names:
        return None
    return checked_step(float(position[names.index(STEP)]))


def checked_step(step: float) -> int:
    """Return a step index.

    Raises
    ------
    MessageError
        If it is no whole number a float64 holds exactly.
    """
    if not abs(step) < LARGEST_STEP or step != int(step):
        raise MessageError(f"step {step} is no step index")
    return int(step)
