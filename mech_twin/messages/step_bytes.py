# SPDX-License-Identifier: Apache-2.0
"""Step messages written straight from a sample's numbers into CDR bytes, without a message in between.

The bytes are those of `joint_state_cdr.encoded`.  Where everything stands is worked out once for the names of a stream;
entries that are always 0 are padding, which is written as zeros.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

from mech_twin.messages.identity import Names, of_the_same
from mech_twin.messages.joint_state_cdr import HEAD, row_layout, stamp_of
from mech_twin.messages.step_message import Row, row_names
from mech_twin.samples import BodySample, LinkageSample, MotorSample, Named

NUMBER = 8


class RowForm(NamedTuple):
    """What writes messages with these rows, the bytes of frame and names, and the number of rows."""

    write: struct.Struct
    block: bytes
    rows: int


def row_form(names: Names, position: str, velocity: str, effort: str) -> RowForm:
    """Return the form of rows whose columns are these formats of `struct`."""
    layout = row_layout(names)
    rows, gap = len(names), layout.columns.size - 3 * NUMBER * len(names) - 20
    columns = f"I{gap}x{position}I4x{velocity}I4x{effort}"
    return RowForm(struct.Struct(f"<{len(HEAD)}siI{len(layout.block)}s{columns}"), layout.block, rows)


def written(form: RowForm, time_s: float, position: Any, velocity: Any, effort: Any) -> bytes:
    """Return the bytes of a message at a time with these columns."""
    sec, nanosec = stamp_of(time_s)
    rows = form.rows
    return form.write.pack(HEAD, sec, nanosec, form.block, rows, *position, rows, *velocity, rows, *effort)


@of_the_same
def _moving_form(joints: Names, scalars: Names, memory: Names, residuals: Names, marks: Names) -> RowForm:
    names = row_names(joints, scalars, memory, residuals, marks)
    own, zeros, said = len(joints), len(memory) + len(residuals), len(marks)
    after = NUMBER * (len(scalars) + zeros)
    return row_form(names, f"{len(names)}d", f"{own + 1}d{after - NUMBER}x{said}d", f"{own}d{after}x{said}d")


_mark_names: dict[Names, Names] = {}


def mark_names(marks: tuple[Row, ...]) -> Names:
    """Return the names of rows, the same tuple each time."""
    names = tuple([row[0] for row in marks])
    return _mark_names.setdefault(names, names)


def moving_bytes(
    sample: LinkageSample | MotorSample | BodySample,
    scalars: Names,
    numbers: tuple[float, ...],
    memory: Named,
    residuals: Named,
    marks: tuple[Row, ...],
) -> bytes:
    """Return the bytes of a sample of joints without events.

    Parameters
    ----------
    sample : LinkageSample, MotorSample or BodySample
        The sample.
    scalars, numbers
        Names of its further rows, the step first and the same tuple each time, and their numbers.
    memory, residuals : Named
        Of the sample.
    marks : tuple of Row
        What the publishing node adds.
    """
    form = _moving_form(sample.joints, scalars, memory.names, residuals.names, mark_names(marks))
    position = (*sample.position, *numbers, *memory.values, *residuals.values, *[row[1] for row in marks])
    velocity = (*sample.velocity, sample.time_s, *[row[2] for row in marks])
    return written(form, sample.time_s, position, velocity, (*sample.effort, *[row[3] for row in marks]))
