# SPDX-License-Identifier: Apache-2.0
r"""Result of one cycle: the verdict with its candidates, the changes of state of faults, and the alerts sent out.

There is one alert per fault, the same for every outlet.  A fault on the panel is a state machine::

    cleared --seen--> pending --seen for `debounce` cycles--> active --not seen for `clear` cycles--> latched
       ^                 |                                       |  \--acknowledged before-->  cleared
       |<---not seen-----+                                       |<--------- seen again --------+
       |<--------------------------- acknowledged ----------------------------------------------+

A latched fault has gone but is not acknowledged.  A shelved one changes state, but is not announced until a stamp.
The states are those of an alarm in ISA-18.2 (normal, unacknowledged, acknowledged, returned unacknowledged, shelved).
"""

from collections.abc import Iterable
from math import isfinite, nan
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import Size
from mech_twin.studies.monitoring.charts import ChartValues
from mech_twin.studies.monitoring.diagnosis import Candidate
from mech_twin.studies.monitoring.operating import OperatingValue

State = Literal["cleared", "pending", "active", "latched"]
UNKNOWN = "unknown"
Verdict = Literal["learning", "healthy", "operating_point", "pending", "named", "group", "unknown", "passing"]


class LifeRules(NamedTuple):
    """Cycles with the fault until it is active, cycles without until it clears; least time between announcements."""

    debounce: Annotated[int, Field(ge=1)] = 3
    clear: Annotated[int, Field(ge=1)] = 10
    announce_every_s: Size = 600.0


class FaultLife(NamedTuple):
    """A fault and its state.

    Attributes
    ----------
    name : str
        Name of the fault, or of the group of faults.
    state : str
        ``cleared``, ``pending``, ``active`` or ``latched``.
    since_s : float
        Stamp at which it entered this state.
    cycles : int
        Consecutive cycles counted towards the next state.
    is_acknowledged : bool
        Whether it was acknowledged since it became active.
    shelved_until_s : float
        Stamp until which it is not announced.
    candidates : tuple of Candidate
        Faults that explained the change when it was last seen, best first.
    """

    name: str
    state: State = "cleared"
    since_s: float = 0.0
    cycles: int = 0
    is_acknowledged: bool = False
    shelved_until_s: float = float("-inf")
    candidates: tuple[Candidate, ...] = ()

    def is_announced(self, time_s: float) -> bool:
        """Return whether it is shown to the operator: active or latched, not shelved."""
        return self.state in ("active", "latched") and time_s >= self.shelved_until_s


def after_cycle(life: FaultLife, seen: bool, time_s: float, rules: LifeRules) -> FaultLife:
    """Return the fault after a cycle that ended at ``time_s``; ``seen`` is whether it was observed in it."""
    if life.state == "active":
        if seen or life.cycles + 1 < rules.clear:
            return life._replace(cycles=0 if seen else life.cycles + 1)
        return _moved(life, "cleared" if life.is_acknowledged else "latched", time_s)
    if not seen:
        return _moved(life, "cleared", time_s) if life.state == "pending" else life
    cycles = life.cycles + 1 if life.state == "pending" else 1
    if life.state == "latched" or cycles >= rules.debounce:
        return _moved(life, "active", time_s)._replace(is_acknowledged=False)
    return life._replace(cycles=cycles) if life.state == "pending" else _moved(life, "pending", time_s, cycles)


def acknowledged(life: FaultLife, time_s: float) -> FaultLife:
    """Return the fault after acknowledgement: a latched one is cleared, an active one stays active."""
    if life.state == "latched":
        return _moved(life, "cleared", time_s)
    return life._replace(is_acknowledged=True) if life.state == "active" else life


def shelved(life: FaultLife, until_s: float) -> FaultLife:
    """Return the fault shelved until a stamp (s)."""
    return life._replace(shelved_until_s=until_s)


def _moved(life: FaultLife, state: State, time_s: float, cycles: int = 0) -> FaultLife:
    return life._replace(state=state, since_s=time_s, cycles=cycles)


class FaultEvent(NamedTuple):
    """A change of a fault's state at a stamp; ``because`` gives the reason, if not the charts, or a sensor's size."""

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
        Operating variables that differ from the baseline; in an alarm those beyond their ranges.
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


class Alert(NamedTuple):
    """A fault as it is shown to people who are not at the terminal.

    Attributes
    ----------
    machine, name, state : str
        Name of the machine, of the fault, and the fault's state.
    since_s : float
        Time by the machine's clock at which it entered that state.
    size, low_95, high_95 : float or None
        Estimate and 95 % interval of the best candidate, in ``unit``; None where there is no estimate.
    unit, size_of : str
        Of the size, and the fault of a group whose size it is.
    acknowledged : bool
        Whether an operator has acknowledged it.
    alarm : bool
        Whether it calls for action: active or latched, neither acknowledged nor shelved.
    """

    machine: str
    name: str
    state: str
    since_s: float
    size: float | None
    low_95: float | None
    high_95: float | None
    unit: str
    size_of: str
    acknowledged: bool
    alarm: bool


def alerts_of(machine: str, lives: Iterable[FaultLife], now_s: float, origin_s: float = 0.0) -> tuple[Alert, ...]:
    """Return one alert per fault, cleared ones included, so that an outlet can remove them.

    Parameters
    ----------
    now_s : float
        Current stamp; it decides whether a fault is still shelved.
    origin_s : float
        Time by the machine's clock at stamp 0.
    """
    alerts = []
    for life in lives:
        best = life.candidates[0] if life.candidates else Candidate("", nan, nan, nan, "", nan)
        size, low, high = (each if isfinite(each) else None for each in best[1:4])
        alarm = life.is_announced(now_s) and not life.is_acknowledged
        since_s = origin_s + life.since_s
        sized = (size, low, high, best.unit, best.name)
        alerts.append(Alert(machine, life.name, life.state, since_s, *sized, life.is_acknowledged, alarm))
    return tuple(alerts)
