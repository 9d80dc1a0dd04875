# SPDX-License-Identifier: Apache-2.0
"""Result of one cycle: the verdict with its candidates, and the changes of state of faults."""

from __future__ import annotations

from typing import Literal, NamedTuple

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.charts import ChartValues
from mech_twin.studies.monitoring.fault_life import FaultLife
from mech_twin.studies.monitoring.naming import Candidate
from mech_twin.studies.monitoring.operating import OperatingValue

UNKNOWN = "unknown"
Verdict = Literal["learning", "healthy", "operating_point", "pending", "named", "group", "unknown", "passing"]


class FaultEvent(NamedTuple):
    """A change of a fault's state at a stamp; ``because`` gives the reason if it was not the charts."""

    time_s: float
    name: str
    state: str
    because: str = ""

    @property
    def text(self) -> str:
        """One line of text, the same live and from a recording."""
        return f"{self.time_s:.3f} s: {self.name} {self.state}{f': {self.because}' if self.because else ''}"


class Findings(NamedTuple):
    """Result of the monitor after a cycle.

    Attributes
    ----------
    number : int
        Index of the cycle.
    time_s : float
        Stamp of the cycle's end.
    names : tuple of str
        Features of the baseline.
    standard : ndarray
        Shape (d,): innovations over their standard deviations; nan where a feature or the history is missing.
    charts : ChartValues or None
        Chart statistics; None if the cycle could not be evaluated.
    alarm : bool
        Whether a chart exceeds its threshold, or did and is not quiet yet.
    alarm_begins : bool
        Whether the alarm began in this cycle; the required false-alarm rate counts these.
    verdict : str
        ``learning`` (history is missing), ``healthy``, ``operating_point`` (healthy at another one), ``pending``
        (alarm, not diagnosed yet), ``named``, ``group``,
        ``unknown``, ``passing`` (a transient change that did not last).
    onset_s : float
        Stamp of the cycle in which the change began; nan without an alarm.
    delay_cycles : int
        Cycles from the onset to the alarm.
    candidates : tuple of Candidate
        Faults that explain the change, best first.
    faults : tuple of FaultLife
        All faults that are not cleared.
    missing : tuple of str
        Features of the baseline that this cycle lacks.
    announce : bool
        Whether to notify an operator now; at most once in ``LifeRules.announce_every_s``.
    operating : tuple of OperatingValue
        Operating variables that differ from the baseline.
    events : tuple of FaultEvent
        Changes of state in this cycle.
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
        """Name of the fault, of the group (`a or b`), or ``unknown``; otherwise empty."""
        return finding_name(self.verdict, self.candidates)


def finding_name(verdict: Verdict, found: tuple[Candidate, ...]) -> str:
    """Return the name of a finding: the candidates joined by "or", ``unknown``, or empty."""
    if verdict in ("named", "group"):
        return " or ".join(sorted(candidate.name for candidate in found))
    return UNKNOWN if verdict == "unknown" else ""
