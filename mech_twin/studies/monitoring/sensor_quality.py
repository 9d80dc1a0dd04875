# SPDX-License-Identifier: Apache-2.0
"""Detects faulty sensors from their samples alone, before the machine is evaluated.

Each channel has four numbers per cycle: number of samples, lower quartile of their spacing, longest run of equal values
as a share of the cycle, and isolation of single samples.  Losses hardly change that quartile, even with jitter.  ::

    isolation = largest of |x_i - (x_(i-1) + x_(i+1))/2| - 2 |x_(i+1) - x_(i-1)|

At an extremum of a smooth signal it depends on where the samples fall.  So a sample must stand out from the curvature,
too: the part of x_i - (x_(i-1) + x_(i+1))/2 that a neighbour shares, with its sign.
The limits come from the baseline.  A channel with exact plateaus in the healthy machine cannot be detected as stuck,
and one whose samples come in bursts, as at events, has no spacing that could change.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from mech_twin.capabilities.cycle import Array, gap_limits, sample_quality
from mech_twin.kernels.kernel import kernel

PLATEAU = 0.3  # of a cycle: with a longer plateau in the baseline, a channel is not tested for being stuck
LOST = 0.1  # share of samples lost in excess of the baseline
EVEN = 0.5  # of a cycle that its samples fill at their spacing: with less in the baseline, the spacing is not tested
SPACING = 1.15  # ratio to the usual spacing, or its inverse: beyond it the rate has changed
ISOLATION = 4.0  # times the largest isolation in the baseline
LEAST_SAMPLES = 6  # of a channel in a cycle; an event channel needs one
LARGEST_GAP = 0.25  # of a cycle, between samples of a channel
ORDINARY_GAP, SPACINGS = 0.02, 5.0  # shares of a cycle, and of the usual spacing; a gap exceeds the larger of both
KINDS = ("turns", "stuck", "dropout", "rate", "spikes")
Share = Annotated[float, Field(ge=0.0, le=1.0)]


@kernel
def with_later_samples(
    held_s: Array, held: Array, newest_s: float, times_s: Array, values: Array
) -> tuple[Array, Array, float]:
    """Return the samples held and those that are finite and later than the newest so far, and the newest stamp."""
    count = len(held_s)
    all_s, all_values = np.empty(count + len(times_s)), np.empty(count + len(times_s))
    all_s[:count], all_values[:count] = held_s, held
    for i in range(len(times_s)):
        if newest_s < times_s[i] < np.inf and np.isfinite(values[i]):
            newest_s, all_s[count], all_values[count] = times_s[i], times_s[i], values[i]
            count += 1
    return all_s[:count], all_values[:count], newest_s


@dataclass
class ChannelBuffer:
    """Samples of a channel that may still be needed, and its newest stamp."""

    times_s: Array = field(default_factory=lambda: np.empty(0))
    values: Array = field(default_factory=lambda: np.empty(0))
    newest_s: float = -np.inf

    def add(self, times_s: Array, values: Array) -> None:
        """Append samples later than the newest one; drop earlier ones and those that are not finite."""
        self.times_s, self.values, self.newest_s = with_later_samples(
            self.times_s, self.values, self.newest_s, times_s, values
        )

    def between(self, begin_s: float, end_s: float) -> tuple[Array, Array]:
        """Return stamps and values of the samples in [begin, end)."""
        first, last = self.times_s.searchsorted(begin_s), self.times_s.searchsorted(end_s)
        return self.times_s[first:last], self.values[first:last]

    def longest_step_s(self, begin_s: float, end_s: float) -> float:
        """Return the longest time between neighbouring samples about [begin, end] (s); 0 without two of them."""
        first, last = self.times_s.searchsorted(begin_s), self.times_s.searchsorted(end_s, "right")
        return float(np.diff(self.times_s[max(first - 1, 0) : last + 1]).max(initial=0.0))

    def forget(self, before_s: float) -> None:
        """Drop the samples before an instant (s)."""
        first = int(self.times_s.searchsorted(before_s))
        if first > 0:
            self.times_s, self.values = self.times_s[first:], self.values[first:]


class ChannelQuality(NamedTuple):
    """A channel in one cycle: samples, quartile of spacing (s), share of longest equal run, isolation (SI).

    ``wrong_turns``: turns of the angle that counts the cycles, if they cannot be the machine's; below 0 backward.
    ``curvature``: largest curvature (SI) that neighbouring samples show.
    """

    samples: int
    spacing_s: float
    equal_share: float
    isolation: float
    wrong_turns: int = 0
    curvature: float = 0.0


def is_whole(times_s: Array, begin_s: float, end_s: float) -> bool:
    """Return whether a cycle has enough samples and no gap, which would look like a change of the machine."""
    if len(times_s) < LEAST_SAMPLES:
        return False
    largest_s, spacing_s = gap_limits(times_s, begin_s, end_s)
    period_s = end_s - begin_s
    usual_s = max(ORDINARY_GAP * period_s, SPACINGS * spacing_s)
    return bool(largest_s <= min(LARGEST_GAP * period_s, usual_s))


def channel_quality(times_s: Array, values: Array) -> ChannelQuality:
    """Return the quality of the samples (n,) of a channel within a cycle."""
    if len(values) < 3:
        return ChannelQuality(len(values), float("nan"), 0.0, 0.0)
    spacing_s, longest, isolation, curvature = sample_quality(times_s, values)
    return ChannelQuality(len(values), spacing_s, longest / len(values), isolation, curvature=curvature)


class SensorLimits(NamedTuple):
    """Usual values of a channel: samples per second, spacing (s), lost share, longest equal run, isolation (SI)."""

    rate_hz: Annotated[float, Field(gt=0.0)]
    spacing_s: Annotated[float, Field(gt=0.0)]
    lost: Share
    equal_share: Share
    isolation: Annotated[float, Field(ge=0.0)]


class SensorFinding(NamedTuple):
    """A sensor fault and its size: a share, or the ratio to the usual value."""

    kind: str
    column: str
    size: float

    @property
    def name(self) -> str:
        """Name of the fault."""
        return f"sensor_{self.kind}:{self.column}"


def sensor_limits(cycles: Sequence[tuple[float, Mapping[str, ChannelQuality]]]) -> dict[str, SensorLimits]:
    """Return the usual values from healthy cycles: duration (s) and the quality of each channel."""
    found = {}
    for column in dict.fromkeys(name for _, qualities in cycles for name in qualities):
        rows = np.array([[period_s, *qualities[column]] for period_s, qualities in cycles if column in qualities])
        rows = rows[rows[:, 1] >= 3]
        if not len(rows):
            continue
        rates = rows[:, 1] / rows[:, 0]
        rate_hz = float(np.median(rates))
        found[column] = SensorLimits(
            rate_hz,
            float(np.median(rows[:, 2])),
            float(np.clip(1.0 - np.quantile(rates, 0.001) / rate_hz, 0.0, 1.0)),
            float(rows[:, 3].max()),
            float(rows[:, [4, 6]].max()) if rows[:, 4].any() else 0.0,
        )
    return found


def sensor_findings(
    limits: Mapping[str, SensorLimits], period_s: float, qualities: Mapping[str, ChannelQuality]
) -> tuple[SensorFinding, ...]:
    """Return the sensor faults in a cycle of this duration (s)."""
    found = []
    for column, usual in limits.items():
        quality = qualities.get(column, ChannelQuality(0, float("nan"), 0.0, 0.0))
        lost = 1.0 - quality.samples / (usual.rate_hz * period_s)
        apart = quality.spacing_s / usual.spacing_s, 1.0 / max(1.0 - lost, 1e-9)  # jitter moves one, losses the other
        is_tested = usual.rate_hz * usual.spacing_s >= EVEN
        is_rarer = min(apart) > SPACING and apart[0] >= (1.0 - 0.5 * LOST) * apart[1]  # losses leave the spacing
        if quality.wrong_turns:
            found.append(SensorFinding("turns", column, quality.wrong_turns))
        elif usual.equal_share < PLATEAU and quality.equal_share > 0.5 * (1.0 + usual.equal_share):
            found.append(SensorFinding("stuck", column, quality.equal_share))
        elif is_tested and (is_rarer or max(apart) < 1.0 / SPACING):
            found.append(SensorFinding("rate", column, apart[1]))
        elif lost > usual.lost + LOST + 2.0 / max(usual.rate_hz * period_s, 1.0):
            found.append(SensorFinding("dropout", column, lost))
        elif usual.isolation > 0.0 and quality.isolation > ISOLATION * usual.isolation:
            found.append(SensorFinding("spikes", column, quality.isolation / usual.isolation))
    return tuple(sorted(found, key=lambda each: KINDS.index(each.kind)))
