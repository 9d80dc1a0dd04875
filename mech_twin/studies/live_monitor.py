# SPDX-License-Identifier: Apache-2.0
"""The monitor fed by the samples that a shadow receives; the findings equal those of a recording of them."""

from collections.abc import Iterable, Sequence
from typing import Any

from mech_twin.capabilities.cycle import CycleFeatures
from mech_twin.capabilities.faults import MachineFault
from mech_twin.declarations.quantity import Parameters
from mech_twin.measurements.units import shown_unit
from mech_twin.studies.monitoring.charts import CHARTS
from mech_twin.studies.monitoring.cycle_features import FeatureFeed
from mech_twin.studies.monitoring.findings import FaultLife, Findings
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.observer.estimate import SeenSample


class LiveMonitor:
    """Computes features and findings, sample by sample.

    Raises
    ------
    StudyError
        The reference column of the cycles is not measured.
    """

    def __init__(self, setup: MonitorSetup, declared: CycleFeatures, columns: Sequence[str]) -> None:
        self.monitor = Monitor(setup)
        self.newest: Findings | None = None
        self._columns = tuple(columns)
        self._feed = FeatureFeed(declared, list(dict.fromkeys(columns)), run_up_s=declared.run_up_s)

    def take(self, sample: SeenSample) -> list[Findings]:
        """Return the findings of the cycles that a sample completes."""
        found = []
        for channel, value in zip(sample.channels, sample.values, strict=True):
            vectors = self._feed.feed(self._columns[channel], [sample.time_s], [value])
            found += [self.monitor.observe(vector) for vector in vectors]
        self.newest = found[-1] if found else self.newest
        return found

    def begin_anew(self) -> None:
        """Start a new feed at the next sample, after the machine was restarted and its time has jumped.

        No fault stays shelved, since its stamp is of the time before.
        """
        self._feed = self._feed.begun_anew()
        for name in self.monitor.lives:
            self.monitor.shelve(name, float("-inf"))


def has_news(lives: Iterable[FaultLife]) -> bool:
    """Return whether a fault is active and not acknowledged."""
    return any(life.state == "active" and not life.is_acknowledged for life in lives)


def changes_by_faults(
    parameters: Parameters, faults: Sequence[MachineFault], monitor: Monitor, found: Findings | None
) -> dict[str, Any]:
    """Return the configuration keys changed by an acknowledged fault, at the estimated size.

    For a group the best candidate is used; a sensor fault changes no key.
    """
    if found is None or not found.candidates:
        return {}
    life = monitor.lives.get(found.finding)
    if life is None or life.state != "active" or not life.is_acknowledged:
        return {}
    best = found.candidates[0]
    return {
        key: value
        for each in faults
        if each.name == best.name
        for key, value in each.changes(parameters, best.size).items()
    }


def fault_values(setup: MonitorSetup, life: FaultLife, found: Findings, origin_s: float = 0.0) -> dict[str, str]:
    """Return the values of a fault for a panel: state, statistics and thresholds, ARL0, delay, candidates.

    Times are of the machine's clock, which is at ``origin_s`` at stamp 0.  Begin and delay are left empty where the
    newest cycle has another fault.
    """
    own = life.name == found.finding
    values = {
        "state": life.state,
        "since s": f"{origin_s + life.since_s:.3f}",
        "acknowledged": str(life.is_acknowledged),
        "shelved until s": f"{origin_s + life.shelved_until_s:.3f}",
        "arl0 h": f"{setup.arl0_h:.4g}",
        "delay cycles": str(found.delay_cycles) if own else "",
        "began s": f"{origin_s + found.onset_s:.3f}" if own else "",
        "candidates": "; ".join(
            f"{c.name} {c.size:.4g} ({c.low_95:.4g} to {c.high_95:.4g}) {shown_unit(c.unit)}".rstrip()
            for c in life.candidates
        ),
    }
    statistics = () if found.charts is None else found.charts.statistics
    for chart, value, limit in zip(CHARTS, statistics, setup.limits.alarm, strict=False):
        values |= {f"statistic {chart}": f"{value:.4g}", f"threshold {chart}": f"{limit:.4g}"}
    return values
