# SPDX-License-Identifier: Apache-2.0
"""A measured run prepared for a fit: channels in SI units, events, and the command that was given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb
from pathlib import Path

import numpy as np

from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import Channel, fixed
from mech_twin.measurements.quality import NORMAL_MEDIAN
from mech_twin.measurements.runs import MeasuredChannel, MeasuredRun
from mech_twin.measurements.units import EVENT, is_angle, is_event
from mech_twin.studies.identification.channel_prediction import POSITION, jumps

COMMANDS = ("motor.command", "linkage.command")
DIFFERENCES = (2, 3, 4, 5, 6)  # orders of the differences that estimate the noise of a channel
FEWEST_DIFFERENCES = 8
MOST_FITTED = 40_000  # samples of a channel in a run: more are evenly decimated
LATEST_START_S = 600.0  # a run with a later first stamp cannot begin at the machine's start


@dataclass(frozen=True)
class FitChannel:
    """Samples of one channel in one run, as used in the fit.

    Attributes
    ----------
    channel : Channel
        Its entry in the map.
    times_s, values : ndarray
        Shape (n,): known lag subtracted; SI units of the machine, known zero and gain removed.
    noise : float
        Standard deviation of the sensor noise, given or estimated, SI units; 0 if unknown.
    """

    channel: Channel
    times_s: Array
    values: Array
    noise: float

    @property
    def name(self) -> str:
        """Column of the machine, or event and its field."""
        return self.channel.quantity

    @property
    def of_events(self) -> bool:
        """Whether it holds events."""
        return is_event(self.name)

    @property
    def kind(self) -> str:
        """Kind of event it holds."""
        return self.name.split(".")[1] if self.of_events else ""

    @property
    def field(self) -> str:
        """Field of the event it holds."""
        return self.name.rpartition(".")[2]

    @property
    def jumps(self) -> bool:
        """Whether its value can jump at an event of the machine."""
        return not self.of_events and jumps(self.name)

    @property
    def turns(self) -> bool:
        """Whether it is an angle that is known only up to whole turns."""
        return self.name.endswith(POSITION) and is_angle(self.name)


@dataclass(frozen=True)
class FitRun:
    """One measured run.

    Attributes
    ----------
    path : Path
        File of the run.
    channels : tuple of FitChannel
        In the order of the map, without channels of the command.
    command : tuple of pairs
        Time (s) and requested fraction of rated supply frequency from then on; empty: full supply throughout.
    begin_s : float or None
        Time since the machine's start at the run's time 0; None: unknown.
    until_s : float
        The fit ignores samples after it.
    from_s : float
        The fit ignores samples before it.
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
        """Return the run with only the samples of a time interval used."""
        return replace(self, from_s=from_s, until_s=until_s)


def fit_run(run: MeasuredRun, *, begin_known: bool) -> FitRun:
    """Return a measured run prepared for a fit.

    Parameters
    ----------
    run : MeasuredRun
        The run, read with its map.
    begin_known : bool
        Whether the run's times count from the machine's start; else they count from the first sample, at an unknown
        time after the start.

    Raises
    ------
    MeasurementError
        The run begins before the machine's start or long after it; or it has no channel besides the command.
    """
    channels = tuple(_fit_channel(each) for each in run.channels if each.name not in COMMANDS and len(each.times_s))
    commands = [(each.times_s, each.values) for each in run.channels if each.name in COMMANDS]
    return placed_run(run.path, channels, commands[0] if commands else None, begin_known=begin_known)


def placed_run(
    path: Path, channels: Sequence[FitChannel], command: tuple[Array, Array] | None, *, begin_known: bool
) -> FitRun:
    """Return the run from channels, and from times and values of the command; see `fit_run`."""
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
    """Return the samples of a channel in SI units and in order, as used in the fit.

    Parameters
    ----------
    channel : Channel
        Its line of the map.
    times_s, values : ndarray
        Shape (n,): known lag, zero and gain removed.
    quantum : float
        Resolution of the sensor, in its own unit.
    """
    own = abs(fixed(channel.gain, 1.0)) * channel.si_factor
    every = max(1, -(-len(times_s) // MOST_FITTED))
    if channel.sigma is not None:
        noise = own * channel.sigma
    else:
        noise = 0.0 if channel.quantity.startswith(EVENT) else seen_noise(values)
    return FitChannel(channel, times_s[::every], values[::every], float(np.hypot(noise, own * quantum / 12.0**0.5)))


def seen_noise(values: Array) -> float:
    """Return the standard deviation of the noise in a series, estimated from its higher differences.

    Second differences still contain the curvature of a fast motion, higher ones less of it.  White noise of standard
    deviation s gives differences of order k with s sqrt(binomial(2k, k)); the least estimate over the orders is taken.
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
    """Return the times (s) at which the command changes, and its new values, limited to 0 to 1."""
    changed = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    return [(float(times_s[i]) - shift_s, float(np.clip(values[i], 0.0, 1.0))) for i in changed]
