# SPDX-License-Identifier: Apache-2.0
"""One cycle of a machine as sampled channels, and the features computed from it.

A channel has its own instants.  Each sample is weighted by the phase interval it represents.  So a mean or a harmonic
is one over the cycle's angle, for any rate and jitter of the sensor::

    weight_i = (phase_(i+1) - phase_(i-1))/(4 pi),   with the first and the last as neighbours

Machines share the features of a turn of a crank (period, speed, torque) and those of a strain gauge on a struck rod.

Live samples and recordings take the same compiled sums, in the order of the samples, so that a feature is
reproducible to the bit.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from mech_twin.kernels.kernel import kernel

Array = npt.NDArray[np.float64]
TURN = 2.0 * pi


@kernel
def phase_weights(phase_rad: Array) -> Array:
    """Return the share of the cycle that each sample represents; phases that decrease by noise are held constant."""
    count = len(phase_rad)
    standing, weights = np.empty(count), np.empty(count)
    for i in range(count):
        standing[i] = phase_rad[i] if i == 0 else max(standing[i - 1], phase_rad[i])
    for i in range(count):
        after = standing[i + 1] if i + 1 < count else standing[0] + TURN
        before = standing[i - 1] if i > 0 else standing[count - 1] - TURN
        weights[i] = (after - before) / (2.0 * TURN)
    return weights


@kernel
def weighted_sum(weights: Array, values: Array) -> float:
    """Return the weighted sum of the values."""
    total = 0.0
    for i in range(len(values)):
        total += weights[i] * values[i]
    return total


@kernel
def fourier_coefficient(weights: Array, phase_rad: Array, values: Array, order: int, of_sine: bool) -> float:
    """Return ``2 <x cos n phi>``, or ``2 <x sin n phi>``."""
    total = 0.0
    for i in range(len(values)):
        angle = order * phase_rad[i]
        total += weights[i] * (sin(angle) if of_sine else cos(angle)) * values[i]
    return 2.0 * total


@kernel
def lead_coefficient(
    times_s: Array, phase_rad: Array, begin_s: float, period_s: float, order: int, of_sine: bool
) -> float:
    """Return a `fourier_coefficient` of the lead of a joint's phase over the angle psi of a uniform rotation (rad)."""
    psi, ahead = np.empty(len(times_s)), np.empty(len(times_s))
    for i in range(len(times_s)):
        psi[i] = TURN * (times_s[i] - begin_s) / period_s
        ahead[i] = phase_rad[i] - psi[i]
    return fourier_coefficient(phase_weights(psi), psi, ahead, order, of_sine)


@kernel
def mean_of_extreme(weights: Array, values: Array, share: float, of_largest: bool) -> float:
    """Return the mean over the share of the cycle with the largest values, or with the smallest.

    The share is exact: of the last sample only a part counts.  A whole number of samples is another share in each
    cycle, so that the feature steps with rate and speed.
    """
    order, total, left = np.argsort(values), 0.0, share
    for k in range(len(values)):
        i = order[len(values) - 1 - k] if of_largest else order[k]
        part = min(left, weights[i])
        total += part * values[i]
        left -= part
        if left <= 0.0:
            break
    return total / (share - left)


@kernel
def weight_above(weights: Array, values: Array, level: float) -> float:
    """Return the share of the cycle above a level; from sample to sample, and on to the first, values go straight."""
    total = 0.0
    for i in range(len(values)):
        before, here = values[i - 1] - level, values[i] - level
        if before > 0.0 or here > 0.0:
            part = max(before, here) / abs(here - before) if before * here < 0.0 else 1.0
            total += 0.5 * (weights[i - 1] + weights[i]) * part
    return total


@kernel
def fitted_slope(x: Array, y: Array) -> float:
    """Return the slope of the least-squares line through points; nan if all have the same x."""
    mean_x, mean_y = x.mean(), y.mean()
    along, across = 0.0, 0.0
    for i in range(len(x)):
        along += (x[i] - mean_x) * (x[i] - mean_x)
        across += (x[i] - mean_x) * (y[i] - mean_y)
    return across / along if along > 0.0 else np.nan


@kernel
def phase_of_turn(angles_rad: Array, start_rad: float) -> Array:
    """Return the phase (rad) of the samples of a turn from its start angle; its ends 0 and 2 pi are added."""
    count = len(angles_rad)
    phase = np.empty(count + 2)
    phase[0], phase[count + 1] = 0.0, TURN
    for i in range(count):
        phase[i + 1] = min(max(angles_rad[i] - start_rad, 0.0), TURN)
    return phase


@kernel
def gap_limits(times_s: Array, begin_s: float, end_s: float) -> tuple[float, float]:
    """Return the largest gap of a channel in a cycle, to its ends included, and the median spacing (s)."""
    spacing = np.diff(times_s)
    largest = max(times_s[0] - begin_s, end_s - times_s[-1])
    for each in spacing:
        largest = max(largest, each)
    return largest, float(np.median(spacing))


