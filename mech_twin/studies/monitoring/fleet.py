# SPDX-License-Identifier: Apache-2.0
"""Machines of one kind, each compared with its own baseline and with its sisters.

The comparison with its sisters uses the change s of each feature since the baseline, in standard deviations of one
cycle::

    s_m = (mean of the last cycles - mean of the baseline) / sigma
    z_m = (s_m - median over the fleet) / (1.4826 median of |s - median|)

A change that all sisters share (season, product, supply) is in the median, and not in z.  A machine is an outlier if
|z| exceeds the quantile of Student's distribution for all features and machines together.  For a machine with a finding
of its own, the quantile for its own features suffices to confirm it.  Without that, the cause may be an operating point
that its baseline does not cover.
"""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Literal, NamedTuple

import numpy as np
from scipy.stats import t as student

from mech_twin.capabilities.cycle import Array
from mech_twin.errors import StudyError
from mech_twin.studies.monitoring.baseline import joined_runs
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.diagnosis import Candidate
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.report import Alarm, judged_run

LATE_CYCLES = 200  # newest cycles, whose mean is compared
LEAST_SISTERS = 5
FALSELY_APART = 0.01  # chance of any outlier in a healthy fleet, for normally distributed changes
NORMAL = 1.4826  # standard deviation of a normal quantity over its median absolute deviation
EFFICIENCY = 0.37  # of the median absolute deviation, relative to the standard deviation of normal values
PASSING = "passing"
Verdict = Literal["confirmed", "apart", "alone", "unconfirmed", ""]
ORDER: tuple[Verdict, ...] = ("confirmed", "apart", "alone", "unconfirmed", "")  # the most suspect first


class FleetMember(NamedTuple):
    """Result of one machine against its own baseline.

    Attributes
    ----------
    finding : str
        What is active at the end: a fault, a group, ``unknown``; empty if nothing is.
    candidate : Candidate or None
        The fault with its size; None without a single candidate.
    recording : str
        Recording in which the fault began; empty without one.
    onset_s : float
        Stamp of the onset in that recording; nan without one.
    shift : mapping
        Mean change of each feature over the last cycles, in standard deviations of a cycle.
    refused : str
        Reason why it could not be evaluated; empty if it was.
    """

    name: str
    cycles: int = 0
    finding: str = ""
    candidate: Candidate | None = None
    recording: str = ""
    onset_s: float = float("nan")
    shift: Mapping[str, float] = {}
    refused: str = ""


class Sister(NamedTuple):
    """Result of one machine compared with its sisters.

    Attributes
    ----------
    member : FleetMember
        Result against its own baseline.
    feature : str
        Feature with the largest magnitude of z.
    apart : float
        z of that feature; nan with too few sisters.
    verdict : str
        ``confirmed`` (a finding, and an outlier), ``apart`` (an outlier without a finding), ``alone`` (a finding,
        and too few sisters to compare with), ``unconfirmed`` (a finding, but no outlier), or empty.
    """

    member: FleetMember
    feature: str
    apart: float
    verdict: Verdict

    @property
    def is_suspect(self) -> bool:
        """Whether the machine should be inspected."""
        return self.verdict in ("confirmed", "apart", "alone")


class Fleet(NamedTuple):
    """Results of a fleet, the most suspect machine first.

    Attributes
    ----------
    sisters : tuple of Sister
        Machines that were evaluated.
    refused : tuple of FleetMember
        Machines that could not be evaluated.
    limit : float
        Limit of |z| beyond which a machine is an outlier; nan with too few sisters.
    confirming : float
        Limit of |z| beyond which a machine's own finding is confirmed.
    common : mapping
        Median change of each feature, in standard deviations of a cycle.
    """

    sisters: tuple[Sister, ...]
    refused: tuple[FleetMember, ...]
    limit: float
    confirming: float
    common: Mapping[str, float]


