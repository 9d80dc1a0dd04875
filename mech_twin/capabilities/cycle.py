# SPDX-License-Identifier: Apache-2.0
"""One cycle of a machine as channels of samples, and how the numbers that describe it are declared.

A channel keeps its own instants.  Its samples are weighed by the phase they stand for, so that a mean or a harmonic
is one over the cycle's angle whatever the rate and the jitter of the sensor::

    weight_i = (phase_(i+1) - phase_(i-1))/(4 pi),   the first and the last being neighbours
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from mech_twin.capabilities.cycle_kernels import (
    TURN,
    Array,
    fourier_coefficient,
    lead,
    mean_of_largest,
    mean_of_smallest,
    phase_weights,
    weight_above,
    weighted_sum,
)

__all__ = [
    "TURN",
    "Array",
    "CycleFeature",
    "CycleFeatures",
    "CycleReference",
    "SampledChannel",
    "SampledCycle",
    "event_ratio",
    "event_share",
    "event_value",
    "harmonic",
    "mean",
    "period",
    "sampled",
    "share_above",
    "speed_harmonic",
    "swing",
    "upper",
]


class CycleReference(NamedTuple):
    """What a cycle is counted by.

    Attributes
    ----------
    column : str
        Column of the machine: an angle, or a signal that repeats.
    kind : str
        ``turn``: a cycle is a turn of the angle, from ``begin`` (rad) to a turn later.  ``rise``: a cycle lasts from
        one rise of the signal through the level ``begin`` (SI) to the next.
    begin : float
        Angle or level.
    period_s : float
        Of a signal that is led by a clock: single rises are averaged about it.  0: no clock is known.
    """

    column: str
    kind: Literal["turn", "rise"] = "turn"
    begin: float = 0.0
    period_s: float = 0.0


class SampledChannel(NamedTuple):
    """Samples of one channel within a cycle, shape (n,) each: instants (s), phase (0 to 2 pi), values (SI), weights."""

    times_s: Array
    phase_rad: Array
    values: Array
    weights: Array


@dataclass(frozen=True)
class SampledCycle:
    """One cycle: when it began and ended (s), and its channels by the column that each measures."""

    number: int
    begin_s: float
    end_s: float
    channels: Mapping[str, SampledChannel]

    @property
    def period_s(self) -> float:
        """How long it took."""
        return self.end_s - self.begin_s


class CycleFeature(NamedTuple):
    """A number of a cycle.

    Attributes
    ----------
    name, unit, meaning : str
        What it is called, its SI unit (``1``: a pure number), and one line for tables.
    needs : tuple of str
        Columns it is computed from; without a channel for each, a sensor set has no such feature.
    of : callable
        ``of(cycle)``: the number.
    """

    name: str
    unit: str
    meaning: str
    needs: tuple[str, ...]
    of: Callable[[SampledCycle], float]


class CycleFeatures(NamedTuple):
    """What a machine tells of each cycle.

    Attributes
    ----------
    reference : CycleReference
        What cycles are counted by.
    features : tuple of CycleFeature
        In the order they are shown in.
    settling_cycles : int
        Cycles after which a changed parameter has had nearly its whole effect.
    run_up_s : float
        Time after which a run that starts as configured is in steady running.
    """

    reference: CycleReference
    features: tuple[CycleFeature, ...]
    settling_cycles: int = 5
    run_up_s: float = 2.0


def sampled(times_s: Array, phase_rad: Array, values: Array) -> SampledChannel:
    """Return the samples of a channel with their weights; phases that run backward by noise count as standing."""
    return SampledChannel(times_s, phase_rad, values, phase_weights(phase_rad))


def period() -> CycleFeature:
    """Return the duration of the cycle."""
    return CycleFeature("period_s", "s", "duration of the cycle", (), lambda cycle: cycle.period_s)


def mean(name: str, unit: str, column: str, meaning: str) -> CycleFeature:
    """Return the mean of a channel over the cycle's angle."""

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        return weighted_sum(channel.weights, channel.values)

    return CycleFeature(name, unit, meaning, (column,), of)


