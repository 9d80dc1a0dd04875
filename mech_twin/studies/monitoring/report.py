# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a whole run: its alarms, each with its diagnosis and the evidence.

Evidence is each feature healthy, measured, and as the fault would change it.
"""

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np

from mech_twin.capabilities.plots import BLUE, GREY, RED, house_style, sheet
from mech_twin.declarations.captions import axis_title
from mech_twin.errors import StudyError
from mech_twin.measurements.measurement_map import Channel, MeasurementMap, fixed
from mech_twin.measurements.runs import MeasuredRun
from mech_twin.measurements.units import is_event
from mech_twin.studies.monitoring.charts import CHARTS
from mech_twin.studies.monitoring.cycle_features import LONGEST_CYCLE, FeatureFeed, FeatureVector, feed_channels
from mech_twin.studies.monitoring.diagnosis import Candidate, Change, Signature, fitted_faults
from mech_twin.studies.monitoring.findings import FaultEvent, FaultLife, Findings
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.operating import OperatingValue
from mech_twin.studies.monitoring.sensing import Seen, first_channels

HALF_95 = 1.96  # half of a 95 % interval, in standard deviations
CURVES, BARS = 3, 16  # features plotted over time, and as changes


class Alarm(NamedTuple):
    """One alarm of a run.

    Attributes
    ----------
    onset_s, alarm_s : float
        Stamps: start of the cycle in which the change began, and end of that in which a chart exceeded its threshold.
    ended_s : float
        Stamp at which the alarm ended, the charts quiet again; nan if it did not end.
    delay_cycles : int
        Number of cycles from the onset to the alarm.
    statistics : dict of str to float
        Chart statistics at the alarm.
    verdict, finding : str
        As in `Findings`, at the end of the alarm.
    candidates : tuple of Candidate
        The best first.
    change : Change or None
        Estimated change of the features; None with too few cycles.
    """

    onset_s: float
    alarm_s: float
    ended_s: float
    delay_cycles: int
    statistics: dict[str, float]
    verdict: str
    finding: str
    candidates: tuple[Candidate, ...]
    change: Change | None = None

    def record(self) -> dict[str, Any]:
        """Return the alarm as a dictionary of JSON values, without the change."""
        return {key: value for key, value in self._asdict().items() if key != "change"}


class JudgedRun(NamedTuple):
    """Result of the monitor for a run.

    Attributes
    ----------
    cycles, skipped : int
        Number of cycles judged, and of those that were not: left out, or a sensor was faulty or silent.
    alarms : tuple of Alarm
        In order of time.
    faults : tuple of FaultLife
        Faults that are not cleared at the end.
    operating : tuple of OperatingValue
        Operating variables that differ from the baseline at the end.
    events : tuple of FaultEvent
        Every change of a fault's state, as a live monitor reports it.
    without_cycle_s : tuple of float
        Begin and end (stamps) of the longest time without a cycle; empty if it was shorter than ten usual cycles.
    missing : tuple of str
        Features that a cycle or more lacked.
    """

    cycles: int
    skipped: int
    alarms: tuple[Alarm, ...]
    faults: tuple[FaultLife, ...]
    operating: tuple[OperatingValue, ...] = ()
    events: tuple[FaultEvent, ...] = ()
    without_cycle_s: tuple[float, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def has_fault(self) -> bool:
        """Whether there was an alarm, or a fault became active."""
        return bool(self.alarms) or bool(self.became_active)

    @property
    def counted(self) -> str:
        """How many cycles were judged, how many were not, and when there were none, as text."""
        left = f", {self.skipped} of {self.cycles + self.skipped} not judged" if self.skipped else ""
        left += f" ({', '.join(self.missing)} missing)" if self.missing else ""
        silent = " to ".join(f"{each:.2f}" for each in self.without_cycle_s)
        return f"{self.cycles} cycles{left}{silent and f', none from {silent} s'}"

    @property
    def became_active(self) -> tuple[FaultEvent, ...]:
        """Each time that a fault became active, in order of time."""
        return tuple(event for event in self.events if event.state == "active")


def judged_run(
    monitor: Monitor, vectors: Iterable[FeatureVector], skipped: int = 0, until_s: float = -np.inf
) -> JudgedRun:
    """Return the monitor's result for the cycles of a run, whose samples end at ``until_s``."""
    alarms: list[Alarm] = []
    events: list[FaultEvent] = []
    cycles, last, ended_s = 0, None, np.inf
    longest, missing = (0.0, 0.0), dict[str, None]()
    for vector in vectors:
        longest = _longer(longest, (ended_s, vector.begin_s))
        ended_s = vector.end_s
        found = monitor.observe(vector)
        events += found.events
        missing |= dict.fromkeys(found.missing)
        cycles += found.charts is not None
        skipped += found.charts is None
        if found.alarm_begins:
            alarms.append(_begun(found))
        elif alarms and np.isnan(alarms[-1].ended_s):
            alarms[-1] = _followed(alarms[-1], found, monitor.change)
        last = found
    faults = () if last is None else last.faults
    longest = _longer(longest, (ended_s, until_s))
    silent = longest if longest[1] - longest[0] > LONGEST_CYCLE * monitor.setup.baseline.period_s else ()
    return JudgedRun(cycles, skipped, tuple(alarms), faults, monitor.operating, tuple(events), silent, tuple(missing))


