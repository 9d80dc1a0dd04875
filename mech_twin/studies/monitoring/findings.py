# SPDX-License-Identifier: Apache-2.0
"""Result of a cycle's evaluation: events in the life of faults, and the finding with its candidates."""

from __future__ import annotations

from typing import Literal, NamedTuple

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.charts import ChartValues
from mech_twin.studies.monitoring.fault_life import FaultLife
from mech_twin.studies.monitoring.naming import (
    Candidate,
)
from mech_twin.studies.monitoring.operating import OperatingValue

UNKNOWN = "unknown"
Verdict = Literal["learning", "healthy", "operating_point", "pending", "named", "group", "unknown", "passing"]


class FaultEvent(NamedTuple):
    """A fault came into another state at a stamp, and why, where that is not the charts' doing."""

    time_s: float
    name: str
    state: str
    because: str = ""

    @property
    def text(self) -> str:
        """One line, the same live and of a recording."""
        return f"{self.time_s:.3f} s: {self.name} {self.state}{f': {self.because}' if self.because else ''}"


class Findings(NamedTuple):
    """Result of the monitor after a cycle.

    Attributes
    ----------
    number : int
        Of the cycle.
    time_s : float
        Stamp of its end.
    names : tuple of str
        Features of the baseline.
    standard : ndarray
        Shape (d,): innovations over their standard deviations; nan where a feature or the history is missing.
    charts : ChartValues or None
        The statistics; None where the cycle could not be judged.
    alarm : bool
        Whether a chart is over its threshold, or was and is not quiet yet.
    alarm_begins : bool
        Whether that began with this cycle: what the stated rate of false alarms counts.
    verdict : str
        ``learning`` (history is missing), ``healthy``, ``operating_point`` (healthy at another one), ``pending``
        (alarm, not named yet), ``named``, ``group``,
        ``unknown``, ``passing`` (something happened, but nothing of it lasts).
    onset_s : float
        Stamp of the cycle in which the change began; nan without an alarm.
    delay_cycles : int
        Cycles from there to the alarm.
    candidates : tuple of Candidate
        The best first.
    faults : tuple of FaultLife
        Every fault that is not cleared.
    missing : tuple of str
        Features of the baseline that this cycle did not have.
    announce : bool
        Whether an operator is to be called now; at most once in ``LifeRules.announce_every_s``.
    operating : tuple of OperatingValue
        Variables of the operating point that are not where they were in the baseline.
    events : tuple of FaultEvent
        What has changed with this cycle.
    """

    number: int
    time_s: float
    names: tuple[str, ...]
    standard: Array
    charts: ChartValues | None
    alarm: bool = False
    alarm_begins: bool = False
    verdict: Verdict = "learning"
    onset_s: float = float("nan")
    delay_cycles: int = 0
    candidates: tuple[Candidate, ...] = ()
    faults: tuple[FaultLife, ...] = ()
    missing: tuple[str, ...] = ()
    announce: bool = False
    operating: tuple[OperatingValue, ...] = ()
    events: tuple[FaultEvent, ...] = ()

    @property
    def finding(self) -> str:
        """Name of the fault, of the group (`a or b`), or ``unknown``; empty without one."""
        return finding_name(self.verdict, self.candidates)


def finding_name(verdict: Verdict, found: tuple[Candidate, ...]) -> str:
    """Return what a finding is called."""
    if verdict in ("named", "group"):
        return " or ".join(sorted(candidate.name for candidate in found))
    return UNKNOWN if verdict == "unknown" else ""
