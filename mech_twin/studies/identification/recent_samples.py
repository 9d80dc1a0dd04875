# SPDX-License-Identifier: Apache-2.0
"""The last minutes of a live machine, as a run that can be identified from."""

from array import array
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import Channel
from mech_twin.studies.identification.fit_runs import COMMANDS, FitChannel, FitRun, fit_channel, placed_run
from mech_twin.studies.observer.estimate import SeenSample

FEWEST_SAMPLES = 20  # of a channel, to be fitted


class _KeptSeries:
    """Times and values of one channel; older samples are dropped from time to time."""

    def __init__(self) -> None:
        self.times_s, self.values = array("d"), array("d")

    def add(self, time_s: float, value: float, kept_s: float) -> None:
        self.times_s.append(time_s)
        self.values.append(value)
        if time_s - self.times_s[0] > 2.0 * kept_s:
            first = int(np.searchsorted(np.frombuffer(self.times_s), time_s - kept_s))
            del self.times_s[:first], self.values[:first]

    def after(self, from_s: float) -> tuple[Array, Array]:
        """Return times and values from a time on, in order and without duplicate times."""
        times, places = np.unique(np.array(self.times_s), return_index=True)
        first = np.searchsorted(times, from_s)
        return times[first:], np.array(self.values)[places][first:]


class RecentSamples:
    """Samples of the last minutes of a machine.

    Parameters
    ----------
    channels : sequence of Channel
        Channels of the map, in the order of the samples' channel numbers.
    longest_s : float
        Duration for which samples are kept, at least.
    """

    def __init__(self, channels: Sequence[Channel], longest_s: float) -> None:
        self._channels, self._longest_s = tuple(channels), longest_s
        self.forget()

    def forget(self) -> None:
        """Drop all samples, since the machine's time has jumped."""
        self._series = [_KeptSeries() for _ in self._channels]
        self._commands: list[tuple[float, float]] = []
        self._first_s, self._newest_s = np.inf, -np.inf

    @property
    def span_s(self) -> float:
        """Duration of the samples that are kept, at most ``longest_s``."""
        return min(max(0.0, self._newest_s - self._first_s), self._longest_s)

    def add(self, sample: SeenSample) -> None:
        """Store a sample."""
        self._first_s, self._newest_s = min(self._first_s, sample.time_s), max(self._newest_s, sample.time_s)
        for place, value in zip(sample.channels, sample.values, strict=True):
            self._series[place].add(sample.time_s, value, self._longest_s)

    def command(self, share: float) -> None:
        """Store a command that was received besides the channels of the map."""
        if np.isfinite(self._newest_s):
            self._commands.append((self._newest_s, share))

    def run(self, span_s: float) -> FitRun:
        """Return the last ``span_s`` as a run whose start is unknown.

        Raises
        ------
        MeasurementError
            No channel has enough samples.
        """
        from_s, path = self._newest_s - span_s, Path(f"the last {min(span_s, self.span_s):.0f} s")
        channels: list[FitChannel] = []
        command = self._commanded(from_s)
        for channel, series in zip(self._channels, self._series, strict=True):
            times, values = series.after(from_s)
            if channel.quantity in COMMANDS:
                command = (times, values) if len(times) else command
            elif len(times) >= FEWEST_SAMPLES:
                channels.append(fit_channel(channel, times, values, channel.quantum))
        if not channels:
            raise MeasurementError(path, f"expected a channel with at least {FEWEST_SAMPLES} samples")
        return placed_run(path, channels, command, begin_known=False)

    def _commanded(self, from_s: float) -> tuple[Array, Array] | None:
        """Return times and values of the command in force at a time, and of the later ones."""
        before = [share for time_s, share in self._commands if time_s <= from_s]
        later = [(time_s, share) for time_s, share in self._commands if time_s > from_s]
        if not before and not later:
            return None
        changes = [(max(from_s, self._first_s), before[-1] if before else 1.0), *later]
        times, values = np.array(changes).T
        return times, values
