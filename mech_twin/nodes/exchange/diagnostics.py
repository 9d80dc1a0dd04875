# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of one node: worst residual of each window against its limit, loss counters, state.

Each topic counts what went wrong on it, so that no loss is silent.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from mech_twin.engine.invariants import ResidualWindow, broken_lines
from mech_twin.messages.step_message import set_stamp
from mech_twin.samples import Named

OF_STEPS = ("missing", "repeated", "late", "early", "conflicting")
KINDS = (*OF_STEPS, "malformed", "unknown_source", "timeout", "incompatible", "suspended")


class Report(NamedTuple):
    """What one window of one topic saw."""

    topic: str
    counts: dict[str, int]
    last_reason: str


class SequenceFault(NamedTuple):
    """A kind of `KINDS`, words for a person, and how many steps it concerns."""

    kind: str
    reason: str
    number: int


class StepSequence:
    """The first and the newest step of a topic."""

    def __init__(self) -> None:
        self.first: int | None = None
        self.last: int | None = None

    def take(self, step: int) -> SequenceFault | None:
        """Take a step into account; return what is wrong with it, if anything is."""
        last, self.last = self.last, step if self.last is None else max(step, self.last)
        if last is None:
            self.first = step
        if last is None or step == last + 1:
            return None
        reason = f"step {step} after {last}"
        if step > last:
            return SequenceFault("missing", reason, step - last - 1)
        return SequenceFault("repeated" if step == last else "late", reason, 1)


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


HARMLESS = {"repeated"}  # a run that waits repeats its step: counted, and no reason to warn
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class NodeDiagnostics:
    """Collects a window and turns it into a diagnostics message.

    Parameters
    ----------
    name : str
        Full name of the node; its namespace, without the first slash, is the hardware that is diagnosed.
    statistics : TopicStatistics
        What was lost.
    """

    def __init__(self, name: str, statistics: TopicStatistics) -> None:
        self.state = "starting"
        self.breaches = 0
        self._name = name
        self.hardware = name.strip("/").rpartition("/")[0]
        self._statistics = statistics
        self._window = ResidualWindow({})
        self._step_s: float | None = None
        self._errors: list[str] = []
        self._warnings: list[str] = []

    def limits(self, limits: Mapping[str, float], step_s: float) -> None:
        """Judge residuals by these limits, of a coupling step (s), from now on; one that has none counts as broken."""
        self._window.limits = dict(limits)
        self._step_s = step_s

    def observe(self, residuals: Named) -> None:
        """Take the residuals of one sample into account."""
        self._window.observe(residuals)

    def error(self, text: str) -> None:
        """Add an error to the next message."""
        self._errors.append(text)

    def warn(self, text: str) -> None:
        """Add a warning to the next message."""
        self._warnings.append(text)

    def close_window(self, extra: Mapping[str, str]) -> tuple[DiagnosticStatus, list[str]]:
        """Return the status of the window that ends now, and one line for the log per topic that lost something."""
        reports = [report for report in self._statistics.close_window() if set(report.counts) - HARMLESS]
        residuals = self._window.close()
        lines = [_line(report) for report in reports]
        broken = broken_lines(residuals, self._step_s)
        self.breaches += len(broken)
        waiting = self.state.startswith("waiting")
        level = ERROR if broken or self._errors else WARN if reports or waiting or self._warnings else OK
        text = "; ".join([self.state, *broken, *self._errors, *self._warnings, *lines])
        self._errors, self._warnings = [], []
        status = DiagnosticStatus(level=level, name=self._name, message=text, hardware_id=self.hardware)
        values = {f"worst {name}": f"{residual.worst:.6g}" for name, residual in residuals.items()}
        values |= {name: str(number) for name, number in self._statistics.totals().items()} | dict(extra)
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        return status, lines


def _line(report: Report) -> str:
    counts = ", ".join(f"{number} {kind.replace('_', ' ')}" for kind, number in report.counts.items())
    return f"{report.topic}: {counts}" + (f"; last: {report.last_reason}" if report.last_reason else "")


def array_message(time_s: float, status: DiagnosticStatus) -> DiagnosticArray:
    """Return one status as a diagnostics message, stamped with simulation time."""
    message = DiagnosticArray(status=[status])
    set_stamp(message.header, time_s)
    return message
