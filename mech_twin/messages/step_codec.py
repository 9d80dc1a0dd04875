# SPDX-License-Identifier: Apache-2.0
"""Samples <-> step messages, by the layouts of `engine.sample_vectors`: ``linkage``, ``motor``, ``force``, ``body``.

Rows of joints, or of pins and what follows from them, come first, under their own names.  What a sample carries beyond
follows in rows whose names begin with ``~``, so that a reader who wants the joints only drops them by name; then events
or loads, and what the publishing node adds.  Every number travels as the float64 it is.  Where each stands is worked
out once for the names of a stream.
"""

from __future__ import annotations

from functools import lru_cache
from operator import itemgetter
from typing import Any, Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mech_twin.engine.sample_vectors import (
    MARK,
    Array,
    BodyLayout,
    ForceLayout,
    LinkageLayout,
    MotorLayout,
    SampleLayout,
    SampleOf,
    row_of,
)
from mech_twin.messages.joint_state_cdr import HEAD, STAMP, AnyStep, received_message, row_layout, stamp_of
from mech_twin.messages.step_message import STEP, MessageError, Row, numbers_of, step_and_time
from mech_twin.messages.step_parts import parts_of, rows_of

Names = tuple[str, ...]


class WriteForm(NamedTuple):
    """Bytes from the stamp up to the numbers, the columns (all 0), and where a row, and step and more, go in them."""

    block: bytes
    columns: Array
    of_row: NDArray[np.int64]
    read: NDArray[np.int64] | slice
    more: NDArray[np.int64]

    def written(self, time_s: float, columns: Array) -> bytes:
        """Return the bytes of a message at a time with these columns."""
        return b"".join((HEAD, STAMP.pack(*stamp_of(time_s)), self.block, columns.tobytes()))


@lru_cache(maxsize=1024)
def _write_form(layout: Any, of: tuple[Names, ...], more: Names, joints_only: bool) -> WriteForm:
    entries = layout(*of).entries
    own = dict.fromkeys(entry.row for entry in entries if not entry.row.startswith(MARK))
    marked = dict.fromkeys(entry.row for entry in entries if entry.row.startswith(MARK))
    names = tuple(own) if joints_only else (*own, STEP, *marked, *more)
    rows, column = row_layout(names), len(names) + 1  # the number of rows stands between two columns
    zeros = [0.0] * len(names)
    numbers = rows.columns.pack(len(names), *zeros, len(names), *zeros, len(names), *zeros)
    begin = rows.position_at - rows.start
    at = {name: place for place, name in enumerate(names)}
    read = [place for place, entry in enumerate(entries) if entry.row in at]
    return WriteForm(
        rows.block + numbers[:begin],
        np.frombuffer(numbers, np.float64, offset=begin),
        np.array([at[entries[place].row] + column * entries[place].place for place in read], np.int64),
        slice(None) if len(read) == len(entries) else np.array(read, np.int64),
        np.array([at[name] + column * place for name in (STEP, *more) if name in at for place in range(3)], np.int64),
    )


class ReadForm(NamedTuple):
    """Messages with these row names: layout of the sample, its numbers, those of the step, events or loads."""

    layout: SampleLayout[Any]
    row: Any
    step: int | None
    parts: Any


