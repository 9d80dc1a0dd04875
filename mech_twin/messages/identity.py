# SPDX-License-Identifier: Apache-2.0
"""What follows from tuples of names, remembered by their identity: a stream has the same tuple each time."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

Names = tuple[str, ...]
Made = TypeVar("Made")
MOST_REMEMBERED = 256


def of_the_same(make: Callable[..., Made]) -> Callable[..., Made]:
    """Return a function of tuples of names that remembers what it made by the tuples' identity.

    To look up a tuple of names by value means to hash some forty names each time.  What is remembered holds the tuples,
    so that none of them is replaced by another at its place.
    """
    known: dict[tuple[int, ...], tuple[tuple[Names, ...], Made]] = {}

    def remembered(*names: Names) -> Made:
        key = tuple(map(id, names))
        held = known.get(key)
        if held is None:
            if len(known) >= MOST_REMEMBERED:
                known.clear()
            held = known[key] = (names, make(*names))
        return held[1]

    return remembered