def judged_member(name: str, setup: MonitorSetup, recordings: Mapping[str, Sequence[FeatureVector]]) -> FleetMember:
    """Return the result of a machine's recordings, given by name in order, against its own baseline."""
    monitor, cycles, number = Monitor(setup), 0, 0
    alarms: list[tuple[str, Alarm]] = []
    for recording, vectors in recordings.items():
        apart = joined_runs([[vectors[0]._replace(number=number)], vectors])[1:]
        number = apart[-1].number
        found = judged_run(monitor, apart)
        cycles += found.cycles
        alarms += [(recording, alarm) for alarm in found.alarms if alarm.verdict != PASSING]
    shift = late_shift(setup, [vector for vectors in recordings.values() for vector in vectors])
    if not (cycles or monitor.lives):
        raise StudyError("no cycle could be judged: each lacks a feature, or the history of one")
    active = [life.name for life in monitor.lives.values() if life.state == "active"]
    if not active:
        return FleetMember(name, cycles, shift=shift)
    finding = active[-1]
    recording, alarm = next(((where, each) for where, each in reversed(alarms) if each.finding == finding), ("", None))
    if alarm is None:
        return FleetMember(name, cycles, finding, shift=shift)
    only = alarm.candidates[0] if len(alarm.candidates) == 1 else None
    return FleetMember(name, cycles, finding, only, recording, alarm.onset_s, shift)


def late_shift(setup: MonitorSetup, vectors: Sequence[FeatureVector]) -> dict[str, float]:
    """Return the mean change of each feature over the last cycles, without the operating point's effect if modelled."""
    baseline, surface = setup.baseline, setup.operating
    late = [vector if surface is None else surface.reduced(vector)[0] for vector in vectors[-LATE_CYCLES:]]
    rows, found = np.array([vector.row(baseline.names) for vector in late]), {}
    for i, name in enumerate(baseline.names):
        known = rows[np.isfinite(rows[:, i]), i]
        if len(known):
            found[name] = float((np.mean(known) - baseline.mean[i]) / baseline.sigma[i])
    return found


def fleet_of(members: Sequence[FleetMember]) -> Fleet:
    """Return the machines compared with each other, the most suspect first."""
    known = [member for member in members if not member.refused]
    refused = tuple(member for member in members if member.refused)
    names = [name for name in (known[0].shift if known else ()) if all(name in member.shift for member in known)]
    shifts = np.array([[member.shift[name] for name in names] for member in known]).reshape(len(known), len(names))
    if len(known) < LEAST_SISTERS or not names:
        nan = float("nan")
        alone = [Sister(member, "", nan, "alone" if member.finding else "") for member in known]
        return Fleet(tuple(sorted(alone, key=_order)), refused, nan, nan, {})
    middle = np.median(shifts, axis=0)
    apart = (shifts - middle) / _spread(shifts - middle)
    chances = 0.5 * FALSELY_APART / np.array([apart.size, len(names)])
    limit, confirming = student.isf(chances, EFFICIENCY * (len(known) - 1)).tolist()
    farthest = np.abs(apart).argmax(axis=1)
    sisters = [
        Sister(member, names[place], float(row[place]), _verdict(member, abs(row[place]), limit, confirming))
        for member, row, place in zip(known, apart, farthest, strict=True)
    ]
    common = dict(zip(names, middle.tolist(), strict=True))
    return Fleet(tuple(sorted(sisters, key=_order)), refused, limit, confirming, common)


def _verdict(member: FleetMember, apart: float, limit: float, confirming: float) -> Verdict:
    if member.finding:
        return "confirmed" if apart > confirming else "unconfirmed"
    return "apart" if apart > limit else ""


def _spread(left: Array) -> Array:
    """Return the robust standard deviation of each feature over the fleet, at least that of the mean of late cycles."""
    return np.asarray(np.maximum(NORMAL * np.median(np.abs(left), axis=0), 1.0 / np.sqrt(LATE_CYCLES)))


def _order(sister: Sister) -> tuple[int, float, str]:
    apart = abs(sister.apart) if isfinite(sister.apart) else 0.0
    return (ORDER.index(sister.verdict), -apart, sister.member.name)
