"""Diagnostics of one node: worst residual of each window against its limit, loss counters, state."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from mech_twin.messages.rows import set_stamp
from mech_twin.nodes.ledger import Ledger
from mech_twin.samples import Named

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Health:
    """Collects a window and turns it into a diagnostics message."""

    def __init__(self, name: str, ledger: Ledger, limits: Mapping[str, float]) -> None:
        self.state = "starting"
        self.breaches = 0
        self._name = name
        self._ledger = ledger
        self._limits = limits
        self._worst: dict[str, float] = {}
        self._errors: list[str] = []

    def observe(self, residuals: Named) -> None:
        """Take the residuals of one sample into account."""
        for name, value in zip(residuals.names, residuals.values, strict=True):
            size = abs(value)
            if size > self._worst.get(name, -1.0):
                self._worst[name] = size

    def error(self, text: str) -> None:
        """Note an error for the next message."""
        self._errors.append(text)

    def close_window(self, extra: Mapping[str, str]) -> tuple[DiagnosticStatus, list[str]]:
        """Return the status of the window that ends now, and one line for the log per topic that lost something."""
        reports = self._ledger.close_window()
        lines = [
            f"{r.topic}: " + ", ".join(f"{n} {kind}" for kind, n in r.counts.items())
            + (f" (last: {r.last_reason})" if r.last_reason else "")
            for r in reports
        ]  # fmt: skip
        breached = [n for n, v in self._worst.items() if v > self._limits.get(n, float("inf"))]
        self.breaches += len(breached)
        waiting = self.state.startswith("waiting")
        level = ERROR if breached or self._errors else WARN if reports or waiting else OK
        words = [f"{name} {self._worst[name]:.3g} exceeds {self._limits[name]:.3g}" for name in breached]
        status = DiagnosticStatus(
            level=level, name=self._name, message="; ".join([self.state, *words, *self._errors, *lines])
        )
        values = {f"worst {name}": f"{value:.6g}" for name, value in self._worst.items()}
        values |= {name: str(number) for name, number in self._ledger.totals().items()} | dict(extra)
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        self._worst, self._errors = {}, []
        return status, lines


def array_message(time_s: float, status: DiagnosticStatus) -> DiagnosticArray:
    """Return one status as a diagnostics message, stamped with simulation time."""
    message = DiagnosticArray(status=[status])
    set_stamp(message.header, time_s)
    return message
