# SPDX-License-Identifier: Apache-2.0
"""The step message, one whole sample as the named rows of a sensor_msgs/JointState: its own rows, and what nodes add.

A publishing node adds its own number, and the configuration the sample was computed with.
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
ANONYMOUS = 0.0  # the source of who does not sign


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


def marked(message: AnyStep, name: str, absent: float = 0.0, column: str = "position") -> float:
    """Return a number a node has added to a step message, or ``absent`` if it has not."""
    return float(getattr(message, column)[message.name.index(name)]) if name in message.name else absent


def step_index(message: AnyStep) -> int | None:
    """Return the step of a message that is not decoded any further; None if it has no step row.

    Raises
    ------
    MessageError
        If its columns have not one entry a row, or the step is no whole number a float64 holds exactly.
    """
    if len(message.name) != len(message.position):
        raise MessageError(f"{len(message.name)} rows, but {len(message.position)} positions")
    step = marked(message, STEP)
    if not abs(step) < LARGEST_STEP or step != int(step):
        raise MessageError(f"step {step} is no step index")
    return int(step) if STEP in message.name else None


class ConfigurationMark(NamedTuple):
    """The configuration a sample was computed with: its revision, and the source of the node that described it."""

    revision: int = 0
    source: float = 0.0


def configuration_mark(message: AnyStep) -> ConfigurationMark:
    """Return which configuration the sample was computed with; revision 0 if the message does not say."""
    return ConfigurationMark(int(marked(message, REVISION)), marked(message, REVISION, column="velocity"))


def numbers_of(message: AnyStep, *more: float) -> tuple[float, ...]:
    """Return the columns of a step message with a number between each two, as they stand in its bytes, and more.

    Raises
    ------
    MessageError
        If they have not one entry a row, or hold a number that is not finite.
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


def step_and_time(stamp: float, told: tuple[float, float] | None, step_s: float | None) -> tuple[int, float]:
    """Return the step index and its exact time: as the step's row tells them, else from stamp and step's length (s).

    Raises
    ------
    MessageError
        If neither is known, or the stamp contradicts the row, or the stamp lies off the grid.
    """
    if told is not None:
        step, time_s = int(told[0]), told[1]
    elif step_s is not None:
        step = round(stamp / step_s)
        time_s = step * step_s
    else:
        raise MessageError("no step row, and the coupling step is not known")
    if abs(stamp - time_s) > 2e-9 + 1e-12 * time_s:
        if told is None:
            raise MessageError(
                f"stamp {stamp:.9f} s lies between steps of {step_s:g} s; expected that of the step answered"
            )
        raise MessageError(f"stamp {stamp:.9f} s is not the time {time_s:.9f} s of its step")
    return step, time_s
