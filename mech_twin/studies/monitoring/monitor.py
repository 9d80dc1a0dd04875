# SPDX-License-Identifier: Apache-2.0
"""The monitor: feature vectors in, findings out, cycle by cycle; the same live and on a recording.

::

    monitor = Monitor(setup)                  # setup: baseline, thresholds, signatures; frozen, and a JSON file
    for vector in feed.feed(column, times_s, values):
        findings = monitor.observe(vector)

Nothing here reads a clock: all times are stamps of samples.
"""

from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from pydantic import ConfigDict

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import Baseline, Count, Origin
from mech_twin.studies.monitoring.charts import WINDOW, ChartLimits, ChartState, ChartValues
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.diagnosis import (
    MODEL_SHARE,
    Candidate,
    Change,
    Signature,
    candidates,
    change_has_cleared,
    estimated_change,
    mean_change,
)
from mech_twin.studies.monitoring.findings import (
    FaultEvent,
    FaultLife,
    Findings,
    LifeRules,
    Verdict,
    acknowledged,
    after_cycle,
    finding_name,
    shelved,
)
from mech_twin.studies.monitoring.operating import (
    OUTSIDE,
    SETTLED_CYCLES,
    OperatingSurface,
    OperatingTrack,
    OperatingValue,
)
from mech_twin.studies.monitoring.sensor_quality import SensorFinding, SensorLimits, sensor_findings

SENSOR, NO_FAULT = "sensor_", FaultLife("")
CAP = 2.0  # upper bound of the CUSUMs, in thresholds
FARTHEST_SIGMA = 1e6  # bound of a feature about its mean: a sample of 1e300 must not stay in the charts
SILENT = 25  # cycles in a row in which a channel is silent, such as that of impacts: at one in two by chance in 10^7
REMEMBERED = 150  # cycles of innovations kept for the diagnosis
LEAST_NAMED = 6  # cycles after the settling before a change is diagnosed
UNKNOWN_AFTER = 25  # cycles after the settling before it may be called unknown
ONSET_CYCLES = 40  # after the alarm, in which the estimate of the onset is still updated
NAMED_EACH_CYCLE, NAMED_EVERY = 25, 5  # diagnosis in each cycle after the alarm, later in every fifth
NAMING_CYCLES = 80  # after the alarm; later the newest so many tell whether the fault has grown


@dataclass(frozen=True)
class MonitorSetup:
    """Frozen settings of a monitor: machine, healthy baseline, thresholds, and the effect of each fault."""

    __pydantic_config__ = ConfigDict(strict=True, allow_inf_nan=False)

    machine: str
    baseline: Baseline
    limits: ChartLimits
    signatures: tuple[Signature, ...] = ()
    settling_cycles: Count = 5
    rules: LifeRules = field(default_factory=LifeRules)
    operating: OperatingSurface | None = None
    sensors: Mapping[str, SensorLimits] = field(default_factory=dict)
    origin: Origin | None = None

    @property
    def arl0_h(self) -> float:
        """Mean time between false alarms for which the thresholds were computed, in hours."""
        return self.limits.arl0_cycles * self.baseline.period_s / 3600.0


@dataclass
class _Episode:
    """An alarm in progress: index of its first cycle and of the onset, cycles since, consecutive quiet cycles.

    ``beyond``: no chart has seen it, an operating variable is beyond its range.
    """

    began: int
    onset: int
    onset_s: float
    beyond: bool = False
    age: int = 0
    quiet: int = 0
    finding: str = ""
    named: tuple[Verdict, tuple[Candidate, ...]] = ("pending", ())
    change: Change | None = None

    @property
    def delay(self) -> int:
        """Number of cycles from the onset to the alarm."""
        return max(0, self.began - self.onset + 1)


