# SPDX-License-Identifier: Apache-2.0
"""Detects faulty sensors from their samples alone, before the machine is evaluated.

Each channel has four numbers per cycle: number of samples, lower quartile of their spacing, longest run of equal values
as a share of the cycle, and isolation of single samples.  Losses hardly change that quartile, even with jitter.  ::

    isolation = largest of |x_i - (x_(i-1) + x_(i+1))/2| - 2 |x_(i+1) - x_(i-1)|

The limits come from the baseline.  A channel with exact plateaus in the healthy machine cannot be detected as stuck,
and one whose samples come in bursts, as at events, has no spacing that could change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mech_twin.capabilities.cycle import Array
from mech_twin.capabilities.cycle_kernels import sample_quality

PLATEAU = 0.3  # of a cycle: with a longer plateau in the baseline, a channel is not tested for being stuck
LOST = 0.1  # share of samples lost in excess of the baseline
EVEN = 0.5  # of a cycle that its samples fill at their spacing: with less in the baseline, the spacing is not tested
SPACING = 1.15  # ratio to the usual spacing, or its inverse: beyond it the rate has changed
ISOLATION = 4.0  # times the largest isolation in the baseline
KINDS = ("stuck", "dropout", "rate", "spikes")


class ChannelQuality(NamedTuple):
    """A channel in one cycle: samples, quartile of spacing (s), share of longest equal run, isolation (SI)."""

    samples: int
    spacing_s: float
    equal_share: float
    isolation: float


def channel_quality(times_s: Array, values: Array) -> ChannelQuality:
    """Return the quality of the samples (n,) of a channel within a cycle."""
    if len(values) < 3:
        return ChannelQuality(len(values), float("nan"), 0.0, 0.0)
    spacing_s, longest, isolation = sample_quality(times_s, values)
    return ChannelQuality(len(values), spacing_s, longest / len(values), isolation)


class SensorLimits(NamedTuple):
    """Usual values of a channel: samples per second, spacing (s), lost share, longest equal run, isolation (SI)."""

    rate_hz: float
    spacing_s: float
    lost: float
    equal_share: float
    isolation: float


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
            float(rows[:, 4].max()),
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
        stretched = quality.spacing_s / usual.spacing_s
        is_tested = usual.rate_hz * usual.spacing_s >= EVEN
        is_even = (1.0 - lost) * stretched >= 1.0 - 0.5 * LOST  # as many samples as fill the cycle at their spacing
        if usual.equal_share < PLATEAU and quality.equal_share > 0.5 * (1.0 + usual.equal_share):
            found.append(SensorFinding("stuck", column, quality.equal_share))
        elif is_tested and is_even and not 1.0 / SPACING <= stretched <= SPACING:
            found.append(SensorFinding("rate", column, stretched))
        elif lost > usual.lost + LOST + 2.0 / max(usual.rate_hz * period_s, 1.0):
            found.append(SensorFinding("dropout", column, lost))
        elif usual.isolation > 0.0 and quality.isolation > ISOLATION * usual.isolation:
            found.append(SensorFinding("spikes", column, quality.isolation / usual.isolation))
    return tuple(sorted(found, key=lambda each: KINDS.index(each.kind)))
