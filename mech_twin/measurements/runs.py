# SPDX-License-Identifier: Apache-2.0
"""A measurement read with its map: channels in SI units, each at its own instants."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Array, Block, RunReader
from mech_twin.measurements.measurement_map import Channel, MeasurementMap, fixed
from mech_twin.measurements.quality import FEW_SAMPLES, LONG_INTERVAL, Quality, QualityGauge
from mech_twin.measurements.units import SCALED_BY_GAIN, TURN, is_angle

MOST_SAMPLES = 20_000_000  # of all channels of a run together: 320 MB
BACK_SHARE = 0.01  # largest share of stamps that go back
RESTART_S, CONFIRMING = 1.0, 3  # this many stamps that go back this far are a restart of the machine
NONE: Array = np.empty(0)
ABOUT_TURN = 1.05  # largest ratio of the range of an angle to one turn, where it starts anew at each: with its noise


@dataclass(frozen=True)
class MeasuredChannel:
    """Samples of one sensor in one run.

    Attributes
    ----------
    times_s, values : ndarray
        Shape (n,): instants of the machine (a known lag subtracted) and values in SI units; angles unwrapped.  A zero,
        gain or lag that the map leaves unknown is not corrected yet.
    quality : Quality
        Quality of all samples, including those left out (NaN, repeated stamps, stamps that go back).
    """

    channel: Channel
    times_s: Array
    values: Array
    quality: Quality

    @property
    def name(self) -> str:
        """Column of the machine that it measures."""
        return self.channel.quantity


@dataclass(frozen=True)
class MeasuredRun:
    """One run of a measurement."""

    path: Path
    channels: tuple[MeasuredChannel, ...]

    def channel(self, name: str) -> MeasuredChannel | None:
        """Return the first channel that measures a column of the machine; None without one."""
        return next((channel for channel in self.channels if channel.name == name), None)


def read_parts(reader: RunReader, measurement_map: MeasurementMap) -> list[MeasuredRun]:
    """Return a run split at restarts of the machine; a single part without a restart.

    At a restart, the stamps of a channel go back by more than `RESTART_S` and continue from there.
    """
    raw = _read(reader, measurement_map)
    whole, cuts = _whole(reader.path, raw), [_restarts(each.times_s) for each in raw]
    count = max(map(len, cuts))
    if count == 0:
        return [whole]
    ends = [[*own, *[len(each.times_s)] * (count + 1 - len(own))] for own, each in zip(cuts, raw, strict=True)]
    parts = [
        [_believed(each, begin, end) for begin, end in zip([0, *own[:-1]], own, strict=True)]
        for each, own in zip(raw, ends, strict=True)
    ]
    return [MeasuredRun(reader.path, channels) for channels in zip(*parts, strict=True)]


def _restarts(times: Array) -> list[int]:
    """Return the indices at which stamps continue from an earlier time."""
    found, first = list[int](), 0
    finite = np.where(np.isfinite(times), times, -np.inf)
    while True:
        ahead = np.maximum.accumulate(finite[first:])
        back = np.flatnonzero(np.diff(finite[first:]) < -RESTART_S) + 1
        real = [
            int(place)
            for place in back
            if place + CONFIRMING <= len(ahead)
            and (finite[first + place : first + place + CONFIRMING] < ahead[place - 1] - RESTART_S).all()
        ]
        if not real:
            return found
        first += real[0]
        found.append(first)


def channel_qualities(reader: RunReader, measurement_map: MeasurementMap) -> list[Quality]:
    """Return the quality of each channel of a run, in bounded memory."""
    gauges = [QualityGauge() for _ in measurement_map.channels]
    for block in reader.blocks([channel.source for channel in measurement_map.channels], measurement_map.time):
        gauges[block.channel].add(block)
    return [gauge.quality() for gauge in gauges]


def read_run(reader: RunReader, measurement_map: MeasurementMap) -> MeasuredRun:
    """Return a run with its channels in SI units.

    Raises
    ------
    MeasurementError
        A source is missing; a channel is unusable (too few samples, constant, stamps that go back); too many samples.
    """
    return _whole(reader.path, _read(reader, measurement_map))


def _read(reader: RunReader, measurement_map: MeasurementMap) -> list[MeasuredChannel]:
    """Return the channels of a run as they are: all stamps, and values in their own units."""
    channels = measurement_map.channels
    gauges = [QualityGauge() for _ in channels]
    parts: list[list[Block]] = [[] for _ in channels]
    count = 0
    for block in reader.blocks([channel.source for channel in channels], measurement_map.time):
        gauges[block.channel].add(block)
        parts[block.channel].append(block)
        count += len(block.times_s)
        if count > MOST_SAMPLES:
            raise MeasurementError(reader.path, f"holds more than {MOST_SAMPLES} samples; cut it into several runs")
    times = (np.concatenate([NONE, *(block.times_s for block in each)]) for each in parts)
    values = (np.concatenate([NONE, *(block.values for block in each)]) for each in parts)
    return list(map(MeasuredChannel, channels, times, values, (gauge.quality() for gauge in gauges)))


def _whole(path: Path, raw: Sequence[MeasuredChannel]) -> MeasuredRun:
    for each in raw:
        require_usable(path, each.channel, each.quality)
    found = tuple(map(_believed, raw))
    for each in found:
        _require_many(path, each.channel, len(each.times_s))
    return MeasuredRun(path, found)


def require_usable(path: Path, channel: Channel, quality: Quality) -> None:
    """Raise a MeasurementError for an unusable channel: too few samples, no number, constant, stamps that go back."""
    where = f"channel {channel.source.label!r} ({channel.quantity}):"
    if quality.samples - quality.nan < FEW_SAMPLES and not channel.quantity.startswith("event."):
        numbers = quality.samples - quality.nan
        raise MeasurementError(path, f"{where} {numbers} samples with a number, expected at least {FEW_SAMPLES}")
    if quality.back > BACK_SHARE * quality.samples:
        raise MeasurementError(
            path, f"{where} stamps go back {quality.back} times in {quality.samples} samples, expected rising ones"
        )
    if quality.low == quality.high and channel.quantity.endswith(".position"):
        raise MeasurementError(path, f"{where} constant at {quality.low:.6g}, expected a motion")


def _require_many(path: Path, channel: Channel, usable: int) -> None:
    """Raise a MeasurementError if too few samples have a number and a stamp later than all before."""
    if usable < FEW_SAMPLES and not channel.quantity.startswith("event."):
        raise MeasurementError(
            path,
            f"channel {channel.source.label!r} ({channel.quantity}): {usable} samples with a number and a time later "
            f"than those before, expected at least {FEW_SAMPLES}; a bag without stamps in its headers needs time: "
            "{stamps: log}",
        )


def _believed(raw: MeasuredChannel, begin: int = 0, end: int | None = None) -> MeasuredChannel:
    """Return finite samples with ascending stamps: SI units, unwrapped, known lag subtracted."""
    channel, times, values = raw.channel, raw.times_s[begin:end], raw.values[begin:end]
    finite = np.isfinite(values) & np.isfinite(times)
    times, values = times[finite], values[finite]
    rising = np.diff(np.maximum.accumulate(times), prepend=-np.inf) > 0.0
    times, values = times[rising], values[rising]
    if is_angle(channel.quantity) and len(values) and np.ptp(values) <= range_of_turn(channel):
        values = _unwrapped(times, values, TURN / size_of_count(channel))
    shown = np.asarray(channel.to_machine(values), dtype=np.float64)
    return replace(raw, times_s=times - fixed(channel.lag_s, 0.0), values=shown)


def size_of_count(channel: Channel) -> float:
    """Return the angle that 1 is in the channel's own numbers: of an encoder's counts by its gain, nan without one."""
    return abs(fixed(channel.gain, np.nan)) if channel.unit in SCALED_BY_GAIN else channel.si_factor


def range_of_turn(channel: Channel) -> float:
    """Return the largest range of an angle that may start anew at each turn, nan if unknown.

    One with a larger range is a continuous counter, whose steps of more than half a turn are motion.
    """
    return ABOUT_TURN * TURN / size_of_count(channel)


def _unwrapped(times: Array, values: Array, turn: float) -> Array:
    """Return an angle unwrapped: the shortest way, in a gap of one that starts anew as far as the speed around takes.

    An angle that starts anew in no usual interval swings, and has no mean speed.
    """
    steps, intervals = np.diff(values), np.diff(times)
    shortest = steps - turn * np.round(steps / turn)
    gaps = intervals > LONG_INTERVAL * np.median(intervals) if len(intervals) else intervals > 0.0
    moved, lasted = (np.cumsum(np.where(gaps, 0.0, each)) for each in (shortest, intervals))
    around = int(turn * len(steps) / max(np.sum(np.abs(shortest)), turn)) + 1  # intervals in about one turn
    for gap in np.flatnonzero(gaps & np.any(np.round(steps[~gaps] / turn))).tolist():
        first, last = max(0, gap - around), min(len(steps) - 1, gap + around)
        if lasted[last] > lasted[first]:
            speed = (moved[last] - moved[first]) / (lasted[last] - lasted[first])
            shortest[gap] += turn * np.round((speed * intervals[gap] - shortest[gap]) / turn)
    return values + turn * np.concatenate([[0.0], np.cumsum(np.round((shortest - steps) / turn))])