def harmonic(name: str, unit: str, column: str, order: int, part: Literal["cos", "sin"], meaning: str) -> CycleFeature:
    """Return a Fourier coefficient of a channel over the cycle's angle, ``2 <x cos n phi>`` or with sin."""

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        return fourier_coefficient(channel.weights, channel.phase_rad, channel.values, order, part == "sin")

    return CycleFeature(name, unit, meaning, (column,), of)


def speed_harmonic(name: str, column: str, order: int, part: Literal["cos", "sin"], meaning: str) -> CycleFeature:
    """Return a Fourier coefficient of the speed of a turning joint over its mean, from the angle alone.

    With psi = 2 pi (t - t0)/T, the angle runs ahead of psi by a periodic d(psi). The speed is (1 + d')/T, so the
    coefficient of cos n psi of the relative speed is n times that of sin n psi of d, that of sin -n times that of cos.
    """

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        psi, ahead = lead(channel.times_s, channel.phase_rad, cycle.begin_s, cycle.period_s)
        weights = phase_weights(psi)
        sign = 1.0 if part == "cos" else -1.0
        return sign * order * fourier_coefficient(weights, psi, ahead, order, part == "cos")

    return CycleFeature(name, "1", meaning, (column,), of)


def _extreme(values: Array, share: float) -> float:
    """Return the mean of the largest share of the values; of the smallest where the share is negative."""
    count = max(1, round(abs(share) * len(values)))
    return mean_of_largest(values, count) if share > 0.0 else mean_of_smallest(values, count)


def upper(name: str, unit: str, column: str, meaning: str, share: float = 0.05) -> CycleFeature:
    """Return the mean of the largest share of a channel's samples: a maximum that noise moves little."""
    return CycleFeature(name, unit, meaning, (column,), lambda c: _extreme(c.channels[column].values, share))


def swing(name: str, unit: str, column: str, meaning: str, share: float = 0.05) -> CycleFeature:
    """Return the mean of the largest share of a channel's samples less that of the smallest."""

    def of(cycle: SampledCycle) -> float:
        values = cycle.channels[column].values
        return _extreme(values, share) - _extreme(values, -share)

    return CycleFeature(name, unit, meaning, (column,), of)


def share_above(name: str, column: str, part: float, meaning: str) -> CycleFeature:
    """Return the share of the cycle in which a channel lies above a part of the way from its low to its high."""

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        low, high = _extreme(channel.values, -0.05), _extreme(channel.values, 0.05)
        return weight_above(channel.weights, channel.values, low + part * (high - low))

    return CycleFeature(name, "1", meaning, (column,), of)


def event_share(name: str, column: str, meaning: str, pick: Literal["first", "last"] = "first") -> CycleFeature:
    """Return when in the cycle an event came, as a share of the cycle's angle."""
    place = 0 if pick == "first" else -1
    return CycleFeature(name, "1", meaning, (column,), lambda c: float(c.channels[column].phase_rad[place] / TURN))


def event_ratio(name: str, above: str, below: str, meaning: str, sign: float = -1.0) -> CycleFeature:
    """Return the sum of one channel of the cycle's events over that of another, its sign turned if not told else."""

    def of(cycle: SampledCycle) -> float:
        return float(sign * cycle.channels[above].values.sum() / cycle.channels[below].values.sum())

    return CycleFeature(name, "1", meaning, (above, below), of)


def event_value(name: str, unit: str, column: str, meaning: str, pick: Literal["largest", "sum"]) -> CycleFeature:
    """Return the largest, or the sum, of a channel of the cycle's events."""
    choose = np.max if pick == "largest" else np.sum
    return CycleFeature(name, unit, meaning, (column,), lambda c: float(choose(c.channels[column].values)))
