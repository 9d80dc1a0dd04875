# SPDX-License-Identifier: Apache-2.0
"""What a recorder needs of a step message: when, of which step, from whom; the other numbers are not decoded."""

from __future__ import annotations

import struct
from typing import NamedTuple

from mech_twin.messages.joint_state_cdr import MOST_LAYOUTS, STAMP, STAMP_AT, Decoder, RowLayout
from mech_twin.messages.step_message import SOURCE, STEP, checked_step, source, step_index

COUNT = struct.Struct("<I")
NUMBER = struct.Struct("<d")
NS_PER_S = 1_000_000_000


class StepHead(NamedTuple):
    """Stamp, step (None where the message does not say it) and publisher (0 where it does not sign)."""

    stamp_ns: int
    step: int | None
    source: float


class NamePlaces(NamedTuple):
    """Offsets of the two numbers in the bytes, and where the number of rows is repeated."""

    step: int
    source: int
    counts: tuple[int, int, int]

    def counts_in(self, raw: bytes) -> list[int]:
        """Return the number of rows as each of the three columns says it."""
        return [COUNT.unpack_from(raw, at)[0] for at in self.counts]


class StepHeadReader:
    """Reads heads of step messages, and keeps where they stand."""

    def __init__(self) -> None:
        self._decode = Decoder()
        self._places: dict[tuple[str, ...], NamePlaces | None] = {}

    def __call__(self, raw: bytes) -> StepHead:
        """Return the head of a message.

        Raises
        ------
        CdrError
            If it is no JointState.
        MessageError
            If its columns have not one entry a row, or its step is none.
        """
        layout = self._decode.layout(raw)
        if layout is not None:
            places = self._known(layout)
            if places is not None and all(count == len(layout.names) for count in places.counts_in(raw)):
                sec, nanosec = STAMP.unpack_from(raw, STAMP_AT)
                step = checked_step(NUMBER.unpack_from(raw, places.step)[0])
                return StepHead(sec * NS_PER_S + nanosec, step, NUMBER.unpack_from(raw, places.source)[0])
        message = self._decode(raw)
        stamp = message.header.stamp
        return StepHead(stamp.sec * NS_PER_S + stamp.nanosec, step_index(message), source(message))

    def _known(self, layout: RowLayout) -> NamePlaces | None:
        """Return the places in messages of this layout; None where a number is missing."""
        if layout.names not in self._places:
            if len(self._places) >= MOST_LAYOUTS:
                self._places.clear()
            self._places[layout.names] = _places(layout)
        return self._places[layout.names]


def _places(layout: RowLayout) -> NamePlaces | None:
    if STEP not in layout.names or SOURCE not in layout.names:
        return None
    first, rows = layout.position_at, len(layout.names)
    column = 8 * (rows + 1)
    ends = (layout.start, first + 8 * rows, first + 8 * rows + column)
    return NamePlaces(first + 8 * layout.names.index(STEP), first + 8 * layout.names.index(SOURCE), ends)