@dataclass
class Monitor:
    """Evaluates cycle by cycle; the object holds all state, and equal inputs give equal findings."""

    setup: MonitorSetup
    lives: dict[str, FaultLife] = field(default_factory=dict)
    _history: deque[Array] = field(default_factory=deque)
    _innovations: deque[tuple[int, float, Array, FeatureVector]] = field(
        default_factory=lambda: deque(maxlen=REMEMBERED)
    )
    _episode: _Episode | None = None
    _suspected: Array | None = None  # innovations of a cycle beyond the limits, if an alarm waits for the next
    _number: int | None = None
    _announced_s: float = float("-inf")
    _events: list[FaultEvent] = field(default_factory=list)
    _lacked: dict[str, int] = field(default_factory=dict)  # features of a silent channel, and in how many cycles by now

    def __post_init__(self) -> None:
        baseline = self.setup.baseline
        self._charts = ChartState(len(baseline.names), CAP * self.setup.limits.alarm[0])
        self._root = np.linalg.inv(np.linalg.cholesky(baseline.covariance))
        farthest = FARTHEST_SIGMA * baseline.sigma
        self._believed = baseline.mean - farthest, baseline.mean + farthest
        surface = self.setup.operating
        self._track = None if surface is None else OperatingTrack(surface)
        self._steady = 1.0 + np.abs(baseline.coefficients).sum(axis=0)
        self._off = np.zeros(len(baseline.names))
        self._nothing = np.full(len(baseline.names), np.nan)  # innovations of a cycle that is not judged

    def observe(self, vector: FeatureVector) -> Findings:
        """Take the features of the next cycle; return the findings."""
        self._events.clear()
        found = self._observed(vector)
        return found._replace(events=tuple(self._events))

    def _observed(self, vector: FeatureVector) -> Findings:
        baseline, surface = self.setup.baseline, self.setup.operating
        wrong = sensor_findings(self.setup.sensors, vector.end_s - vector.begin_s, vector.quality)
        if wrong:
            return self._with_wrong_sensor(vector, wrong)
        point, whole = None, vector
        if surface is not None:
            vector, point = surface.reduced(vector)
        row = vector.row(baseline.names)
        names = baseline.names if surface is None else surface.names  # one that lacks leaves no residual at all
        missing = tuple(name for name in names if not np.isfinite(whole.row([name])[0]))
        self._lacked = {name: self._lacked.get(name, 0) + 1 for name in missing if name in vector.silent}
        silent = [SensorFinding("dropout", name, 1.0) for name, cycles in self._lacked.items() if cycles >= SILENT]
        if silent:
            return self._with_wrong_sensor(whole, tuple(silent))
        if self._number is not None and vector.number != self._number + 1:
            self._history.clear()
        self._number = vector.number
        if missing:
            self._history.clear()
            return self._unjudged(vector, missing)
        if self._track is not None and point is not None:
            self._off = self._track.advance(point)
        self._history.append(np.clip(row, *self._believed))
        if len(self._history) <= baseline.order:
            return self._unjudged(vector)
        innovation = baseline.innovations(np.array(self._history))[-1]
        self._history.popleft()
        return self._judged(vector, innovation, whole)

    def acknowledge(self, name: str, time_s: float) -> None:
        """Acknowledge a fault.

        Raises
        ------
        KeyError
            There is no such fault.
        """
        self.lives[name] = acknowledged(self.lives[name], time_s)

    def shelve(self, name: str, until_s: float) -> None:
        """Do not announce a fault until a stamp (s).

        Raises
        ------
        KeyError
            There is no such fault.
        """
        self.lives[name] = shelved(self.lives[name], until_s)

    def _unjudged(self, vector: FeatureVector, missing: tuple[str, ...] = ()) -> Findings:
        return Findings(
            vector.number, vector.end_s, self.setup.baseline.names, self._nothing, None,
            alarm=self._episode is not None, faults=self._living(), missing=missing,
        )  # fmt: skip

    def _with_wrong_sensor(self, vector: FeatureVector, wrong: tuple[SensorFinding, ...]) -> Findings:
        """Report the sensor fault; forget an alarm that is not active yet, which the sensor may have caused."""
        self._number = vector.number
        self._history.clear()
        self._suspected = None
        if self._episode is None or self.lives.get(self._episode.finding, NO_FAULT).state != "active":
            self._episode = None
            self._charts.restart()
            self._innovations.clear()
        first = wrong[0]
        for name, life in self.lives.items():  # a pending diagnosis was caused by the sensor
            if life.state == "pending" and not name.startswith(SENSOR):
                self._events.append(FaultEvent(vector.end_s, name, "withdrawn", f"it is {first.name}"))
                self.lives[name] = FaultLife(name, "cleared", vector.end_s)
        sensors = {name for name in self.lives if name.startswith(SENSOR)}
        found = (Candidate(first.name, first.size, first.size, first.size, "1", 0.0),)
        announce = self._live_on(first.name, found, vector.end_s, {first.name, *sensors}, f"size {first.size:.4g}")
        return Findings(
            vector.number, vector.end_s, self.setup.baseline.names, self._nothing, None, self._episode is not None,
            verdict="named", onset_s=vector.begin_s, candidates=found, faults=self._living(), announce=announce,
        )  # fmt: skip

    def _judged(self, vector: FeatureVector, innovation: Array, whole: FeatureVector) -> Findings:
        standard = innovation / self.setup.baseline.sigma
        suspected, self._suspected = self._suspected, None
        if suspected is not None and self._track is not None and self._track.moves:
            self._charts.restart()
            self._charted(suspected)
        charts = self._charted(innovation)
        self._innovations.append((vector.number, vector.begin_s, innovation, whole))
        begins = self._follow_episode(vector, charts, waited=suspected is not None)
        episode = self._episode
        verdict: Verdict = "operating_point" if self.operating else "healthy"
        found: tuple[Candidate, ...] = ()
        if episode is not None:
            often = episode.age <= NAMED_EACH_CYCLE or episode.age % NAMED_EVERY == 0
            if often and not episode.quiet:
                episode.named = self._named(episode)
            verdict, found = episode.named
        announce = self._live_on(finding_name(verdict, found), found, vector.end_s)
        self._withdraw(finding_name(verdict, found), vector.end_s)
        onset_s, delay = (float("nan"), 0) if episode is None else (episode.onset_s, episode.delay)
        return Findings(
            vector.number, vector.end_s, self.setup.baseline.names, standard, charts, episode is not None, begins,
            verdict, onset_s, delay, found, self._living(), (), announce, self.operating,
        )  # fmt: skip

    @property
    def operating(self) -> tuple[OperatingValue, ...]:
        """Operating variables that differ from the baseline.

        The point is estimated for a healthy machine, and a fault moves the estimate.  So in an alarm there are only
        those that are named, and those that are too far outside their ranges for what is named.
        """
        changed = () if self._track is None else self._track.changed()
        if self._episode is None:
            return changed
        found = self._episode.named[1]
        names = {name for candidate in found for name in candidate.name.split(" or ")}
        named = tuple(value for value in changed if names.intersection(value.beyond.split(" or ")))
        if named or not found:
            return named
        apart = (value for value in changed if value.is_outside)
        return tuple(value for value in apart if not any(self._moves(each, value) for each in found))

    @property
    def _outside(self) -> tuple[OperatingValue, ...]:
        return () if self._track is None else self._track.outside

    @property
    def change(self) -> Change | None:
        """Estimated change of the features in the present alarm; None without one."""
        return None if self._episode is None else self._episode.change

    def _charted(self, innovation: Array) -> ChartValues:
        """Return the charts after a cycle, whose innovations count beyond the error of the operating point."""
        seen = np.sign(innovation) * np.maximum(np.abs(innovation) - self._steady * self._off, 0.0)
        return self._charts.advance(seen / self.setup.baseline.sigma, self._root @ seen)

    def _follow_episode(self, vector: FeatureVector, charts: ChartValues, *, waited: bool) -> bool:
        """Start, update or end the alarm; return whether it starts.

        The cycle in which the operating point steps is a mixture, and only the next shows where the point is.
        """
        limits = self.setup.limits
        charted = any(value > limit for value, limit in zip(charts.statistics, limits.alarm, strict=True))
        beyond = bool(self._outside)
        if self._episode is None:
            over = charted or beyond
            if self._track is not None:
                if over and not waited:
                    self._suspected, over = self._innovations[-1][2], False
                over = over or (waited and not self._track.moves)
            if over:
                moved = self._track.cycles if self._track is not None and beyond and not charted else 0
                self._episode = _Episode(vector.number, *self._onset(moved or charts.jump_cycles), bool(moved))
            return over
        episode = self._episode
        episode.age += 1
        episode.beyond = episode.beyond and not charted
        if episode.age <= ONSET_CYCLES and charts.jump_cycles < WINDOW and not episode.beyond:
            episode.onset, episode.onset_s = self._onset(charts.jump_cycles)
        quiet = all(value <= limit for value, limit in zip(charts.statistics, limits.quiet, strict=True))
        episode.quiet = episode.quiet + 1 if quiet and not beyond else 0
        if episode.quiet >= self.setup.rules.clear:
            self._episode = None
            self._charts.restart()
        return False

    def _onset(self, cycles: int) -> tuple[int, float]:
        """Return index and stamp of the cycle in which a change of this age in cycles began."""
        number, onset_s, *_ = self._innovations[-min(max(cycles, 1), len(self._innovations))]
        return number, onset_s

    def _named(self, episode: _Episode) -> tuple[Verdict, tuple[Candidate, ...]]:
        baseline, settling, late = self.setup.baseline, self.setup.settling_cycles, episode.age > NAMING_CYCLES
        since = [each for each in self._innovations if each[0] >= episode.onset]
        since = since[-NAMING_CYCLES:] if late else since
        rows, change = np.array([innovation for *_, innovation, _ in since]), None
        if late:
            change = mean_change(baseline, rows)
        elif len(rows) >= settling + LEAST_NAMED:
            change = estimated_change(baseline, rows, settling)
        if change is None:
            return "pending", ()
        change, before, known = change.doubted(self._off), episode.change, episode.named
        if not late and before and known[1] and change.lasts and change_has_cleared(baseline, before, rows):
            return known
        found = self._explained(change, [whole for *_, whole in since[0 if late else settling :]])
        if late and not (found[1] and (not known[1] or before is None or change.exceeds(before))):
            return known
        episode.change = change
        return found

    def _explained(self, change: Change, cycles: Sequence[FeatureVector]) -> tuple[Verdict, tuple[Candidate, ...]]:
        outside = tuple(value.candidate for value in self._outside)
        if not change.lasts:
            return ("named", outside[:1]) if outside else ("passing", ())
        found = candidates(change, self.setup.signatures)
        moving = tuple(each for each in found if all(self._moves(each, value) for value in self._outside))
        if outside and not moving and self._moved_alone(cycles):
            return "named", outside[:1]
        found = moving or found
        if not found:
            return ("unknown" if len(cycles) >= UNKNOWN_AFTER else "pending"), ()
        return ("named" if len(found) == 1 else "group"), found

    def _moves(self, fault: Candidate, value: OperatingValue) -> bool:
        """Return whether a fault is taken for a variable so far outside its range, one within its range added."""
        surface, known = self.setup.operating, (each for each in self.setup.signatures if each.name == fault.name)
        signature = next(known, None)
        if surface is None or signature is None or not len(signature.points):
            return True  # a setup of an earlier version does not tell
        drawn = [np.interp(fault.size, signature.sizes, points) for points in signature.points.T]
        own = surface.freed(np.array(drawn), SETTLED_CYCLES)[0][surface.variables.index(value.name)]
        return bool(abs(value.share / value.range - own) <= OUTSIDE)

    def _moved_alone(self, cycles: Sequence[FeatureVector]) -> bool:
        """Return whether operating variables, moved on, leave no more of a change than the model error."""
        surface = self.setup.operating
        assert surface is not None
        return surface.open_share(np.mean([each.row(surface.names) for each in cycles], axis=0)) <= MODEL_SHARE**2

    def _live_on(
        self,
        seen: str,
        found: tuple[Candidate, ...],
        time_s: float,
        judged: Collection[str] | None = None,
        because: str = "",
    ) -> bool:
        """Advance the state of every fault, or of those in ``judged``; return whether to announce one now.

        ``because`` is said with a change of state of the one that is seen.
        """
        if seen and seen not in self.lives:
            self.lives[seen] = FaultLife(seen)
        announce = False
        for name, life in self.lives.items():
            if judged is not None and name not in judged:
                continue
            later = after_cycle(life, name == seen, time_s, self.setup.rules)
            self.lives[name] = later._replace(candidates=found) if name == seen else later
            if later.state != life.state:
                self._events.append(FaultEvent(time_s, name, later.state, because if name == seen else ""))
            rises = later.state == "active" and life.state in ("pending", "cleared")
            if rises and later.is_announced(time_s) and time_s - self._announced_s >= self.setup.rules.announce_every_s:
                announce, self._announced_s = True, time_s
        return announce

    def _withdraw(self, finding: str, time_s: float) -> None:
        """Clear the earlier diagnosis of the same alarm: a better one is not a second fault."""
        episode = self._episode
        if episode is None or not finding:
            return
        if episode.finding and episode.finding != finding:
            if self.lives[episode.finding].state != "cleared":
                self._events.append(FaultEvent(time_s, episode.finding, "withdrawn", f"it is {finding}"))
            self.lives[episode.finding] = FaultLife(episode.finding, "cleared", time_s)
        episode.finding = finding

    def _living(self) -> tuple[FaultLife, ...]:
        return tuple(life for life in self.lives.values() if life.state != "cleared")