@kernel
def sample_quality(times_s: Array, values: Array) -> tuple[float, int, float, float]:
    """Return lower quartile of the spacing (s), length of the longest equal run, isolation and curvature (SI)."""
    count, longest, run, isolation, curvature, before = len(values), 1, 1, 0.0, 0.0, 0.0
    spacings_s = np.empty(count - 1)
    for i in range(count - 1):
        spacings_s[i] = times_s[i + 1] - times_s[i]
        run = run + 1 if values[i + 1] - values[i] == 0.0 else 1
        longest = max(longest, run)
    for i in range(1, count - 1):
        off = values[i] - 0.5 * (values[i - 1] + values[i + 1])
        isolation = max(isolation, abs(off) - 2.0 * abs(values[i + 1] - values[i - 1]))
        if off * before > 0.0:
            curvature = max(curvature, min(abs(off), abs(before)))
        before = off
    place = (count - 2) // 4
    return np.partition(spacings_s, place)[place], longest, isolation, curvature


@kernel
def crossed_turn(
    times_s: Array, angles_rad: Array, first: int, boundary_rad: float, about_rad: float
) -> tuple[float, float]:
    """Return when an angle crosses a boundary, by a line through nearby samples; and the next boundary.

    The time is nan while samples are missing.  Boundaries within a gap of whole turns are skipped.
    """
    count, last = len(angles_rad), first
    while last < count and angles_rad[last] < boundary_rad + about_rad:
        last += 1
    if last == count:
        return np.nan, boundary_rad
    while angles_rad[last] - boundary_rad >= TURN:
        boundary_rad += TURN
    crossing = last
    while crossing >= 0 and angles_rad[crossing] >= boundary_rad:
        crossing -= 1
    if crossing < 0:
        return times_s[last], boundary_rad + TURN
    low = crossing
    while low >= 0 and angles_rad[low] >= boundary_rad - about_rad:
        low -= 1
    low += 1
    if last - low < 3:
        low, last = crossing, last + 1
    along, times = 0.0, 0.0
    for i in range(low, last):
        along += angles_rad[i] - boundary_rad
        times += times_s[i] - times_s[crossing]
    along, times = along / (last - low), times / (last - low)
    square, product = 0.0, 0.0
    for i in range(low, last):
        off = angles_rad[i] - boundary_rad - along
        square += off * off
        product += off * (times_s[i] - times_s[crossing])
    return times_s[crossing] + times - product / square * along, boundary_rad + TURN


@kernel
def first_rise(values: Array, first: int, level: float) -> int:
    """Return the index of the first sample from ``first`` on after which the level is reached; -1 without one."""
    for i in range(first, len(values) - 1):
        if values[i] < level <= values[i + 1]:
            return i
    return -1


@kernel
def first_below(times_s: Array, values: Array, after_s: float, since_s: float, before_s: float, level: float) -> int:
    """Return the index of the first sample below a level, later than ``after_s`` and in [since, before); -1 without."""
    first = max(np.searchsorted(times_s, after_s, side="right"), np.searchsorted(times_s, since_s))
    for i in range(first, len(values)):
        if times_s[i] >= before_s:
            break
        if values[i] < level:
            return i
    return -1


@kernel
def unwrapped(angles_rad: Array, farthest_rad: float, last_rad: float, turns: float) -> tuple[Array, float, float]:
    """Return angles with each step taken the shortest way round, nan beyond the farthest; the last, and its turns.

    ``last_rad`` and ``turns`` are those of the sample before, nan and 0 without one.
    """
    found = np.full(len(angles_rad), np.nan)
    for i in range(len(angles_rad)):
        angle = angles_rad[i]
        if abs(angle) <= farthest_rad:
            if not np.isnan(last_rad):
                turns -= np.rint((angle - last_rad) / TURN)
            found[i], last_rad = angle + TURN * turns, angle
    return found, last_rad, turns


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
        sign = 1.0 if part == "cos" else -1.0
        lead = lead_coefficient(channel.times_s, channel.phase_rad, cycle.begin_s, cycle.period_s, order, part == "cos")
        return sign * order * lead

    return CycleFeature(name, "1", meaning, (column,), of)


def _extreme(channel: SampledChannel, share: float) -> float:
    """Return the mean over the given share of the cycle with the largest values; with the smallest for a negative."""
    return mean_of_extreme(channel.weights, channel.values, abs(share), share > 0.0)


def upper(name: str, unit: str, column: str, meaning: str, share: float = 0.05) -> CycleFeature:
    """Return the feature: mean of a channel's largest values, a maximum with little sensitivity to noise."""
    return CycleFeature(name, unit, meaning, (column,), lambda c: _extreme(c.channels[column], share))


def swing(name: str, unit: str, column: str, meaning: str, share: float = 0.05) -> CycleFeature:
    """Return the feature: mean of a channel's largest values minus that of its smallest."""

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        return _extreme(channel, share) - _extreme(channel, -share)

    return CycleFeature(name, unit, meaning, (column,), of)


def share_above(name: str, column: str, part: float, meaning: str) -> CycleFeature:
    """Return the feature: share of the cycle in which a channel exceeds a level between its low and high."""

    def of(cycle: SampledCycle) -> float:
        channel = cycle.channels[column]
        low, high = _extreme(channel, -0.05), _extreme(channel, 0.05)
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
