# SPDX-License-Identifier: Apache-2.0
"""Step messages as CDR bytes.  The row names of a stream hardly ever change, so they are encoded once.

The middleware's own converter turns every name of every message into a string and back, which is most of what a
step message costs.  Here, while the bytes before the columns stay the same, only the numbers are read or written;
any other message goes to the converter::

      head | stamp | frame, names ........... | n | positions | n | velocities | n | efforts
           4       12                         ^ columns begin here: `start`
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import NamedTuple, TypeAlias

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

HEAD = b"\x00\x01\x00\x00"  # plain CDR, little endian
STAMP = struct.Struct("<iI")
STAMP_AT = len(HEAD)
BLOCK_AT = STAMP_AT + STAMP.size
MOST_LAYOUTS = 256


class CdrError(ValueError):
    """Bytes that are no JointState."""


class Stamp(NamedTuple):
    """A time as a header holds it."""

    sec: int
    nanosec: int


class Header(NamedTuple):
    """The part of a header that is used."""

    stamp: Stamp
    frame_id: str = ""


@lru_cache(maxsize=64)
def stamp_of(time_s: float) -> Stamp:
    """Return a time as a header holds it, rounded to the nanosecond."""
    return Stamp(*divmod(round(time_s * 1e9), 1_000_000_000))


class StepMessage(NamedTuple):
    """What a JointState says, under the names of its fields, and the bytes it came as, if it was received."""

    header: Header
    name: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]
    raw: bytes = b""


AnyStep: TypeAlias = JointState | StepMessage


def joint_state(message: StepMessage) -> JointState:
    """Return the message as the middleware's own type."""
    made = JointState(
        name=list(message.name), position=message.position, velocity=message.velocity, effort=message.effort
    )
    made.header.stamp.sec, made.header.stamp.nanosec = message.header.stamp
    made.header.frame_id = message.header.frame_id
    return made


class RowLayout(NamedTuple):
    """What messages with these row names have in common.

    ``block`` are the bytes from the frame's name up to the columns, ``columns`` reads and writes what follows.
    """

    names: tuple[str, ...]
    block: bytes
    columns: struct.Struct

    @property
    def start(self) -> int:
        """Where the columns begin."""
        return BLOCK_AT + len(self.block)

    @property
    def position_at(self) -> int:
        """Where the first position stands."""
        return self.start + self.columns.size - 24 * len(self.names) - 16


def _block(names: tuple[str, ...], frame: str) -> bytes:
    """Return frame and names in CDR: each string with its length before it, NUL-terminated, 4-byte aligned."""
    words = [struct.pack("<I", len(names))]
    for text in (frame, *names):
        letters = text.encode() + b"\0"
        words.append(struct.pack("<I", len(letters)) + letters + bytes(-len(letters) % 4))
    words[0], words[1] = words[1], words[0]  # the frame stands before the number of names
    return b"".join(words)


@lru_cache(maxsize=MOST_LAYOUTS)
def _layout(names: tuple[str, ...], frame: str) -> RowLayout:
    block, rows = _block(names, frame), len(names)
    gap = -(BLOCK_AT - STAMP_AT + len(block) + 4) % 8  # float64 is 8-byte aligned, counted from the end of the head
    return RowLayout(names, block, struct.Struct(f"<I{gap}x{rows}dI4x{rows}dI4x{rows}d"))


def row_layout(names: tuple[str, ...]) -> RowLayout:
    """Return what messages with these row names, and no frame, have in common."""
    return _layout(names, "")


class Decoder:
    """Reads step messages, and keeps the layouts of those it has read."""

    def __init__(self) -> None:
        self._layouts: dict[int, list[RowLayout]] = {}
        self.layout_count = 0

    def __call__(self, raw: bytes) -> StepMessage:
        """Return what a message says.

        Raises
        ------
        CdrError
            If it is no JointState.
        """
        layout = self.layout(raw)
        if layout is not None:
            rows = len(layout.names)
            values = layout.columns.unpack_from(raw, layout.start)
            if values[0] == values[rows + 1] == values[2 * rows + 2] == rows:
                return StepMessage(
                    Header(Stamp(*STAMP.unpack_from(raw, STAMP_AT))),
                    layout.names,
                    values[1 : rows + 1],
                    values[rows + 2 : 2 * rows + 2],
                    values[2 * rows + 3 :],
                    raw,
                )
        return self._converted(raw)

    def layout(self, raw: bytes) -> RowLayout | None:
        """Return the layout that bytes have up to their columns, if it has been met before."""
        for layout in self._layouts.get(len(raw), ()):
            if raw.startswith(layout.block, BLOCK_AT) and raw.startswith(HEAD):
                return layout
        return None

    def _converted(self, raw: bytes) -> StepMessage:
        try:
            message: JointState = deserialize_message(raw, JointState)
        except RuntimeError as error:
            reason = str(error).partition("\n")[0]
            raise CdrError(f"{len(raw)} bytes that are no JointState: {reason}") from error
        names = tuple(message.name)
        layout = _layout(names, message.header.frame_id)
        if names and len(raw) == layout.start + layout.columns.size and raw.startswith(layout.block, BLOCK_AT):
            self._keep(layout, len(raw))
        stamp = message.header.stamp
        header = Header(Stamp(stamp.sec, stamp.nanosec))
        return StepMessage(header, names, tuple(message.position), tuple(message.velocity), tuple(message.effort), raw)

    def _keep(self, layout: RowLayout, size: int) -> None:
        if self.layout_count >= MOST_LAYOUTS:  # bounds the memory a stream of ever new names takes
            self._layouts.clear()
            self.layout_count = 0
        self._layouts.setdefault(size, []).append(layout)
        self.layout_count += 1


_SHARED = Decoder()


@lru_cache(maxsize=8)
def received_message(raw: bytes) -> StepMessage:
    """Return what bytes say; bytes that several listeners of one process hear are read once.

    Raises
    ------
    CdrError
        If they are no JointState.
    """
    return _SHARED(raw)


def encoded(message: AnyStep) -> bytes:
    """Return the bytes of a step message, padding zeroed, so that equal messages are equal bytes."""
    layout = _layout(tuple(message.name), message.header.frame_id)
    rows = len(layout.names)
    if not rows or not len(message.position) == len(message.velocity) == len(message.effort) == rows:
        return bytes(serialize_message(joint_state(message) if isinstance(message, StepMessage) else message))
    stamp = message.header.stamp
    columns = layout.columns.pack(rows, *message.position, rows, *message.velocity, rows, *message.effort)
    return b"".join((HEAD, STAMP.pack(stamp.sec, stamp.nanosec), layout.block, columns))
