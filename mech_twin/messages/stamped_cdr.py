# SPDX-License-Identifier: Apache-2.0
"""Small stamped messages as CDR bytes: a header, then numbers.

::

      head | sec, nanosec | length, frame, NUL | gap | numbers
           4              12                         8-byte aligned, counted from the end of the head

The middleware's own converter reads such a message attribute by attribute, which costs ten times as much.
"""

from __future__ import annotations

import struct
from functools import lru_cache

from mech_twin.messages.joint_state_cdr import HEAD, STAMP, stamp_of


@lru_cache(maxsize=256)
def _form(frame: str, numbers: int) -> tuple[struct.Struct, bytes]:
    """Return what writes a message of this frame, and the bytes of the frame."""
    letters = frame.encode() + b"\0"
    block = struct.pack("<I", len(letters)) + letters
    gap = -(STAMP.size + len(block)) % 8
    return struct.Struct(f"<{len(HEAD)}siI{len(block)}s{gap}x{numbers}d"), block


def stamped_bytes(time_s: float, frame: str, numbers: tuple[float, ...]) -> bytes:
    """Return a message that is a header and these numbers, such as WrenchStamped or Vector3Stamped; padding is 0."""
    form, block = _form(frame, len(numbers))
    sec, nanosec = stamp_of(time_s)
    return form.pack(HEAD, sec, nanosec, block, *numbers)


def clock_bytes(time_s: float) -> bytes:
    """Return a rosgraph_msgs/Clock."""
    return HEAD + STAMP.pack(*stamp_of(time_s))
