# SPDX-License-Identifier: Apache-2.0
"""Features of each cycle from streamed samples: the same code live, on a recording and on a simulation.

Feed the samples channel by channel, in chunks of any length and in any order of channels::

    feed = FeatureFeed(declared, columns)
    for vector in feed.feed("linkage.crank.position", times_s, values): ...

A cycle is returned when every channel has passed its end, or when the reference channel is ``PATIENCE_S`` past it.
Features of a channel that is silent or has a gap are nan.  The result depends only on the samples and their stamps,
not on the chunks.  Samples are in SI units; a known lag is subtracted from their stamps.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import ceil, floor, isnan, nextafter, pi
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mech_twin.capabilities.cycle import (
    TURN,
    Array,
    CycleFeature,
    CycleFeatures,
    CycleReference,
    SampledCycle,
    crossed_turn,
    first_below,
    first_rise,
    phase_of_turn,
    sampled,
    unwrapped,
)
from mech_twin.errors import StudyError
from mech_twin.studies.monitoring.sensor_quality import (
    LEAST_SAMPLES,
    ChannelBuffer,
    ChannelQuality,
    channel_quality,
    is_whole,
)

PATIENCE_S = 1.0  # by which the reference may run ahead of another channel
EVENT_WAIT_S = 0.1  # the same for an event channel, which is silent while nothing happens
FARTHEST_RAD = 1e9  # largest angle: beyond it, rounding destroys the count of turns
CLOCK_GAIN = 0.02  # gain of the clock's correction by a rise, after 1/gain rises
CLOCK_RISES = 20  # averaged before the first cycle is counted
CLOCK_TRUST = 0.25  # of a cycle: a rise farther from its expected instant resets the clock
LONGEST_CYCLE = 10.0  # times the shortest of the cycles before: a longer one is a standstill
CYCLES_BEFORE = 5  # with so many standstills in a row, the machine has become slow
QUICK = 0.5  # of the usual turn: a quicker one of fewer than `LEAST_SAMPLES` is none of the machine
CROSSING_RAD = pi / 12.0  # on either side of a boundary: a line through these samples gives the crossing


def turn_crossing(
    reference: CycleReference, buffer: ChannelBuffer, boundary: float | None, since_s: float
) -> tuple[float, float] | None:
    """Return when the angle (rad) first crosses the boundary, by a line through nearby samples; and the next boundary.

    None while samples are missing.  Without a boundary, the first one ahead of the first sample is taken.
    """
    angles = buffer.values
    if boundary is None:
        turns = ceil((angles[0] + CROSSING_RAD - reference.begin) / TURN)
        boundary = reference.begin + TURN * turns
    first = int(buffer.times_s.searchsorted(since_s))
    crossed_s, following = crossed_turn(buffer.times_s, angles, first, boundary, CROSSING_RAD)
    return None if isnan(crossed_s) else (crossed_s, following)


def rise_crossing(
    reference: CycleReference, buffer: ChannelBuffer, boundary: float | None, since_s: float
) -> tuple[float, float] | None:
    """Return when the signal first rises through the level at or after ``since_s``, interpolated between samples."""
    place = first_rise(buffer.values, int(buffer.times_s.searchsorted(since_s)), reference.begin)
    if place < 0:
        return None
    (t0, t1), (x0, x1) = buffer.times_s[place : place + 2], buffer.values[place : place + 2]
    crossed_s = float(t0 + (t1 - t0) * (reference.begin - x0) / (x1 - x0))
    return max(crossed_s, nextafter(t0, t1)), 0.0  # a rise to 1e300 is at the sample before it, and is not found again


class FeatureVector(NamedTuple):
    """The features of one cycle.

    Attributes
    ----------
    number : int
        Index of the cycle, counted by the feed; cycles that are left out are counted too.
    begin_s, end_s : float
        Stamps of its start and end.
    names : tuple of str
        Names of the features; their units are in `FeatureFeed.features`.
    values : ndarray
        Shape (features,), SI; nan where a channel was silent or has a gap.
    quality : mapping
        Sample statistics of each column except events.
    silent : tuple of str
        Features of which a channel was silent or has a gap; others may be nan where they have no meaning.
    """

    number: int
    begin_s: float
    end_s: float
    names: tuple[str, ...]
    values: Array
    quality: Mapping[str, ChannelQuality] = MappingProxyType({})
    silent: tuple[str, ...] = ()

    def row(self, names: Sequence[str]) -> Array:
        """Return these features, shape (names,); nan for one that the vector lacks."""
        known = dict(zip(self.names, self.values.tolist(), strict=True))
        return np.array([known.get(name, np.nan) for name in names])


@dataclass
class FeatureFeed:
    """Turns samples into feature vectors of complete cycles.

    Parameters
    ----------
    declared : CycleFeatures
        Cycle reference and features that the machine declares (`Capabilities.features`).

    Attributes
    ----------
    features : tuple of CycleFeature
        Features that can be computed from these columns.
    skipped : int
        Number of cycles left out: a gap in the reference, or a standstill.
    run_up_s : float
        Cycles that begin sooner than this after the first reference sample are left out and not counted as skipped.

    Raises
    ------
    StudyError
        The reference column is not among the measured ones.
    """

    declared: CycleFeatures
    columns: Sequence[str]
    skipped: int = 0
    run_up_s: float = 0.0
    _begun_s: float | None = None
    _buffers: dict[str, ChannelBuffer] = field(default_factory=dict)
    _boundaries: list[float] = field(default_factory=list)
    _wrong: dict[float, int] = field(default_factory=dict)  # turns of the angle, in a cycle that ends then and is none
    _turns_s: deque[float] = field(default_factory=lambda: deque(maxlen=CYCLES_BEFORE))
    _quick: int = 0
    _is_rest: bool = False  # of a turn in which the angle went back
    _number: int = 0
    _turns: float = 0.0
    _last_raw: float = np.nan
    _next_angle: float | None = None
    _recent_s: deque[float] = field(default_factory=lambda: deque(maxlen=CYCLES_BEFORE))
    _crossed_s: float = -np.inf
    _begun_turn_s: float = -np.inf
    _rises: int = 1
    _clock_s: float | None = None

    def __post_init__(self) -> None:
        reference = self.declared.reference.column
        if reference not in self.columns:
            raise StudyError(f"no channel is {reference}, which cycles are counted by; expected one")
        self.features = available_features(self.declared, self.columns)
        self._buffers = {column: ChannelBuffer() for column in dict.fromkeys(self.columns)}
        self._event_columns = frozenset(filter(is_event_channel, self._buffers))
        self._names = tuple(feature.name for feature in self.features)

    def feed(
        self, column: str, times_s: Sequence[float] | Array, values: Sequence[float] | Array
    ) -> list[FeatureVector]:
        """Take samples of a channel, or events; return the cycles that are now complete.

        Parameters
        ----------
        column : str
            Name of the channel; one that was not declared is ignored.
        times_s, values : sequence of float
            Shape (n,): stamps and SI values, in the order they came.
        """
        return [vector() for vector in self.cycles(column, times_s, values)]

    def cycles(
        self, column: str, times_s: Sequence[float] | Array, values: Sequence[float] | Array
    ) -> list[Callable[[], FeatureVector]]:
        """Take samples as `feed` does; return what computes the features of each cycle that is now complete."""
        buffer = self._buffers.get(column)
        if buffer is None:
            return []
        times, numbers = np.array(times_s, dtype=np.float64), np.array(values, dtype=np.float64)
        if column == self.declared.reference.column and self.declared.reference.kind == "turn":
            numbers = self._without_jumps(numbers)
        buffer.add(times, numbers)
        if column == self.declared.reference.column:
            if self._begun_s is None and len(buffer.times_s):
                self._begun_s = float(buffer.times_s[0])
            self._find_boundaries()
        return self._complete(final=False)

    def begun_anew(self) -> FeatureFeed:
        """Return a feed without the previous samples; it skips one cycle number to mark the gap."""
        return FeatureFeed(self.declared, self.columns, self.skipped, self.run_up_s, _number=self._number + 1)

    def finish(self) -> list[FeatureVector]:
        """Return the remaining cycles at the end of a run, without waiting for more samples."""
        return [vector() for vector in self.remaining()]

    def remaining(self) -> list[Callable[[], FeatureVector]]:
        """Return what computes the features of each remaining cycle, at the end of a run."""
        return self._complete(final=True)

    def _without_jumps(self, angles: Array) -> Array:
        """Return unwrapped angles (rad), each step taken the shortest way round; nan where there is no valid angle."""
        found, self._last_raw, self._turns = unwrapped(angles, FARTHEST_RAD, self._last_raw, self._turns)
        return found

    def _find_boundaries(self) -> None:
        buffer = self._buffers[self.declared.reference.column]
        is_turn = self.declared.reference.kind == "turn"
        find = turn_crossing if is_turn else rise_crossing
        since = self._crossed_s
        while len(buffer.times_s):
            found = find(self.declared.reference, buffer, self._next_angle, since)
            back_s = self._turned_back(np.inf if found is None else found[0]) if is_turn else None
            if back_s is not None:
                since = self._crossed_s = self._begun_turn_s = back_s
                self._boundaries.append(back_s)
                continue
            if found is None:
                return
            crossed_s, self._next_angle = found
            if crossed_s > since:
                samples = int(buffer.times_s.searchsorted(crossed_s) - buffer.times_s.searchsorted(since))
                since = self._crossed_s = crossed_s
                if is_turn and self._is_wrong(crossed_s, samples):
                    continue
                begun_s = self._clocked(crossed_s)
                if begun_s is not None:
                    self._boundaries.append(begun_s)

    @property
    def _usual_turn_s(self) -> float:
        return sorted(self._turns_s)[len(self._turns_s) // 2] if self._turns_s else 0.0

    def _is_wrong(self, crossed_s: float, samples: int) -> bool:
        """Return whether a turn is too quick for the machine and its samples; such are counted for the time of one."""
        turn_s, usual_s = crossed_s - self._begun_turn_s, self._usual_turn_s
        if turn_s < usual_s if self._quick else turn_s < QUICK * usual_s and samples < LEAST_SAMPLES:
            self._quick += 1
            return True
        if self._quick or self._is_rest:
            self._wrong[crossed_s], self._quick = self._certain_turns(self._quick and self._quick + 1, crossed_s), 0
        elif turn_s < np.inf:
            self._turns_s.append(turn_s)
        self._begun_turn_s, self._is_rest = crossed_s, False
        return False

    def _certain_turns(self, turns: int, until_s: float) -> int:
        """Return wrong turns of an encoder, 0 where samples lack for half a turn: the shortest way may be wrong."""
        longest_s = self._buffers[self.declared.reference.column].longest_step_s(self._begun_turn_s, until_s)
        return 0 if 2.0 * longest_s > self._usual_turn_s > 0.0 else turns

    def _turned_back(self, before_s: float) -> float | None:
        """Return the first instant before ``before_s`` at which the angle is a turn below the last boundary.

        There is at most one in the time of a turn; the next boundary is then the one ahead of that angle.
        """
        reference, buffer = self.declared.reference, self._buffers[self.declared.reference.column]
        if self._next_angle is None or self._crossed_s == -np.inf:
            return None
        sooner_s = self._begun_turn_s + self._usual_turn_s
        level = self._next_angle - 2.0 * TURN
        place = first_below(buffer.times_s, buffer.values, self._crossed_s, sooner_s, before_s, level)
        if place < 0:
            return None
        turns = ceil((buffer.values[place] + CROSSING_RAD - reference.begin) / TURN)
        back_s, ahead = float(buffer.times_s[place]), reference.begin + TURN * turns
        turned = self._certain_turns(round((ahead - self._next_angle) / TURN), back_s)
        self._wrong[back_s], self._quick, self._is_rest = turned, 0, True
        self._next_angle = ahead
        return back_s

    def _clocked(self, crossed_s: float) -> float | None:
        """Return the start of the cycle (s) by the clock that drives the signal; None until that is known well enough.

        Without a clock, the start is the crossing itself.
        """
        period_s = self.declared.reference.period_s
        if not period_s:
            return crossed_s
        expected_s = self._clock_s
        if expected_s is not None:
            expected_s += period_s * max(1, round((crossed_s - expected_s) / period_s))
        if expected_s is None or abs(crossed_s - expected_s) > CLOCK_TRUST * period_s:
            self._rises, self._clock_s = 1, crossed_s
            return None
        self._rises += 1
        self._clock_s = expected_s + max(1.0 / self._rises, CLOCK_GAIN) * (crossed_s - expected_s)
        return self._clock_s if self._rises > CLOCK_RISES else None

    def _complete(self, *, final: bool) -> list[Callable[[], FeatureVector]]:
        """Return what computes the features of each cycle that is now complete."""
        found = []
        while len(self._boundaries) > 1 and (final or self._passed(self._boundaries[1])):
            begin_s, end_s = self._boundaries[:2]
            cycle = self._cycle(begin_s, end_s)
            self._number += 1
            self._boundaries.pop(0)
            self._forget(end_s)
            if begin_s < (self._begun_s or 0.0) + self.run_up_s:
                continue
            if cycle is None:
                self.skipped += 1
            else:
                found.append(cycle)
        return found

    def _passed(self, end_s: float) -> bool:
        """Return whether every channel has a sample at or beyond the end, or its waiting time has passed."""
        ahead_s = self._buffers[self.declared.reference.column].newest_s - end_s
        return all(
            buffer.newest_s >= end_s or ahead_s > (EVENT_WAIT_S if column in self._event_columns else PATIENCE_S)
            for column, buffer in self._buffers.items()
        )

    def _cycle(self, begin_s: float, end_s: float) -> Callable[[], FeatureVector] | None:
        """Return what computes the features between two boundaries; None for a standstill or a gap."""
        reference = self.declared.reference
        times, _ = self._buffers[reference.column].between(begin_s, end_s)
        period_s = end_s - begin_s
        if (wrong := self._wrong.pop(end_s, None)) is not None:
            quality = {reference.column: ChannelQuality(0, np.nan, 0.0, 0.0, wrong)}
            nothing = np.full(len(self._names), np.nan)
            found = FeatureVector(self._number, begin_s, end_s, self._names, nothing, quality)
            return (lambda: found) if wrong else None
        usual_s = min(self._recent_s, default=period_s)
        self._recent_s.append(period_s)
        if period_s > LONGEST_CYCLE * usual_s or not is_whole(times, begin_s, end_s):
            return None
        samples = {column: buffer.between(begin_s, end_s) for column, buffer in self._buffers.items()}
        return partial(self._vector, self._number, begin_s, end_s, samples)

    def _vector(
        self, number: int, begin_s: float, end_s: float, samples: Mapping[str, tuple[Array, Array]]
    ) -> FeatureVector:
        """Return the features of the samples of a cycle."""
        reference, period_s, angles = self.declared.reference, end_s - begin_s, None
        times, values = samples[reference.column]
        if reference.kind == "turn":
            inner = np.concatenate([[begin_s], times, [end_s]])
            start = TURN * floor((values[0] - reference.begin + 0.5 * CROSSING_RAD) / TURN) + reference.begin
            angles = phase_of_turn(values, start)
        channels, quality = {}, {}
        for column, (own_s, own) in samples.items():
            is_event = column in self._event_columns
            if not is_event:
                quality[column] = channel_quality(own_s, own)
            if len(own_s) if is_event else is_whole(own_s, begin_s, end_s):
                phase = TURN * (own_s - begin_s) / period_s if angles is None else np.interp(own_s, inner, angles)
                channels[column] = sampled(own_s, phase, own)
        cycle, silent = SampledCycle(number, begin_s, end_s, channels), tuple[str, ...]()
        if len(channels) < len(samples):
            silent = tuple(each.name for each in self.features if not channels.keys() >= set(each.needs))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            found = np.array([np.nan if each.name in silent else each.of(cycle) for each in self.features])
        found[~np.isfinite(found)] = np.nan
        return FeatureVector(number, begin_s, end_s, self._names, found, quality, silent)

    def _forget(self, end_s: float) -> None:
        for column, buffer in self._buffers.items():
            reference = column == self.declared.reference.column
            buffer.forget(end_s - (0.5 * (self._recent_s[-1] if self._recent_s else 0.0) if reference else 0.0))


def available_features(declared: CycleFeatures, columns: Iterable[str]) -> tuple[CycleFeature, ...]:
    """Return the features whose columns are all measured."""
    known = set(columns)
    return tuple(feature for feature in declared.features if known.issuperset(feature.needs))


def is_event_channel(column: str) -> bool:
    """Return whether a column holds events, such as `event.blow.time`."""
    return column.startswith("event.")


def feed_channels(
    feed: FeatureFeed,
    channels: Mapping[str, tuple[Array, Array]],
    slice_s: float = 2.0,
    *,
    final: bool = True,
    last: int = 0,
) -> list[FeatureVector]:
    """Return the cycles of a whole run; its channels are fed in time slices, as they would have arrived.

    Parameters
    ----------
    channels : mapping
        Stamps (s) and values (SI) of each column, shape (n,) each; the reference is fed last in each slice.
    final : bool
        Whether the run ends here: then cycles that wait for more samples are returned too.
    last : int
        Of how many cycles at the end the features are computed; 0: of all.
    """
    reference = feed.declared.reference.column
    order = [*(column for column in channels if column != reference), reference]
    times = [channels[column][0] for column in order]
    if not any(len(each) for each in times):
        return []
    edges = _slice_ends(times, slice_s)
    places = [np.concatenate([[0], np.searchsorted(each, edges)]) for each in times]
    found, at_end = list[FeatureVector](), deque[Callable[[], FeatureVector]](maxlen=last)

    def take(cycles: list[Callable[[], FeatureVector]]) -> None:
        at_end.extend(cycles)
        found.extend(vector() for vector in cycles if not last)

    for i in range(len(edges)):
        for column, each in zip(order, places, strict=True):
            if each[i + 1] > each[i]:
                part = slice(each[i], each[i + 1])
                take(feed.cycles(column, channels[column][0][part], channels[column][1][part]))
    if final:
        take(feed.remaining())
    return found + [vector() for vector in at_end]


def _slice_ends(times: Sequence[Array], slice_s: float) -> Array:
    """Return the ends (s) of the slices that hold a sample, ascending; one outlying stamp adds no empty slices."""
    first = min(each[0] for each in times if len(each))
    held = np.unique(np.concatenate([np.unique(np.floor((each - first) / slice_s)) for each in times]))
    ends = np.unique(np.concatenate([held, held + 1.0, held + 2.0]))  # a stamp may round into a neighbouring slice
    return np.append(first + slice_s * ends[ends > 0.0], np.inf)
