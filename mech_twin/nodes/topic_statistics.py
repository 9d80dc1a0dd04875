# SPDX-License-Identifier: Apache-2.0
"""Counters of what went wrong on a topic, so that no loss is silent.  Knows no ROS, so it can be tested alone."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

OF_STEPS = ("missing", "repeated", "late", "early", "conflicting")
KINDS = (*OF_STEPS, "malformed", "unknown_source", "timeout", "incompatible", "suspended")


class Report(NamedTuple):
    """What one window of one topic saw."""

    topic: str
    counts: dict[str, int]
    last_reason: str


class TopicStatistics:
    """Counts per topic and kind, in all and since the last report."""

    def __init__(self) -> None:
        self.total: Counter[tuple[str, str]] = Counter()
        self._window: Counter[tuple[str, str]] = Counter()
        self._reasons: dict[str, str] = {}

    def count(self, topic: str, kind: str, reason: str = "", number: int = 1) -> None:
        """Count that something of this kind happened on a topic."""
        if kind not in KINDS:
            raise ValueError(f"kind {kind!r} is not one of {', '.join(KINDS)}")
        self.total[topic, kind] += number
        self._window[topic, kind] += number
        if reason:
            self._reasons[topic] = reason

    def totals(self) -> dict[str, int]:
        """Return ``topic: kind`` -> count since the start."""
        return {f"{topic}: {kind}": number for (topic, kind), number in sorted(self.total.items())}

    def close_window(self) -> list[Report]:
        """Return one report a topic that saw anything since the last call."""
        topics = sorted({topic for topic, _ in self._window})
        reports = [
            Report(topic, {k: n for (t, k), n in self._window.items() if t == topic}, self._reasons.get(topic, ""))
            for topic in topics
        ]
        self._window.clear()
        self._reasons.clear()
        return reports
