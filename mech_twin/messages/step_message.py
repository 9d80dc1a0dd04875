# SPDX-License-Identifier: Apache-2.0
"""The step message: one complete sample as the named rows of a sensor_msgs/JointState, and rows that nodes add.

A publishing node adds its source number, and a mark of the configuration that the sample was computed with.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from mech_twin.engine.sample_vectors import BODILY
from mech_twin.messages.cdr import AnyStep, stamp_of

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
