# SPDX-License-Identifier: Apache-2.0
"""One measured run ready for a fit: its channels in SI units, its events, and the command it was run with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb
from pathlib import Path

import numpy as np

from mech_twin.measurements.blocks import Array
from mech_twin.measurements.errors import MeasurementError
from mech_twin.measurements.machine_columns import EVENT, is_angle, is_event
from mech_twin.measurements.measurement_map import Channel, fixed
from mech_twin.measurements.quality import NORMAL_MEDIAN
from mech_twin.measurements.runs import MeasuredChannel, MeasuredRun
from mech_twin.studies.identification.channel_prediction import POSITION, jumps

COMMANDS = ("motor.command", "linkage.command")
DIFFERENCES = (2, 3, 4, 5, 6)  # orders that tell the noise of a channel
FEWEST_DIFFERENCES = 8
MOST_FITTED = 40_000  # samples of a channel in a run: more are thinned evenly
LATEST_START_S = 600.0  # a run whose first stamp is later does not begin with the machine's own start


@dataclass(frozen=True)
class FitChannel:
    """Samples of one channel in one run, as the fit compares them.

    Attributes
    ----------
    channel : Channel
        Its line of the map.
    times_s, values : ndarray
        Shape (n,): known lag taken off; SI units of the machine, known zero and gain taken off.
    noise : float
        Standard deviation that the sensor is known or seen to have, SI units; 0 where nothing tells it.
    """

    channel: Channel
    times_s: Array
    values: Array
    noise: float

    @property
    def name(self) -> str:
        """The column of the machine, or its event."""
        return self.channel.quantity

    @property
    def of_events(self) -> bool:
        """Whether it shows events."""
        return is_event(self.name)

    @property
    def kind(self) -> str:
        """The kind of event it shows."""
        return self.name.split(".")[1] if self.of_events else ""

    @property
    def field(self) -> str:
        """What of the event it shows."""
        return self.name.rpartition(".")[2]

    @property
    def jumps(self) -> bool:
        """Whether it may jump at an event of the machine."""
        return not self.of_events and jumps(self.name)

    @property
    def turns(self) -> bool:
        """Whether whole turns of it look the same."""
        return self.name.endswith(POSITION) and is_angle(self.name)


@dataclass(frozen=True)
class FitRun:
    """One run.

    Attributes
    ----------
    path : Path
        File it came from.
    channels : tuple of FitChannel
        In the order of the map, those of the command left out.
    command : tuple of pairs
        Time (s) and asked fraction of rated supply frequency from then on; empty: full supply throughout.
    begin_s : float or None
        Time of the machine's own run at which the run's time 0 stands; None: unknown.
    until_s : float
        The fit does not look at samples after it.
    from_s : float
        Nor at samples before it.
    """

    path: Path
    channels: tuple[FitChannel, ...]
    command: tuple[tuple[float, float], ...]
    begin_s: float | None
    until_s: float = np.inf
    from_s: float = -np.inf

    @property
    def first_s(self) -> float:
        """Time of the first sample."""
        return min(float(channel.times_s[0]) for channel in self.channels)

    @property
    def last_s(self) -> float:
        """Time of the last sample."""
        return max(float(channel.times_s[-1]) for channel in self.channels)

    def within(self, from_s: float, until_s: float) -> FitRun:
        """Return the run with the samples that count limited to a stretch of it."""
        return replace(self, from_s=from_s, until_s=until_s)


def fit_run(run: MeasuredRun, *, begin_known: bool) -> FitRun:
    """Return a measured run ready for a fit.

    Parameters
    ----------
    run : MeasuredRun
        As its map reads it.
    begin_known : bool
        Whether the run's times are those of the machine's own run from its start; else its time begins with the first
        sample, and where that stands in the machine's run is unknown.

    Raises
    ------
    MeasurementError
        The run begins before the machine's start or long after it; or it has no channel beside that of the command.
    """
    channels = tuple(_fit_channel(each) for each in run.channels if each.name not in COMMANDS and len(each.times_s))
    commands = [(each.times_s, each.values) for each in run.channels if each.name in COMMANDS]
    return placed_run(run.path, channels, commands[0] if commands else None, begin_known=begin_known)


def placed_run(
    path: Path, channels: Sequence[FitChannel], command: tuple[Array, Array] | None, *, begin_known: bool
) -> FitRun:
    """Return the run of channels, and of times and values of the command; see `fit_run`."""
    if not channels:
        raise MeasurementError(path, "expected a channel beside that of the command")
    first = min(float(each.times_s[0]) for each in channels)
    if begin_known and not -1.0 <= first <= LATEST_START_S:
        raise MeasurementError(
            path,
            f"the first sample stands at {first:.6g} s, and the run is taken to begin with the machine's own start at "
            "0 s; expected --begin unknown",
        )
    shift = 0.0 if begin_known else first
    moved = tuple(_earlier(each, shift) for each in channels)
    changes = tuple(_changes(*command, shift)) if command is not None else ()
    return FitRun(path, moved, changes, 0.0 if begin_known else None)


def _fit_channel(measured: MeasuredChannel) -> FitChannel:
    quantum = max(measured.quality.quantum, measured.channel.quantum)
    return fit_channel(measured.channel, measured.times_s, measured.values, quantum)


def fit_channel(channel: Channel, times_s: Array, values: Array, quantum: float) -> FitChannel:
    """Return the samples of a channel, in SI units and in order, as a fit compares them.

    Parameters
    ----------
    channel : Channel
        Its line of the map.
    times_s, values : ndarray
        Shape (n,): known lag, zero and gain taken off.
    quantum : float
        Step of the sensor, in its own unit.
    """
    own = abs(fixed(channel.gain, 1.0)) * channel.si_factor
    every = max(1, -(-len(times_s) // MOST_FITTED))
    if channel.sigma is not None:
        noise = own * channel.sigma
    else:
        noise = 0.0 if channel.quantity.startswith(EVENT) else seen_noise(values)
    return FitChannel(channel, times_s[::every], values[::every], float(np.hypot(noise, own * quantum / 12.0**0.5)))


def seen_noise(values: Array) -> float:
    """Return the standard deviation of the noise in a series, estimated from its differences.

    Second differences still contain the curvature of a fast motion; higher ones less of it, and more of the noise.
    White noise enlarges differences of order k by the root of (2k over k); the least of several orders counts.
    """
    found = []
    for order in DIFFERENCES:
        left = np.abs(np.diff(values, order))
        if len(left) >= FEWEST_DIFFERENCES:
            found.append(float(np.median(left)) / NORMAL_MEDIAN / comb(2 * order, order) ** 0.5)
    return min(found, default=0.0)


def _earlier(channel: FitChannel, shift_s: float) -> FitChannel:
    values = channel.values - shift_s if channel.of_events and channel.field == "time" else channel.values
    return replace(channel, times_s=channel.times_s - shift_s, values=values)


def _changes(times_s: Array, values: Array, shift_s: float) -> Sequence[tuple[float, float]]:
    """Return where the command changes, and to what."""
    changed = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    return [(float(times_s[i]) - shift_s, float(np.clip(values[i], 0.0, 1.0))) for i in changed]