def _longer(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return other if other[1] - other[0] > one[1] - one[0] else one


def _begun(found: Findings) -> Alarm:
    assert found.charts is not None
    statistics = dict(zip(CHARTS, found.charts.statistics, strict=True))
    return Alarm(found.onset_s, found.time_s, np.nan, found.delay_cycles, statistics, found.verdict, "", ())


def _followed(alarm: Alarm, found: Findings, change: Change | None) -> Alarm:
    if not found.alarm:
        return alarm._replace(ended_s=found.time_s)
    if found.charts is None:
        return alarm
    return alarm._replace(verdict=found.verdict, finding=found.finding, candidates=found.candidates, change=change)


def vectors_of_parts(feed: FeatureFeed, parts: Sequence[MeasuredRun]) -> tuple[FeatureFeed, list[FeatureVector]]:
    """Return the features of a run in parts, the feed restarted at each part, as a live monitor computes them.

    The returned feed counts the cycles that were left out.
    """
    found: list[FeatureVector] = []
    for place, part in enumerate(parts):
        if place:
            feed = feed.begun_anew()
        found += feed_channels(feed, seen_of_run(part), final=place == len(parts) - 1)
    return feed, found


def seen_of_run(run: MeasuredRun, begin_s: float = 0.0) -> Seen:
    """Return the channels (SI) of a measured run from ``begin_s`` after its first sample; the first of each name."""
    found: Seen = {}
    starts = [channel.times_s[0] for channel in run.channels if len(channel.times_s)]
    since_s = min(starts, default=0.0) + begin_s
    for channel in run.channels:
        later = channel.times_s >= since_s
        found.setdefault(channel.name, (channel.times_s[later], channel.values[later]))
    return found


def known_sensors(given: MeasurementMap, run: MeasuredRun) -> MeasurementMap:
    """Return the channels of a map as sensors: rates from the run; zero, gain and lag as far as they are known."""
    rates = {each.channel.source.label: each.quality.rate_hz for each in run.channels}
    return given.model_copy(
        update={"channels": tuple(_known(each, rates[each.source.label]) for each in first_channels(given).values())}
    )


def _known(channel: Channel, rate_hz: float) -> Channel:
    rated = channel.rate_hz is None and not is_event(channel.quantity) and np.isfinite(rate_hz) and rate_hz > 0.0
    numbers = {"zero": fixed(channel.zero, 0.0), "gain": fixed(channel.gain, 1.0), "lag_s": fixed(channel.lag_s, 0.0)}
    return channel.model_copy(update=numbers | ({"rate_hz": float(rate_hz)} if rated else {}))


class FeatureChange(NamedTuple):
    """Change of one feature in an alarm.

    Attributes
    ----------
    name, unit : str
        Name and unit of the feature.
    healthy, sigma : float
        Mean in the baseline, and standard deviation of its innovations from cycle to cycle.
    change, half_95 : float
        Change since the onset, and half of its 95 % interval.
    expected : float
        Change that the fault would cause, at the size that fits the change of all features best.
    """

    name: str
    unit: str
    healthy: float
    sigma: float
    change: float
    half_95: float
    expected: float

    @property
    def moved_sigma(self) -> float:
        """Change, in standard deviations of one cycle."""
        return self.change / self.sigma

    @property
    def left_sigma(self) -> float:
        """Change that the fault does not explain, in standard deviations of one cycle."""
        return (self.change - self.expected) / self.sigma

    def record(self) -> dict[str, Any]:
        """Return the feature as a dictionary of JSON values."""
        return {**self._asdict(), "moved_sigma": self.moved_sigma, "left_sigma": self.left_sigma}


class Explanation(NamedTuple):
    """Evidence for and against a fault in one alarm.

    Attributes
    ----------
    fault : Candidate
        The fault at its best-fitting size, with the share of the change left unexplained.
    explains : bool
        Whether it is among the monitor's candidates.
    finding : str
        Name of the alarm's finding, or its verdict.
    onset_s, cycles : float
        Stamp at which the change began, and number of cycles averaged.
    features : tuple of FeatureChange
        Sorted by the size of the change, largest first.
    """

    fault: Candidate
    explains: bool
    finding: str
    onset_s: float
    cycles: float
    features: tuple[FeatureChange, ...]

    def record(self) -> dict[str, Any]:
        """Return the explanation as a dictionary of JSON values."""
        return {**self._asdict(), "features": [each.record() for each in self.features]}


def known_fault(setup: MonitorSetup, fault: str) -> Signature:
    """Return the signature of a fault.

    Raises
    ------
    StudyError
        The monitor knows no such fault.
    """
    for signature in setup.signatures:
        if signature.name == fault:
            return signature
    known = ", ".join(sorted(each.name for each in setup.signatures))
    raise StudyError(f"fault {fault!r}: expected one of {known}")


def explanation(setup: MonitorSetup, units: Mapping[str, str], alarm: Alarm, fault: str) -> Explanation | None:
    """Return the evidence for and against a fault in an alarm; None if the alarm had too few cycles.

    Raises
    ------
    StudyError
        The monitor knows no such fault.
    """
    signature = known_fault(setup, fault)
    if alarm.change is None:
        return None
    (fit,), delta, baseline = fitted_faults(alarm.change, [signature]), alarm.change.delta, setup.baseline
    found, healthy = fit.candidate, healthy_features(setup)
    means = (healthy[name][0] for name in baseline.names)
    half_95 = HALF_95 * np.sqrt(np.diag(alarm.change.covariance))
    rows = zip(
        baseline.names, means, baseline.sigma, delta, half_95, signature.reaching.response(found.size),
        strict=True,
    )  # fmt: skip
    features = [FeatureChange(name, units.get(name, "1"), *map(float, numbers)) for name, *numbers in rows]
    features.sort(key=lambda each: -abs(each.moved_sigma))
    explains = fault in {candidate.name for candidate in alarm.candidates}
    called = alarm.finding or alarm.verdict
    return Explanation(found, explains, called, alarm.onset_s, alarm.change.cycles, tuple(features))


def healthy_features(setup: MonitorSetup) -> dict[str, tuple[float, float]]:
    """Return mean and standard deviation from cycle to cycle of each healthy feature.

    Means are those before the effect of the operating point is removed, and so are the deviations of its pivots.
    """
    baseline, surface = setup.baseline, setup.operating
    charted = dict(zip(baseline.names, zip(baseline.mean.tolist(), baseline.sigma.tolist(), strict=True), strict=True))
    if surface is None:
        return charted
    noise = np.sqrt(np.diag(np.linalg.inv(surface.root.T @ surface.root))).tolist()
    found = {}
    for name, mean, sigma in zip(surface.names, surface.mean.tolist(), noise, strict=True):
        left, spread = charted.get(name, (0.0, sigma))
        found[name] = (mean + left, spread)
    return found


def drawn_explanation(setup: MonitorSetup, vectors: Sequence[FeatureVector], alarm: Alarm, found: Explanation) -> Any:
    """Return the figure: changes of features and those that the fault predicts; the largest also over time."""
    bars, curves = found.features[:BARS], found.features[:CURVES]
    with house_style():
        figure, all_axes = sheet(1 + len(curves), 1, height=1.6 + 0.2 * len(bars) + 1.6 * len(curves))
        axes, rows = all_axes[0], np.arange(len(bars))[::-1]
        moved, half = [each.moved_sigma for each in bars], [each.half_95 / each.sigma for each in bars]
        axes.errorbar(moved, rows, xerr=half, fmt="o", color=BLUE, markersize=4, label="measured, 95 %")
        expected = [each.expected / each.sigma for each in bars]
        unit = "" if found.fault.unit == "1" else f" {found.fault.unit}"
        label = f"{found.fault.name} of {found.fault.size:.3g}{unit}"
        axes.plot(expected, rows, "x", color=RED, label=label)
        axes.axvline(0.0, color=GREY, linewidth=0.8)
        axes.set_yticks(rows, [each.name for each in bars], fontsize=7.5)
        axes.set_xlabel("change, in standard deviations of a cycle")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        for panel, feature in zip(all_axes[1:], curves, strict=True):
            _draw_over_time(panel, setup, vectors, feature)
            panel.axvline(alarm.onset_s, color=RED, linewidth=1.0)
            panel.axvline(alarm.alarm_s, color=RED, linewidth=1.0, linestyle="--")
        all_axes[-1].set_xlabel("time [s]; band: healthy cycles, 95 %; line: onset; dashed: alarm")
    return figure


def _draw_over_time(panel: Any, setup: MonitorSetup, vectors: Sequence[FeatureVector], feature: FeatureChange) -> None:
    place = setup.baseline.names.index(feature.name)
    offset = feature.healthy - setup.baseline.mean[place]
    seen = vectors if setup.operating is None else [setup.operating.reduced(vector)[0] for vector in vectors]
    values = [vector.values[vector.names.index(feature.name)] + offset for vector in seen]
    panel.plot([vector.end_s for vector in seen], values, ".", color=BLUE, markersize=3)
    half = HALF_95 * _spread(setup, place)
    panel.axhspan(feature.healthy - half, feature.healthy + half, color=GREY, alpha=0.3, linewidth=0.0)
    panel.set_ylabel(fill(axis_title(feature.name, feature.unit), 24), fontsize=7.5)


def _spread(setup: MonitorSetup, place: int) -> float:
    """Return the standard deviation of a healthy feature: that of its innovations times its autoregression's gain."""
    return float(setup.baseline.sigma[place] * np.sqrt((setup.baseline.impulse(400)[:, place] ** 2).sum()))
