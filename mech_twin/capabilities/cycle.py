# SPDX-License-Identifier: Apache-2.0
"""One cycle of a machine as sampled channels, and the features computed from it.

A channel has its own instants.  Each sample is weighted by the phase interval it represents.  So a mean or a harmonic
is one over the cycle's angle, for any rate and jitter of the sensor::

    weight_i = (phase_(i+1) - phase_(i-1))/(4 pi),   with the first and the last as neighbours

Machines share the features of a turn of a crank (period, speed, torque) and those of a strain gauge on a struck rod.
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
    mean_of_ordered,
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
    """Signal that defines the cycles.

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
        Period of a signal that is driven by a clock, about which single rises are averaged.  0: no known clock.
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
    """One cycle: its begin and end (s), and its channels by the column that each measures."""

    number: int
    begin_s: float
    end_s: float
    channels: Mapping[str, SampledChannel]

    @property
    def period_s(self) -> float:
        """Duration of the cycle."""
        return self.end_s - self.begin_s


class CycleFeature(NamedTuple):
    """A feature: a number computed from a cycle.

    Attributes
    ----------
    name, unit, meaning : str
        Name, SI unit (``1``: dimensionless), and a description of one line.
    needs : tuple of str
        Columns it is computed from; all must be measured.
    of : callable
        ``of(cycle)``: value of the feature.
    """

    name: str
    unit: str
    meaning: str
    needs: tuple[str, ...]
    of: Callable[[SampledCycle], float]


class CycleFeatures(NamedTuple):
    """Cycle reference and features that a machine declares.

    Attributes
    ----------
    reference : CycleReference
        Signal that defines the cycles.
    features : tuple of CycleFeature
        Features in display order.
    settling_cycles : int
        Cycles after a change of a parameter until its effect is nearly complete.
    run_up_s : float
        Time from the configured start to steady running.
    """

    reference: CycleReference
    features: tuple[CycleFeature, ...]
    settling_cycles: int = 5
    run_up_s: float = 2.0


def sampled(times_s: Array, phase_rad: Array, values: Array) -> SampledChannel:
    """Return the samples of a channel with their weights; phases that decrease because of noise are held constant."""
    return SampledChannel(times_s, phase_rad, values, phase_weights(phase_rad))


def period() -> CycleFeature:
    """Return the feature: duration of the cycle."""
    return CycleFeature("period_s", "s", "duration of the cycle", (), lambda cycle: cycle.period_s)


def mean(name: str, unit: str, column: str, meaning: str) -> CycleFeature:
    """Return the feature: mean of a channel over the cycle's angle."""

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        return weighted_sum(channel.weights, channel.values)

    return CycleFeature(name, unit, meaning, (column,), of)


def harmonic(name: str, unit: str, column: str, order: int, part: Literal["cos", "sin"], meaning: str) -> CycleFeature:
    """Return the feature: Fourier coefficient of a channel over the cycle's angle, ``2 <x cos n phi>`` or with sin."""

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        return fourier_coefficient(channel.weights, channel.phase_rad, channel.values, order, part == "sin")

    return CycleFeature(name, unit, meaning, (column,), of)


def speed_harmonic(name: str, column: str, order: int, part: Literal["cos", "sin"], meaning: str) -> CycleFeature:
    """Return the feature: Fourier coefficient of a joint's relative speed, from its angle alone.

    With psi = 2 pi (t - t0)/T, the angle leads psi by a periodic d(psi). The speed over its mean is 1 + d', so its
    coefficient of cos n psi is n times that of sin n psi of d, and that of sin is -n times that of cos.
    """

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        psi, ahead = lead(channel.times_s, channel.phase_rad, cycle.begin_s, cycle.period_s)
        weights = phase_weights(psi)
        sign = 1.0 if part == "cos" else -1.0
        return sign * order * fourier_coefficient(weights, psi, ahead, order, part == "cos")

    return CycleFeature(name, "1", meaning, (column,), of)


def _extreme(values: Array, share: float) -> float:
    """Return the mean of the given share of largest values; of the smallest for a negative share."""
    count = max(1, round(abs(share) * len(values)))
    return mean_of_ordered(values, len(values) - count if share > 0.0 else 0, count)


