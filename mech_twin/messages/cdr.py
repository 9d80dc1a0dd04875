# SPDX-License-Identifier: Apache-2.0
"""CDR encoding of small stamped messages, and of step messages, whose row names are encoded once per stream.

::

      head | sec, nanosec | frame, child ...... | gap | numbers                        of a stamped message
      head | sec, nanosec | frame, n, names, n  | gap | positions | n | velocities | n | efforts
           4              12                          8-byte aligned, from the head's end

The middleware's converter handles a message attribute by attribute, and converts every name in it to a string and
back, which takes most of its time.  Here only the numbers of a step message are read or written while the bytes before
its columns stay the same; any other message goes to that converter.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from sensor_msgs.msg import JointState

HEAD = b"\x00\x01\x00\x00"  # plain CDR, little endian
STAMP = struct.Struct("<iI")
STAMP_AT = len(HEAD)
BLOCK_AT = STAMP_AT + STAMP.size
MOST_LAYOUTS = 256


class CdrError(ValueError):
    """The bytes are not a valid message."""


class Stamp(NamedTuple):
    """A time as in a message header: seconds and nanoseconds."""

    sec: int
    nanosec: int


class Header(NamedTuple):
    """A message header."""

    stamp: Stamp
    frame_id: str = ""


@lru_cache(maxsize=64)
def stamp_of(time_s: float) -> Stamp:
    """Return a time (s) as a stamp, rounded to the nanosecond."""
    return Stamp(*divmod(round(time_s * 1e9), 1_000_000_000))


def words(*texts: str) -> bytes:
    """Return strings in CDR: each preceded by its length, NUL-terminated, 4-byte aligned."""
    letters = [text.encode() + b"\0" for text in texts]
    return b"".join(struct.pack("<I", len(each)) + each + bytes(-len(each) % 4) for each in letters)


@lru_cache(maxsize=256)
def _stamped_form(frames: tuple[str, ...], numbers: int) -> tuple[struct.Struct, bytes]:
    """Return the struct that packs a message with these frame names, and the bytes of the names."""
    block = words(*frames)
    gap = -(STAMP.size + len(block)) % 8
    return struct.Struct(f"<{len(HEAD)}siI{len(block)}s{gap}x{numbers}d"), block


def stamped_bytes(at: float | Stamp, *frames: str, numbers: tuple[float, ...] = ()) -> bytes:
    """Return time (s), frames and numbers as CDR of Clock, Wrench-, Vector3- or TransformStamped; padding is 0."""
    form, block = _stamped_form(frames, len(numbers))
    return form.pack(HEAD, *(at if isinstance(at, Stamp) else stamp_of(at)), block, *numbers)


def wrench_bytes(
    at: float | Stamp, frame: str, force_x_n: float, force_y_n: float = 0.0, moment_nm: float = 0.0
) -> bytes:
    """Return a planar wrench in the frame of a pin or the tool as CDR of a WrenchStamped; padding is 0."""
    return stamped_bytes(at, frame, numbers=(force_x_n, force_y_n, 0.0, 0.0, 0.0, moment_nm))


class StepMessage(NamedTuple):
    """The content of a JointState with the same field names, and its CDR bytes if it was received."""

    header: Header
    name: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]
    raw: bytes = b""


AnyStep: TypeAlias = "JointState | StepMessage"


@lru_cache(maxsize=MOST_LAYOUTS)
def row_layout(names: tuple[str, ...], frame: str = "") -> tuple[bytes, struct.Struct]:
    """Return the bytes from the frame to the gap of messages with these row names, and the struct of the columns."""
    return _layout(names, (len(names),) * 3, frame)


@lru_cache(maxsize=MOST_LAYOUTS)
def _layout(names: tuple[str, ...], counts: tuple[int, ...], frame: str) -> tuple[bytes, struct.Struct]:
    """Return the same for columns of any lengths."""
    block = words(frame) + struct.pack("<I", len(names)) + words(*names) + struct.pack("<I", counts[0])
    form, end = "", STAMP.size + len(block)
    for count in counts:
        if count > 0:
            form += f"{-end % 8}x{count}d"
            end += -end % 8 + 8 * count
        form += "I"
        end += 4
    return block, struct.Struct(f"<{form[:-1]}")


class _Layout(NamedTuple):
    """Where the numbers of messages with the same names, and as many numbers, stand."""

    names: tuple[str, ...]
    frame: str
    counts: tuple[int, ...]
    block: bytes
    columns: struct.Struct


_layouts: dict[int, list[_Layout]] = {}  # of messages read, by length


def known_message(raw: bytes) -> StepMessage | None:
    """Return a JointState with the names of an earlier one, read by the places of its numbers; None of any other."""
    for names, frame, (positions, velocities, efforts), block, columns in _layouts.get(len(raw), ()):
        if raw.startswith(block, BLOCK_AT) and raw.startswith(HEAD):
            values, second = columns.unpack_from(raw, BLOCK_AT + len(block)), positions + 1 + velocities
            if values[positions] == velocities and values[second] == efforts:
                header = Header(Stamp(*STAMP.unpack_from(raw, STAMP_AT)), frame)
                velocity = values[positions + 1 : second]
                return StepMessage(header, names, values[:positions], velocity, values[second + 1 :], raw)
    return None


def learn_layout(raw: bytes, message: Any) -> None:
    """Store where the numbers of a decoded JointState stand in its bytes."""
    counts = len(message.position), len(message.velocity), len(message.effort)
    names, frame = tuple(message.name), message.header.frame_id
    block, columns = _layout(names, counts, frame)
    # a middleware may leave bytes behind the end
    if len(raw) >= BLOCK_AT + len(block) + columns.size and raw.startswith(block, BLOCK_AT):
        if sum(map(len, _layouts.values())) >= MOST_LAYOUTS:  # bounds the memory for a stream of ever new names
            _layouts.clear()
        _layouts.setdefault(len(raw), []).append(_Layout(names, frame, counts, block, columns))


@lru_cache(maxsize=8)
def received_message(raw: bytes) -> StepMessage:
    """Return the step message decoded from CDR; cached, so that several listeners of a process decode it once.

    Raises
    ------
    CdrError
        If the bytes are not a JointState.
    """
    return known_message(raw) or _converted(raw)


def _converted(raw: bytes) -> StepMessage:
    """Return the step message decoded by the middleware's converter, and store its layout."""
    from rclpy.serialization import deserialize_message  # what reads recordings works without ROS
    from sensor_msgs.msg import JointState

    try:
        message: JointState = deserialize_message(raw, JointState)
    except RuntimeError as error:
        reason = str(error).partition("\n")[0]
        raise CdrError(f"{len(raw)} bytes that are no JointState: {reason}") from error
    learn_layout(raw, message)
    stamp, name = message.header.stamp, tuple(message.name)
    header = Header(Stamp(stamp.sec, stamp.nanosec), message.header.frame_id)
    return StepMessage(header, name, tuple(message.position), tuple(message.velocity), tuple(message.effort), raw)


def joint_state_bytes(time_s: float, names: tuple[str, ...], columns: Sequence[Sequence[float]]) -> bytes:
    """Return positions, velocities and efforts as CDR of a JointState; a column may be empty.

    Nothing stands behind the last column, where the middleware's converter may leave bytes.
    """
    block, form = _layout(names, tuple(map(len, columns)), "")
    positions, velocities, efforts = columns
    numbers = form.pack(*positions, len(velocities), *velocities, len(efforts), *efforts)
    return b"".join((HEAD, STAMP.pack(*stamp_of(time_s)), block, numbers))


def encoded(message: StepMessage) -> bytes:
    """Return a step message as CDR with zero padding, so that equal messages give equal bytes."""
    rows, (block, columns) = len(message.name), row_layout(tuple(message.name), message.header.frame_id)
    numbers = columns.pack(*message.position, rows, *message.velocity, rows, *message.effort)
    return b"".join((HEAD, STAMP.pack(*message.header.stamp), block, numbers))
