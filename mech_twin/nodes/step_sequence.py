# SPDX-License-Identifier: Apache-2.0
"""The steps of one topic as they arrive: what is missing, repeated or late.  Knows no ROS."""

from __future__ import annotations

from typing import NamedTuple


class SequenceFault(NamedTuple):
    """A kind of `topic_statistics.KINDS`, words for a person, and how many steps it concerns."""

    kind: str
    reason: str
    number: int


class StepSequence:
    """The first and the newest step of a topic."""

    def __init__(self) -> None:
        self.first: int | None = None
        self._last: int | None = None

    def take(self, step: int) -> SequenceFault | None:
        """Take a step into account; return what is wrong with it, if anything is."""
        last, self._last = self._last, step if self._last is None else max(step, self._last)
        if last is None:
            self.first = step
        if last is None or step == last + 1:
            return None
        reason = f"step {step} after {last}"
        if step > last:
            return SequenceFault("missing", reason, step - last - 1)
        return SequenceFault("repeated" if step == last else "late", reason, 1)
