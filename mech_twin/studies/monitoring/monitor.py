# SPDX-License-Identifier: Apache-2.0
"""The monitor: feature vectors in, findings out, cycle by cycle; the same live and on a recording.

::

    monitor = Monitor(setup)                  # setup: baseline, thresholds, signatures; frozen, and a JSON file
    for vector in feed.feed(column, times_s, values):
        findings = monitor.observe(vector)

Nothing here reads a clock: times are the stamps of the samples.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import Baseline, baseline_of_record
from mech_twin.studies.monitoring.charts import WINDOW, ChartState, ChartValues
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.fault_life import FaultLife, LifeRules, acknowledged, after_cycle, shelved
from mech_twin.studies.monitoring.naming import (
    Candidate,
    Signature,
    candidates,
    estimated_change,
    signature_of_record,
)
from mech_twin.studies.monitoring.thresholds import ChartLimits, limits_of_record

UNKNOWN = "unknown"
CAP = 2.0  # of the threshold: bound of the CUSUMs
FARTHEST_SIGMA = 1e6  # of a feature from its mean: a sample of 1e300 must not stay in the charts
REMEMBERED = 150  # cycles of innovations kept for naming
LEAST_NAMED = 6  # cycles beyond the settling from which a change is named
UNKNOWN_AFTER = 25  # cycles beyond the settling from which it may be called unknown
ONSET_CYCLES = 40  # after the alarm, in which the onset is still moved to where the jump is seen best
NAMED_EACH_CYCLE, NAMED_EVERY = 25, 5  # after the alarm a change is named in each cycle, later in every fifth
NAMING_CYCLES = 80  # after the alarm, in which a name may still change; then it stands
Verdict = Literal["learning", "healthy", "pending", "named", "group", "unknown", "passing"]


@dataclass(frozen=True)
class MonitorSetup:
    """What a monitor needs, frozen: which machine, its healthy reference, thresholds, and what each fault does."""

    machine: str
    baseline: Baseline
    limits: ChartLimits
    signatures: tuple[Signature, ...] = ()
    settling_cycles: int = 5
    rules: LifeRules = field(default_factory=LifeRules)

    @property
    def arl0_h(self) -> float:
        """Mean time between false alarms that the thresholds are for, in hours."""
        return self.limits.arl0_cycles * self.baseline.period_s / 3600.0

    def record(self) -> dict[str, Any]:
        """Return the setup as JSON values; `setup_of_record` inverts that."""
        return {
            "machine": self.machine,
            "baseline": self.baseline.record(),
            "limits": self.limits.record(),
            "signatures": [signature.record() for signature in self.signatures],
            "settling_cycles": self.settling_cycles,
            "rules": self.rules._asdict(),
        }


def setup_of_record(record: Mapping[str, Any]) -> MonitorSetup:
    """Return the setup of its record.

    Raises
    ------
    KeyError
        A key is missing.
    """
    return MonitorSetup(
        str(record["machine"]),
        baseline_of_record(record["baseline"]),
        limits_of_record(record["limits"]),
        tuple(signature_of_record(each) for each in record["signatures"]),
        int(record["settling_cycles"]),
        LifeRules(**record["rules"]),
    )


class Findings(NamedTuple):
    """What the monitor says after a cycle.

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
        ``learning`` (history is missing), ``healthy``, ``pending`` (alarm, not named yet), ``named``, ``group``,
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

    @property
    def finding(self) -> str:
        """Name of the fault, of the group (`a or b`), or ``unknown``; empty without one."""
        return finding_name(self.verdict, self.candidates)


def finding_name(verdict: Verdict, found: tuple[Candidate, ...]) -> str:
    """Return what a finding is called."""
    if verdict in ("named", "group"):
        return " or ".join(sorted(candidate.name for candidate in found))
    return UNKNOWN if verdict == "unknown" else ""


@dataclass
class _Episode:
    """An alarm that is on: cycle it began with, that of the change, cycles since, cycles that were quiet."""

    began: int
    onset: int
    onset_s: float
    age: int = 0
    quiet: int = 0
    finding: str = ""
    named: tuple[Verdict, tuple[Candidate, ...]] = ("pending", ())

    @property
    def delay(self) -> int:
        """Cycles from the onset to the alarm."""
        return max(0, self.began - self.onset + 1)


