# SPDX-License-Identifier: Apache-2.0
"""Alerts on faults for other systems: one for each fault, the same for every outlet."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite
from typing import NamedTuple

from mech_twin.studies.monitoring.fault_life import FaultLife
from mech_twin.studies.monitoring.findings import Findings


class Alert(NamedTuple):
    """A fault as reported to other systems.

    Attributes
    ----------
    machine, name, state : str
        Which, and the state of its life.
    since_s : float
        The machine's clock at which it came into that state.
    size, low_95, high_95 : float or None
        Of the best candidate, in ``unit``; None where nothing has a size.
    unit : str
        Of the size.
    acknowledged : bool
        Whether it is acknowledged.
    alarm : bool
        Whether attention is required: active or latched, neither acknowledged nor shelved.
    """

    machine: str
    name: str
    state: str
    since_s: float
    size: float | None
    low_95: float | None
    high_95: float | None
    unit: str
    acknowledged: bool
    alarm: bool


def alerts_of(
    machine: str, lives: Iterable[FaultLife], found: Findings, now_s: float, origin_s: float = 0.0
) -> tuple[Alert, ...]:
    """Return an alert of each fault, cleared ones too, so that an outlet takes them away.

    Parameters
    ----------
    machine : str
        Whose faults.
    lives : iterable of FaultLife
        All faults that there were.
    found : Findings
        Of the newest cycle, whose candidates tell sizes.
    now_s : float
        Stamp by which shelved faults are judged.
    origin_s : float
        The machine's clock at stamp 0.
    """
    alerts = []
    for life in lives:
        best = next((c for c in found.candidates if life.name in (found.finding, c.name)), None)
        size, low, high = (None, None, None) if best is None else map(_finite, best[1:4])
        alarm = life.is_announced(now_s) and not life.is_acknowledged
        alerts.append(
            Alert(
                machine,
                life.name,
                life.state,
                origin_s + life.since_s,
                size,
                low,
                high,
                "" if best is None else best.unit,
                life.is_acknowledged,
                alarm,
            )
        )
    return tuple(alerts)


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
