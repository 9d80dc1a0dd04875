# SPDX-License-Identifier: Apache-2.0
"""The step message, one whole sample as the named rows of a sensor_msgs/JointState: its own rows, and what nodes add.

A publishing node adds its own number, and the configuration the sample was computed with.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from mech_twin.messages.joint_state_cdr import AnyStep, StepMessage, stamp_of

STEP = "~step"
REVISION = "~revision"
TARGET = "~target"
ASKED = "~asked"
HELD = "~held"
SOURCE = "~source"
EVENT = "~event/"
LOAD = "~load/"
LARGEST_STEP = 2.0**53
COLUMNS = ("position", "velocity", "effort")
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


def marked(message: AnyStep, name: str, absent: float) -> float:
    """Return a number a node has added to a step message, or ``absent`` if it has not."""
    names = message.name
    return float(message.position[names.index(name)]) if name in names else absent


def source(message: AnyStep) -> float:
    """Return the number the publishing node signs with; 0 if it does not."""
    names = message.name
    return float(message.position[-1]) if names and names[-1] == SOURCE else marked(message, SOURCE, ANONYMOUS)


def revision(message: AnyStep) -> int:
    """Return how many parameter changes the sample was computed with; 0 if the message does not say."""
    return int(marked(message, REVISION, 0.0))


class ConfigurationMark(NamedTuple):
    """The configuration a sample was computed with: its revision, and the source of the node that described it."""

    revision: int = 0
    source: float = 0.0


def configuration_mark(message: AnyStep) -> ConfigurationMark:
    """Return which configuration the sample was computed with; revision 0 if the message does not say."""
    names = message.name
    if len(names) > 1 and names[-2] == REVISION:  # where the twin's own nodes write it
        return ConfigurationMark(int(message.position[-2]), float(message.velocity[-2]))
    if REVISION not in names:
        return ConfigurationMark()
    row = names.index(REVISION)
    return ConfigurationMark(int(message.position[row]), float(message.velocity[row]))


def revision_row(number: int, source: float = 0.0) -> Row:
    """Return the row that says which configuration a sample was computed with."""
    return Row(REVISION, float(number), source)


def numbers_of(message: AnyStep, names: tuple[str, ...]) -> tuple[Sequence[float], ...]:
    """Return the columns of a step message.

    Raises
    ------
    MessageError
        If they have not one entry a row, or hold a number that is not finite.
    """
    if not names:
        raise MessageError("no rows: 'name' is empty")
    columns: tuple[Sequence[float], ...] = (message.position, message.velocity, message.effort)
    if not isinstance(message, StepMessage):
        columns = tuple(column.tolist() for column in (message.position, message.velocity, message.effort))
    if all(len(column) == len(names) for column in columns) and math.isfinite(sum(map(sum, columns))):
        return columns
    for title, column in zip(COLUMNS, columns, strict=True):
        if len(column) != len(names):
            found = "is empty" if not column else f"has {len(column)} number{'' if len(column) == 1 else 's'}"
            shown = ", ".join(names[:SHOWN_NAMES]) + (", ..." if len(names) > SHOWN_NAMES else "")
            raise MessageError(f"column {title} {found}, expected {len(names)}: one for each of {shown}")
        wrong = [row for row, number in enumerate(column) if not math.isfinite(number)]
        if wrong:
            raise MessageError(f"{title} of '{names[wrong[0]]}' is {column[wrong[0]]}, not finite")
    return columns


def step_and_time(
    message: AnyStep, position: Sequence[float], velocity: Sequence[float], row: int | None, step_s: float | None
) -> tuple[int, float]:
    """Return the step index and its exact time: from the step's row, else from the stamp and the step's length.

    Raises
    ------
    MessageError
        If neither is known, or the stamp contradicts the row, or the stamp lies off the grid.
    """
    stamp = stamp_s(message.header)
    if row is not None:
        step, time_s = int(position[row]), velocity[row]
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
