# SPDX-License-Identifier: Apache-2.0
"""Fleet of machines of one kind, each compared with its own past and with its sisters.

Against itself a machine is judged by its own baseline.  Against its sisters by the change of its features since then,
in standard deviations of one cycle::

    s_m = (mean of the last cycles - mean of the baseline) / sigma
    z_m = (s_m - median over the fleet) / (1.4826 median of |s - median|)

What has moved all sisters alike (season, product, supply) is in the median, and not in z.  A machine is apart beyond
the quantile of Student's distribution, for all features and machines together.  A finding of its own is confirmed
beyond that for the features of one machine: its baseline has seen few operating points, and may be of none of these.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Literal, NamedTuple

import numpy as np
from scipy.stats import t as student

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.naming import Candidate
from mech_twin.studies.monitoring.origin import joined_runs
from mech_twin.studies.monitoring.report import Alarm, judged

LATE_CYCLES = 200  # whose mean is compared
LEAST_SISTERS = 5
FALSELY_APART = 0.01  # chance that any of a healthy fleet is called apart, were the changes normal
NORMAL = 1.4826  # standard deviation of a normal quantity over its median absolute deviation
EFFICIENCY = 0.37  # of the median absolute deviation: it knows a spread as well as so many normal values do
PASSING = "passing"
Verdict = Literal["confirmed", "apart", "unconfirmed", ""]
ORDER: tuple[Verdict, ...] = ("confirmed", "apart", "unconfirmed", "")  # the most suspect first


class FleetMember(NamedTuple):
    """A machine compared with its own baseline.

    Attributes
    ----------
    name : str
        Of the machine.
    cycles : int
        Judged ones.
    finding : str
        Of what is active at the end: a fault, a group, ``unknown``; empty if nothing is.
    candidate : Candidate or None
        The fault's size, where it has one.
    recording : str
        In which it began; empty without one.
    onset_s : float
        Stamp in that recording; nan without one.
    shift : mapping
        Change of each feature over the last cycles, in standard deviations of a cycle.
    refused : str
        Why it could not be judged; empty if it was.
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
    """A machine among its sisters.

    Attributes
    ----------
    member : FleetMember
        Judged against itself.
    feature : str
        The one that is farthest from its sisters'.
    apart : float
        By how much (z); nan where there are too few sisters.
    verdict : str
        ``confirmed`` (a finding of its own, and apart), ``apart`` (without a finding), ``unconfirmed`` (a finding, but
        not apart), or empty.
    """

    member: FleetMember
    feature: str
    apart: float
    verdict: Verdict

    @property
    def is_suspect(self) -> bool:
        """Whether it should be inspected."""
        return self.verdict in ("confirmed", "apart") or (bool(self.member.finding) and not isfinite(self.apart))


class Fleet(NamedTuple):
    """A fleet, the most suspect first.

    Attributes
    ----------
    sisters : tuple of Sister
        Those that were judged.
    refused : tuple of FleetMember
        Those that were not.
    limit : float
        Of z, beyond which a machine is apart; nan where there are too few sisters.
    confirming : float
        Of z, beyond which a machine's own finding is confirmed.
    common : mapping
        Median change of each feature, in standard deviations of a cycle.
    """

    sisters: tuple[Sister, ...]
    refused: tuple[FleetMember, ...]
    limit: float
    confirming: float
    common: Mapping[str, float]


def judged_member(name: str, setup: MonitorSetup, recordings: Mapping[str, Sequence[FeatureVector]]) -> FleetMember:
    """Return what a machine's own baseline says of its recordings, given by name in their order."""
    monitor, cycles, number = Monitor(setup), 0, 0
    alarms: list[tuple[str, Alarm]] = []
    for recording, vectors in recordings.items():
        apart = joined_runs([[vectors[0]._replace(number=number)], vectors])[1:]
        number = apart[-1].number
        found = judged(monitor, apart)
        cycles += found.cycles
        alarms += [(recording, alarm) for alarm in found.alarms if alarm.verdict != PASSING]
    shift = late_shift(setup, [vector for vectors in recordings.values() for vector in vectors])
    active = [life.name for life in monitor.lives.values() if life.state == "active"]
    if not active:
        return FleetMember(name, cycles, shift=shift)
    finding = active[-1]
    recording, alarm = next(((where, each) for where, each in reversed(alarms) if each.finding == finding), ("", None))
    if alarm is None:
        return FleetMember(name, cycles, finding, shift=shift)
    return FleetMember(name, cycles, finding, _only(alarm), recording, alarm.onset_s, shift)


def late_shift(setup: MonitorSetup, vectors: Sequence[FeatureVector]) -> dict[str, float]:
    """Return the change of each feature over the last cycles, the operating point taken out where it is known."""
    baseline, surface = setup.baseline, setup.operating
    late = [vector if surface is None else surface.reduced(vector)[0] for vector in vectors[-LATE_CYCLES:]]
    found = {}
    for i, name in enumerate(baseline.names):
        values = [vector.values[vector.names.index(name)] for vector in late if name in vector.names]
        known = [value for value in values if isfinite(value)]
        if known:
            found[name] = float((np.mean(known) - baseline.mean[i]) / baseline.sigma[i])
    return found


def fleet_of(members: Sequence[FleetMember]) -> Fleet:
    """Return the machines among their sisters, the most suspect first."""
    known = [member for member in members if not member.refused]
    refused = tuple(member for member in members if member.refused)
    names = [name for name in (known[0].shift if known else ()) if all(name in member.shift for member in known)]
    shifts = np.array([[member.shift[name] for name in names] for member in known]).reshape(len(known), len(names))
    if len(known) < LEAST_SISTERS or not names:
        nan = float("nan")
        alone = [Sister(member, "", nan, "unconfirmed" if member.finding else "") for member in known]
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
    """Return by how much healthy sisters differ, not below what the mean of the last cycles may be off."""
    return np.asarray(np.maximum(NORMAL * np.median(np.abs(left), axis=0), 1.0 / np.sqrt(LATE_CYCLES)))


def _only(alarm: Alarm) -> Candidate | None:
    return alarm.candidates[0] if len(alarm.candidates) == 1 else None


def _order(sister: Sister) -> tuple[int, float, str]:
    apart = abs(sister.apart) if isfinite(sister.apart) else 0.0
    return (ORDER.index(sister.verdict), -apart, sister.member.name)
