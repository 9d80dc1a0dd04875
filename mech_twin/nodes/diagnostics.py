# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of one node: worst residual of each window against its limit, loss counters, state."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from mech_twin.engine.invariants import ResidualWindow, broken_lines
from mech_twin.messages.step_message import set_stamp
from mech_twin.nodes.topic_statistics import Report, TopicStatistics
from mech_twin.samples import Named

HARMLESS = {"repeated"}  # a run that waits repeats its step: counted, and no reason to warn
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class NodeDiagnostics:
    """Collects a window and turns it into a diagnostics message."""

    def __init__(self, name: str, statistics: TopicStatistics) -> None:
        self.state = "starting"
        self.breaches = 0
        self._name = name
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
        status = DiagnosticStatus(level=level, name=self._name, message=text)
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
