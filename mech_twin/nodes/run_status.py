# SPDX-License-Identifier: Apache-2.0
"""One line on how a run goes: time, speed, blows a second, energy of a blow, state, lag, size of the recording."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

from mech_twin.measurements.machine_columns import sliding_in
from mech_twin.nodes.run_metrics import RunMetrics
from mech_twin.samples import Event, Frame

BLOWS = ("blow", "impact")
SPAN_S = 2.0  # of simulated time, over which blows are counted
LOUD = 0.5  # of the hardest blow in the span: of a series that dies out only the first counts
ENERGIES = ("steady_blow_energy_j", "blow_energy_j")
MEGABYTE = 1e6


class RunStatus:
    """What is known of a run from the frames it has made.

    Parameters
    ----------
    metrics : RunMetrics
        Gathers the run.
    directory : Path, optional
        Where it is recorded.
    """

    def __init__(self, metrics: RunMetrics, directory: Path | None) -> None:
        self.notice = ""
        self.paused = False
        self.motor_off = False
        self._metrics, self._directory = metrics, directory
        self._zero_s: float | None = None

    def pause(self, paused: bool) -> None:
        """Take note of a pause, or that the run goes on; its lag is counted anew."""
        self.paused = paused
        self._zero_s = None
        self.notice = ""

    def line(self, now_s: float) -> str:
        """Return the line at a steady time."""
        frame = self._metrics.last
        if frame is None:
            return "starting"
        linkage = frame.linkage
        joint, speed = linkage.joints[0], linkage.velocity[0]
        unit = "m/s" if joint in sliding_in(self._metrics.machine) else "rad/s"
        parts = [
            f"{linkage.time_s:.2f} s",
            f"{joint} {speed:.4g} {unit}",
            *self._blows(linkage.time_s),
            self._state(frame),
            f"lag {self._lag_s(linkage.time_s, now_s):.2f} s",
            *self._recorded(),
            self.notice,
        ]
        return "  ".join(filter(None, parts))

    def _blows(self, time_s: float) -> list[str]:
        rate = blow_rate(self._metrics.events, time_s)
        if rate == 0.0:
            return []
        numbers = self._metrics.running_numbers()
        energy = next((numbers[name] for name in ENERGIES if math.isfinite(numbers.get(name, math.nan))), None)
        return [f"{rate:.3g} blows/s", "" if energy is None else f"{energy:.3g} J a blow"]

    def _state(self, frame: Frame) -> str:
        if self.paused:
            return "paused"
        return "motor off" if self.motor_off else self._metrics.regime(frame.linkage.regime)

    def _lag_s(self, time_s: float, now_s: float) -> float:
        """Return by how much the run is behind the wall clock, since the status was first asked for or a pause."""
        ahead = time_s - now_s
        if self._zero_s is None or ahead > self._zero_s:
            self._zero_s = ahead
        return self._zero_s - ahead

    def _recorded(self) -> list[str]:
        if self._directory is None:
            return []
        size = sum(file.stat().st_size for file in self._directory.glob("*.mcap"))
        return [f"{size / MEGABYTE:.1f} MB"]


def blow_rate(events: Iterable[Event], time_s: float) -> float:
    """Return blows per second over the last `SPAN_S` of a run; 0 where there was none."""
    span = min(SPAN_S, time_s)
    recent = [event for event in events if event.kind in BLOWS and event.time_s > time_s - span]
    hardest = max((event.impulse_ns for event in recent), default=0.0)
    blows = sum(event.impulse_ns > LOUD * hardest for event in recent)
    return blows / span if hardest > 0.0 else 0.0
