# SPDX-License-Identifier: Apache-2.0
"""Pictures that a page has not had yet, as many as fit."""

from __future__ import annotations

from collections import deque
from typing import Any

BATCH_BYTES = 1 << 20  # pictures in one message, at most


class Pictures:
    """Pictures in the order they came, bounded in bytes: the oldest go first."""

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes, self._bytes = most_bytes, 0
        self._kept: deque[bytes] = deque()

    def add(self, picture: bytes) -> None:
        """Keep a picture."""
        self._kept.append(picture)
        self._bytes += len(picture)
        while self._bytes > self.most_bytes and len(self._kept) > 1:
            self._bytes -= len(self._kept.popleft())

    def clear(self) -> None:
        """Forget all of them."""
        self._kept.clear()
        self._bytes = 0

    def take(self) -> list[bytes]:
        """Remove and return the first ones, as many as go into one message: one at least."""
        taken = [self._kept.popleft()]
        size = len(taken[0])
        while self._kept and size + len(self._kept[0]) <= BATCH_BYTES:
            taken.append(self._kept.popleft())
            size += len(taken[-1])
        self._bytes -= size
        return taken

    def __iter__(self) -> Any:
        return iter(self._kept)

    def __len__(self) -> int:
        return len(self._kept)
