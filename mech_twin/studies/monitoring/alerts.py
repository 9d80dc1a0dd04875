# SPDX-License-Identifier: Apache-2.0
"""Alerts that are sent out of the process: one per fault, the same for every outlet."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite
from typing import NamedTuple

from mech_twin.studies.monitoring.fault_life import FaultLife
from mech_twin.studies.monitoring.findings import Findings


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
    unit : str
        Of the size.
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
    acknowledged: bool
    alarm: bool


def alerts_of(
    machine: str, lives: Iterable[FaultLife], found: Findings, now_s: float, origin_s: float = 0.0
) -> tuple[Alert, ...]:
    """Return one alert per fault, cleared ones included, so that an outlet can remove them.

    Parameters
    ----------
    machine : str
        Name of the machine.
    lives : iterable of FaultLife
        All faults so far.
    found : Findings
        Findings of the newest cycle; its candidates give the sizes.
    now_s : float
        Current stamp; it decides whether a fault is still shelved.
    origin_s : float
        Time by the machine's clock at stamp 0.
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