@dataclass
class Monitor:
    """Judge cycle by cycle; all memory is in this object, and two fed alike say alike."""

    setup: MonitorSetup
    lives: dict[str, FaultLife] = field(default_factory=dict)
    _history: deque[Array] = field(default_factory=deque)
    _innovations: deque[tuple[int, float, Array]] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    _episode: _Episode | None = None
    _number: int | None = None
    _announced_s: float = float("-inf")

    def __post_init__(self) -> None:
        baseline = self.setup.baseline
        self._charts = ChartState(len(baseline.names), CAP * self.setup.limits.alarm[0])
        self._root = np.linalg.inv(np.linalg.cholesky(baseline.covariance))
        farthest = FARTHEST_SIGMA * baseline.sigma
        self._believed = baseline.mean - farthest, baseline.mean + farthest

    def observe(self, vector: FeatureVector) -> Findings:
        """Take the features of the next cycle; return what follows."""
        baseline = self.setup.baseline
        row, missing = _row_of(vector, baseline.names)
        if self._number is not None and vector.number != self._number + 1:
            self._history.clear()
        self._number = vector.number
        if missing:
            self._history.clear()
            return self._unjudged(vector, row, missing)
        self._history.append(np.clip(row, *self._believed))
        if len(self._history) <= baseline.order:
            return self._unjudged(vector, np.full(len(row), np.nan), ())
        innovation = baseline.innovations(np.array(self._history))[-1]
        self._history.popleft()
        return self._judged(vector, innovation)

    def acknowledge(self, name: str, time_s: float) -> None:
        """Say yes to a fault.

        Raises
        ------
        KeyError
            There is no such fault.
        """
        self.lives[name] = acknowledged(self.lives[name], time_s)

    def shelve(self, name: str, until_s: float) -> None:
        """Leave a fault unannounced until a stamp.

        Raises
        ------
        KeyError
            There is no such fault.
        """
        self.lives[name] = shelved(self.lives[name], until_s)

    def _unjudged(self, vector: FeatureVector, standard: Array, missing: tuple[str, ...]) -> Findings:
        nothing = np.full(len(standard), np.nan)
        alarm = self._episode is not None
        found = Findings(vector.number, vector.end_s, self.setup.baseline.names, nothing, None, alarm)
        return found._replace(faults=self._living(), missing=missing)

    def _judged(self, vector: FeatureVector, innovation: Array) -> Findings:
        standard = innovation / self.setup.baseline.sigma
        charts = self._charts.advance(standard, self._root @ innovation)
        self._innovations.append((vector.number, vector.begin_s, innovation))
        begins = self._follow_episode(vector, charts)
        episode = self._episode
        verdict: Verdict = "healthy"
        found: tuple[Candidate, ...] = ()
        if episode is not None:
            often = episode.age <= NAMED_EACH_CYCLE or episode.age % NAMED_EVERY == 0
            if often and episode.age <= NAMING_CYCLES and not episode.quiet:
                episode.named = self._named(episode)
            verdict, found = episode.named
        announce = self._live_on(finding_name(verdict, found), vector.end_s)
        self._withdraw(finding_name(verdict, found), vector.end_s)
        return Findings(
            vector.number,
            vector.end_s,
            self.setup.baseline.names,
            standard,
            charts,
            episode is not None,
            begins,
            verdict,
            float("nan") if episode is None else episode.onset_s,
            0 if episode is None else episode.delay,
            found,
            self._living(),
            (),
            announce,
        )

    def _follow_episode(self, vector: FeatureVector, charts: ChartValues) -> bool:
        """Begin or end the alarm; return whether it begins."""
        limits = self.setup.limits
        if self._episode is None:
            over = any(value > limit for value, limit in zip(charts.statistics, limits.alarm, strict=True))
            if over:
                self._episode = _Episode(vector.number, *self._onset(charts))
            return over
        episode = self._episode
        episode.age += 1
        if episode.age <= ONSET_CYCLES and charts.jump_cycles < WINDOW:
            episode.onset, episode.onset_s = self._onset(charts)
        quiet = all(value <= limit for value, limit in zip(charts.statistics, limits.quiet, strict=True))
        episode.quiet = episode.quiet + 1 if quiet else 0
        if episode.quiet >= self.setup.rules.clear:
            self._episode = None
            self._charts.restart()
        return False

    def _onset(self, charts: ChartValues) -> tuple[int, float]:
        """Return number and stamp of the cycle in which the jump began that the chart sees best."""
        kept = min(max(charts.jump_cycles, 1), len(self._innovations))
        number, onset_s, _ = self._innovations[-kept]
        return number, onset_s

    def _named(self, episode: _Episode) -> tuple[Verdict, tuple[Candidate, ...]]:
        rows = [row for number, _, row in self._innovations if number >= episode.onset]
        settling = self.setup.settling_cycles
        if len(rows) < settling + LEAST_NAMED:
            return "pending", ()
        change = estimated_change(self.setup.baseline, np.array(rows), settling)
        if change is None:
            return "pending", ()
        if not change.lasts:
            return "passing", ()
        found = candidates(change, self.setup.signatures)
        if not found:
            return ("unknown" if len(rows) >= settling + UNKNOWN_AFTER else "pending"), ()
        return ("named" if len(found) == 1 else "group"), found

    def _live_on(self, seen: str, time_s: float) -> bool:
        """Advance the life of every fault; return whether one is to be announced now."""
        if seen and seen not in self.lives:
            self.lives[seen] = FaultLife(seen)
        announce = False
        for name, life in self.lives.items():
            later = after_cycle(life, name == seen, time_s, self.setup.rules)
            self.lives[name] = later
            rises = later.state == "active" and life.state in ("pending", "cleared")
            if rises and later.is_announced(time_s) and time_s - self._announced_s >= self.setup.rules.announce_every_s:
                announce, self._announced_s = True, time_s
        return announce

    def _withdraw(self, finding: str, time_s: float) -> None:
        """Clear what the same alarm was called before: a better name is no second fault."""
        episode = self._episode
        if episode is None or not finding:
            return
        if episode.finding and episode.finding != finding:
            self.lives[episode.finding] = FaultLife(episode.finding, "cleared", time_s)
        episode.finding = finding

    def _living(self) -> tuple[FaultLife, ...]:
        return tuple(life for life in self.lives.values() if life.state != "cleared")


def _row_of(vector: FeatureVector, names: tuple[str, ...]) -> tuple[Array, tuple[str, ...]]:
    """Return the features of the baseline in its order, and those that are missing."""
    known = dict(zip(vector.names, vector.values.tolist(), strict=True))
    row = np.array([known.get(name, np.nan) for name in names])
    if bool(np.isfinite(row).all()):
        return row, ()
    return row, tuple(name for name, value in zip(names, row, strict=True) if not np.isfinite(value))