def upper(name: str, unit: str, column: str, meaning: str, share: float = 0.05) -> CycleFeature:
    """Return the feature: mean of a channel's largest samples, a maximum with little sensitivity to noise."""
    return CycleFeature(name, unit, meaning, (column,), lambda c: _extreme(c.channels[column].values, share))


def swing(name: str, unit: str, column: str, meaning: str, share: float = 0.05) -> CycleFeature:
    """Return the feature: mean of a channel's largest samples minus that of its smallest."""

    def of(cycle: SampledCycle) -> float:
        values = cycle.channels[column].values
        return _extreme(values, share) - _extreme(values, -share)

    return CycleFeature(name, unit, meaning, (column,), of)


def share_above(name: str, column: str, part: float, meaning: str) -> CycleFeature:
    """Return the feature: share of the cycle in which a channel exceeds a level between its low and high."""

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        low, high = _extreme(channel.values, -0.05), _extreme(channel.values, 0.05)
        return weight_above(channel.weights, channel.values, low + part * (high - low))

    return CycleFeature(name, "1", meaning, (column,), of)


def event_share(name: str, column: str, meaning: str) -> CycleFeature:
    """Return the feature: phase of the first event, as a share of the cycle's angle."""
    return CycleFeature(name, "1", meaning, (column,), lambda c: float(c.channels[column].phase_rad[0] / TURN))


def event_ratio(name: str, above: str, below: str, meaning: str, sign: float = -1.0) -> CycleFeature:
    """Return the feature: sum of one event channel over that of another, times ``sign``."""

    def of(cycle: SampledCycle) -> float:
        return float(sign * cycle.channels[above].values.sum() / cycle.channels[below].values.sum())

    return CycleFeature(name, "1", meaning, (above, below), of)


def event_value(name: str, unit: str, column: str, meaning: str, pick: Literal["largest", "sum"]) -> CycleFeature:
    """Return the feature: largest value, or sum, of an event channel."""
    choose = np.max if pick == "largest" else np.sum
    return CycleFeature(name, unit, meaning, (column,), lambda c: float(choose(c.channels[column].values)))


def speed_features(crank: str) -> tuple[CycleFeature, ...]:
    """Return the features period and relative speed of a turn; ``crank`` is the column of its angle (rad)."""
    return (
        period(),
        speed_harmonic("speed_cos_1", crank, 1, "cos", "relative crank speed, cosine of the turn"),
        speed_harmonic("speed_sin_1", crank, 1, "sin", "relative crank speed, sine of the turn"),
        speed_harmonic("speed_cos_2", crank, 2, "cos", "relative crank speed, cosine of half a turn"),
        speed_harmonic("speed_sin_2", crank, 2, "sin", "relative crank speed, sine of half a turn"),
    )


def crank_features(crank: str, torque: str) -> tuple[CycleFeature, ...]:
    """Return the features of period, speed and torque of a turn.

    Parameters
    ----------
    crank, torque : str
        Columns of the crank's angle (rad) and of the driving torque (N m).
    """
    return (
        *speed_features(crank),
        mean("torque_mean_nm", "N.m", torque, "mean driving torque"),
        upper("torque_peak_nm", "N.m", torque, "largest driving torque"),
        harmonic("torque_cos_1_nm", "N.m", torque, 1, "cos", "driving torque, cosine of the turn"),
        harmonic("torque_sin_1_nm", "N.m", torque, 1, "sin", "driving torque, sine of the turn"),
        harmonic("torque_cos_2_nm", "N.m", torque, 2, "cos", "driving torque, cosine of half a turn"),
        harmonic("torque_sin_2_nm", "N.m", torque, 2, "sin", "driving torque, sine of half a turn"),
    )


def gauge_features(kind: str, rod: str) -> tuple[CycleFeature, ...]:
    """Return the features of a gauge; a soft wall or a worn foot changes the reflected energy.

    Parameters
    ----------
    kind : str
        Kind of the events that it measures.
    rod : str
        Name of the rod: tool, stop.
    """
    incident, forward, reflected, peak = (
        f"event.{kind}.{what}" for what in ("incident_energy", "forward_energy", "reflected_energy", "peak_force")
    )
    return (
        event_value("incident_energy_j", "J", incident, f"energy of the first wave in the {rod}", "sum"),
        event_ratio("reflected_share", reflected, forward, "energy that comes back over that going forward", 1.0),
        event_value("gauge_peak_n", "N", peak, f"largest force in the {rod}", "largest"),
    )
