# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a whole run: its alarms, each with its diagnosis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from mech_twin.measurements.machine_columns import is_event
from mech_twin.measurements.measurement_map import Channel, MeasurementMap, fixed
from mech_twin.measurements.runs import MeasuredRun
from mech_twin.studies.monitoring.charts import CHARTS
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, FeatureVector, feed_channels
from mech_twin.studies.monitoring.fault_life import FaultLife
from mech_twin.studies.monitoring.findings import FaultEvent, Findings
from mech_twin.studies.monitoring.monitor import Monitor
from mech_twin.studies.monitoring.naming import Candidate, Change
from mech_twin.studies.monitoring.operating import OperatingValue
from mech_twin.studies.monitoring.sensing import Seen, first_channels


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
        Number of cycles evaluated, and left out.
    alarms : tuple of Alarm
        In order of time.
    faults : tuple of FaultLife
        Faults that are not cleared at the end.
    operating : tuple of OperatingValue
        Operating variables that differ from the baseline at the end.
    events : tuple of FaultEvent
        Every change of a fault's state, as a live monitor reports it.
    """

    cycles: int
    skipped: int
    alarms: tuple[Alarm, ...]
    faults: tuple[FaultLife, ...]
    operating: tuple[OperatingValue, ...] = ()
    events: tuple[FaultEvent, ...] = ()

    @property
    def has_fault(self) -> bool:
        """Whether there was an alarm, or a fault became active."""
        return bool(self.alarms) or any(event.state == "active" for event in self.events)


def judged(monitor: Monitor, vectors: Iterable[FeatureVector], skipped: int = 0) -> JudgedRun:
    """Return the monitor's result for the cycles of a run."""
    alarms: list[Alarm] = []
    events: list[FaultEvent] = []
    cycles, last = 0, None
    for vector in vectors:
        found = monitor.observe(vector)
        events += found.events
        cycles += found.charts is not None
        if found.alarm_begins:
            alarms.append(_begun(found))
        elif alarms and np.isnan(alarms[-1].ended_s) and found.charts is not None:
            alarms[-1] = _followed(alarms[-1], found, monitor.change)
        last = found
    faults = () if last is None else last.faults
    return JudgedRun(cycles, skipped, tuple(alarms), faults, monitor.operating, tuple(events))


def _begun(found: Findings) -> Alarm:
    assert found.charts is not None
    statistics = dict(zip(CHARTS, found.charts.statistics, strict=True))
    return Alarm(found.onset_s, found.time_s, np.nan, found.delay_cycles, statistics, found.verdict, "", ())


def _followed(alarm: Alarm, found: Findings, change: Change | None) -> Alarm:
    if not found.alarm:
        return alarm._replace(ended_s=found.time_s)
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
