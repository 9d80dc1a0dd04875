# SPDX-License-Identifier: Apache-2.0
"""Small stamped messages as CDR bytes: a header, then numbers.

::

      head | sec, nanosec | length, frame, NUL | (gap | length, child, NUL) | gap | numbers
           4              12                                                        8-byte aligned, from the head's end

The middleware's own converter reads such a message attribute by attribute, which costs ten times as much.
"""

from __future__ import annotations

import struct
from functools import lru_cache

from mech_twin.messages.joint_state_cdr import HEAD, STAMP, stamp_of


@lru_cache(maxsize=256)
def _form(frames: tuple[str, ...], numbers: int) -> tuple[struct.Struct, bytes]:
    """Return what writes a message of these frames, and the bytes of their names."""
    block = b""
    for frame in frames:
        letters = frame.encode() + b"\0"
        block += bytes(-len(block) % 4) + struct.pack("<I", len(letters)) + letters
    gap = -(STAMP.size + len(block)) % 8
    return struct.Struct(f"<{len(HEAD)}siI{len(block)}s{gap}x{numbers}d"), block


def stamped_bytes(time_s: float, frame: str, numbers: tuple[float, ...]) -> bytes:
    """Return a message that is a header and these numbers, such as WrenchStamped or Vector3Stamped; padding is 0."""
    return _written(time_s, (frame,), numbers)


def wrench_bytes(time_s: float, frame: str, force_x_n: float, force_y_n: float = 0.0, moment_nm: float = 0.0) -> bytes:
    """Return a planar wrench in a frame, a pin's or the tool's, as a WrenchStamped; padding is 0."""
    return _written(time_s, (frame,), (force_x_n, force_y_n, 0.0, 0.0, 0.0, moment_nm))


def transform_bytes(time_s: float, frame: str, child: str, numbers: tuple[float, ...]) -> bytes:
    """Return a TransformStamped of a child in a frame: translation x, y, z (m), rotation x, y, z, w; padding is 0."""
    return _written(time_s, (frame, child), numbers)


def _written(time_s: float, frames: tuple[str, ...], numbers: tuple[float, ...]) -> bytes:
    form, block = _form(frames, len(numbers))
    sec, nanosec = stamp_of(time_s)
    return form.pack(HEAD, sec, nanosec, block, *numbers)


def clock_bytes(time_s: float) -> bytes:
    """Return a rosgraph_msgs/Clock."""
    return HEAD + STAMP.pack(*stamp_of(time_s))