@lru_cache(maxsize=1024)
def _read_form(kind: Any, names: Names) -> ReadForm:
    """Return where everything stands; the defaults of the layout stand behind the numbers of the message.

    Raises
    ------
    MessageError
        If a name stands twice, a row is missing, or an event or a load is incomplete.
    """
    if len(set(names)) != len(names):
        double = next(name for i, name in enumerate(names) if name in names[:i])
        raise MessageError(f"row name '{double}' stands twice")
    at = {name: place for place, name in enumerate(names)}
    plain = tuple(name for name in names if not name.startswith(MARK))
    bodies, first, of_pins = plain, f"/{kind.threes[0]}", set[str]()
    if kind.bodies == "pins":
        bodies = tuple(name.removesuffix(first) for name in plain if name.endswith(first))
        of_pins = {f"{pin}/{what}" for pin in bodies for what in kind.threes}
        plain = tuple(name for name in plain if name not in of_pins)
    lists = [
        tuple(name.removeprefix(f"{MARK}{word}/") for name in names if name.startswith(f"{MARK}{word}/"))
        if word
        else plain
        for word in kind.lists.values()
    ]
    layout = kind(bodies, *lists)
    defaults = {MARK + name: value for name, value in kind.scalars.items() if value is not None}
    places = []
    for entry in layout.entries:
        if entry.row in at:
            places.append(at[entry.row] + len(names) * entry.place)
        elif entry.row in defaults:
            places.append(3 * len(names) + list(defaults).index(entry.row))
        else:
            pin = f"; a pin has {', '.join(kind.threes)}" if entry.row in of_pins else ""
            raise MessageError(f"row '{entry.row}' is missing{pin}")
    pick = itemgetter(*places) if len(places) > 1 else lambda numbers: [numbers[place] for place in places]
    return ReadForm(layout, pick, at.get(STEP), parts_of(kind.kind, names))


class StepCodec(Generic[SampleOf]):
    """Both ways between the samples of a role and their messages.

    Parameters
    ----------
    layout : type
        What the samples hold.
    """

    def __init__(self, layout: type[SampleLayout[SampleOf]]) -> None:
        self.layout: Any = layout
        self._defaults = tuple(value for value in layout.scalars.values() if value is not None)

    def to_bytes(self, sample: Any, marks: tuple[Row, ...] = ()) -> bytes:
        """Return the bytes of a sample as a step message, with the rows the publishing node adds; padding is 0."""
        more = (*rows_of(sample), *marks)
        form = _write_form(self.layout, self.layout.of(sample), tuple([row[0] for row in more]), False)
        columns = form.columns.copy()
        columns[form.of_row] = row_of(sample)
        columns[form.more] = (*sample[:2], 0.0, *[number for row in more for number in row[1:]])
        return form.written(sample.time_s, columns)

    def shown(self, sample: Any) -> bytes:
        """Return the bytes of a plain joint state: the joints of a sample, or its efforts, and no more."""
        form = _write_form(self.layout, self.layout.of(sample), (), True)
        columns = form.columns.copy()
        columns[form.of_row] = row_of(sample)[form.read]
        return form.written(sample.time_s, columns)

    def to_message(self, sample: Any) -> JointState:
        """Return a sample as a message of the middleware."""
        message: JointState = deserialize_message(self.to_bytes(sample), JointState)
        return message

    def from_message(self, message: AnyStep, step_s: float | None = None) -> SampleOf:
        """Return the sample of a message.

        One without bookkeeping rows comes from somebody's own motor, or a measured linkage.

        Raises
        ------
        MessageError
            If the message is no sample of the role.
        """
        names = tuple(message.name)
        position, velocity, effort = columns = numbers_of(message, names)
        form = _read_form(self.layout, names)
        step, time_s = step_and_time(message, position, velocity, form.step, step_s)
        row = form.row((*position, *velocity, *effort, *self._defaults))
        made: SampleOf = form.layout.sample(step, time_s, row, *form.parts(columns))
        return made

    def received(self, raw: bytes, step_s: float, joints: Names | None = None) -> SampleOf:
        """Return the sample of a received step message, its joints in this order, if any.

        Several nodes of one process hear the same bytes: whoever is not the first gets the sample made of them.

        Raises
        ------
        CdrError
            If it is no JointState.
        MessageError
            If it is no sample of the role, or a joint is missing.
        """
        made: SampleOf = _received(self, raw, step_s, joints)
        return made


@lru_cache(maxsize=8)
def _received(codec: StepCodec[Any], raw: bytes, step_s: float, joints: Names | None) -> Any:
    sample = codec.from_message(received_message(raw), step_s)
    return sample if joints is None else arranged(sample, joints)


linkage, motor = StepCodec(LinkageLayout), StepCodec(MotorLayout)
force, body = StepCodec(ForceLayout), StepCodec(BodyLayout)


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
