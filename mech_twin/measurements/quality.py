# SPDX-License-Identifier: Apache-2.0
"""Quality of measured channels: rate, jitter, gaps, drift, resolution, saturation and noise, block by block."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mech_twin.measurements.blocks import Array, Block

KEPT = 1 << 16  # numbers of a channel stored for medians and percentiles
LONG_INTERVAL = 1.5  # times the median interval: a longer one is a gap
NORMAL_MEDIAN = 0.674489750196082  # median of |x| over the standard deviation, for a normal x
FEW_SAMPLES = 8
SATURATED_RUN = 3  # equal extreme values in a row
SATURATED_SHARE = 0.005
DRIFT_FLAW = 1e-4
WHOLE_MULTIPLE = 0.02
MOST_STEPS = 1000.0  # in quanta: larger differences are not tested for being multiples
REPEATED_LEVELS = 0.5  # of the samples: with fewer distinct values, values repeat
LEAST_MULTIPLES = 3  # distinct multiples required if no value repeats
LEAST_DELAYS, CERTAIN = 3, 4.0  # samples that tell a drift, and standard errors that it must exceed
BAD_JITTER = 0.25  # of the interval: more is a flaw


class Quality(NamedTuple):
    """Quality of one channel in one run; values are in the channel's own unit."""

    samples: int
    rate_hz: float
    jitter_s: float
    gaps: int
    repeats: int
    back: int
    drift: float
    quantum: float
    saturated: float
    nan: int
    noise: float
    low: float
    high: float
    span_s: float

    @property
    def unstamped(self) -> bool:
        """Whether all samples have one and the same stamp, as of a publisher that leaves the header out."""
        return self.samples >= FEW_SAMPLES and self.repeats == self.samples - 1

    def flaws(self) -> list[str]:
        """Return the flaws of the channel, a phrase each."""
        if self.samples < FEW_SAMPLES:
            return [f"{self.samples} samples, expected at least {FEW_SAMPLES}"]
        found = []
        if self.low == self.high:
            found.append(f"constant at {self.low:.6g}")
        if self.samples and self.nan == self.samples:
            found.append("no number at all")
        elif self.nan:
            found.append(f"{self.nan} NaN")
        if self.back:
            found.append(f"stamps go back {self.back} times")
        if self.repeats:
            found.append(f"{self.repeats} repeated stamps")
        if self.gaps:
            found.append(f"{self.gaps} gaps longer than {LONG_INTERVAL:g} intervals")
        if self.rate_hz > 0.0 and self.jitter_s * self.rate_hz > BAD_JITTER:
            found.append(f"jitter {100.0 * self.jitter_s * self.rate_hz:.0f} % of the interval")
        if self.saturated > SATURATED_SHARE:
            found.append(f"{100.0 * self.saturated:.1f} % of the samples stand at the end of the range")
        if abs(self.drift) > DRIFT_FLAW:
            found.append(f"log clock drifts {1e6 * self.drift:.0f} ppm against the stamps")
        return found


class _Thinned:
    """Decimates a stream to bounded length: all numbers first, then every second, every fourth, and so on."""

    def __init__(self) -> None:
        self._parts: list[Array] = []
        self._count = self._seen = 0
        self._stride = 1

    def add(self, values: Array) -> None:
        kept = values[(-self._seen) % self._stride :: self._stride].copy()  # a view would keep the whole block
        self._seen += len(values)
        self._parts.append(kept)
        self._count += len(kept)
        while self._count > KEPT:
            self._parts = [self.values()[::2]]
            self._count = len(self._parts[0])
            self._stride *= 2

    def values(self) -> Array:
        return np.concatenate(self._parts) if self._parts else np.empty(0)


def _length(interval_s: Array | float) -> npt.NDArray[np.int64]:
    """Return the length of intervals as integers that rise with it, to one part in 16384: the first bits of a float."""
    return np.asarray(interval_s, dtype=np.float64).view(np.int64) >> 38


def unit_differences(times_s: Array, values: Array, order: int) -> Array:
    """Return the size of the divided differences of a series (n,), scaled so that white noise keeps its deviation.

    Those of a polynomial of lower degree are zero however unevenly its samples come, so that jitter and losses add
    nothing.  Differences across a repeated stamp are left out.
    """
    count = max(len(times_s) - order, 0)
    total, squares = np.zeros(count), np.zeros(count)
    with np.errstate(divide="ignore", invalid="ignore"):
        for j in range(order + 1):
            apart = [times_s[j : j + count] - times_s[m : m + count] for m in range(order + 1) if m != j]
            weights = 1.0 / np.prod(apart, axis=0)
            total += weights * values[j : j + count]
            squares += weights**2
        found = np.abs(total) / np.sqrt(squares)
    return np.asarray(found[np.isfinite(found)])


class QualityGauge:
    """Computes the quality of one channel, block by block."""

    def __init__(self) -> None:
        self._stamps, self._shown = np.empty(0), np.empty((2, 0))  # the last stamp; the last two rising, with values
        self._intervals, self._bends, self._kept = _Thinned(), _Thinned(), _Thinned()
        self._samples = self._repeats = self._back = self._nan = 0
        self._lengths, self._counts = (np.empty(0, dtype=np.int64) for _ in range(2))  # intervals by their length
        self._low, self._high = np.inf, -np.inf
        self._flat: tuple[float, int] = (np.nan, 0)
        self._extremes: dict[float, int] = {}
        self._first_s = self._last_s = np.nan
        self._delays = np.zeros(6)  # sums over samples of 1, time, delay, and the products of two of these

    def add(self, block: Block) -> None:
        """Add a block; a sample without a stamp is left out and counted as NaN."""
        stamped = np.isfinite(block.times_s)
        self._samples += len(stamped)
        self._nan += int(np.count_nonzero(~stamped))
        if not stamped.any():
            return
        times, values = block.times_s[stamped], block.values[stamped]
        self._first_s = float(times[0]) if np.isnan(self._first_s) else self._first_s
        self._last_s = float(times[-1])
        finite = np.isfinite(values)
        self._nan += int(np.count_nonzero(~finite))
        intervals = np.diff(np.concatenate([self._stamps, times]))
        self._repeats += int(np.count_nonzero(intervals == 0.0))
        self._back += int(np.count_nonzero(intervals < 0.0))
        self._intervals.add(intervals[intervals > 0.0])
        lengths, counts = np.unique(_length(intervals[intervals > 0.0]), return_counts=True)
        self._lengths, places = np.unique(np.concatenate([self._lengths, lengths]), return_inverse=True)
        counts = np.concatenate([self._counts, counts])
        self._counts = np.bincount(places, counts, len(self._lengths)).astype(np.int64)
        if finite.any():
            self._take_values(values[finite])
        risen = np.append(np.ones(len(times) - len(intervals), dtype=bool), intervals > 0.0)
        shown = np.hstack([self._shown, [times[risen], values[risen]]])  # a repeated sample has no curvature of its own
        self._bends.add(unit_differences(shown[0], shown[1], 2))
        self._kept.add(values[finite])
        self._stamps, self._shown = times[-1:], shown[:, -2:]
        if len(block.delays_s):
            since, delays = times - self._first_s, block.delays_s[stamped]
            squares = (since @ since, since @ delays, delays @ delays)
            self._delays += np.array([len(since), since.sum(), delays.sum(), *squares])

    def _take_values(self, values: Array) -> None:
        self._low, self._high = min(self._low, float(values.min())), max(self._high, float(values.max()))
        last, run = self._flat
        starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        own = np.diff(np.append(starts, len(values)))
        lengths = own.copy()
        if values[0] == last:
            lengths[0] += run
        ends = {self._low, self._high}  # a single value while the channel is constant
        for value in ends:
            stands = (lengths >= SATURATED_RUN) & (values[starts] == value)
            self._extremes[value] = self._extremes.get(value, 0) + int(own[stands].sum())
        self._extremes = {value: count for value, count in self._extremes.items() if value in ends}
        self._flat = (float(values[-1]), int(lengths[-1]))

    def quality(self) -> Quality:
        """Return the quality of all blocks."""
        intervals = self._intervals.values()
        usual = float(np.median(intervals)) if len(intervals) else np.nan
        regular = intervals[intervals <= LONG_INTERVAL * usual]
        jitter = float(np.percentile(np.abs(regular - usual), 95.0)) if len(regular) else np.nan
        bends = self._bends.values()
        empty = self._nan == self._samples
        return Quality(
            samples=self._samples,
            rate_hz=1.0 / usual if usual > 0.0 else 0.0,
            jitter_s=jitter,
            gaps=int(self._counts[self._lengths > _length(LONG_INTERVAL * usual)].sum()),
            repeats=self._repeats,
            back=self._back,
            drift=self._drift(),
            quantum=self._quantum(),
            saturated=self._saturated(),
            nan=self._nan,
            noise=float(np.median(bends)) / NORMAL_MEDIAN if len(bends) else np.nan,
            low=np.nan if empty else self._low,
            high=np.nan if empty else self._high,
            span_s=self._last_s - self._first_s,
        )

    def _drift(self) -> float:
        """Return the drift of the log clock relative to the stamps (s per s); 0 where the delays scatter as much.

        It is the slope of a line through all delays, if that is beyond `CERTAIN` of its standard errors.
        """
        count, time, delay, time_2, product, delay_2 = self._delays.tolist()
        if count < LEAST_DELAYS or (spread := time_2 - time**2 / count) <= 0.0:
            return 0.0
        slope = (product - time * delay / count) / spread
        scatter = max(delay_2 - delay**2 / count - slope**2 * spread, 0.0) / (count - 2.0)
        return slope if abs(slope) > CERTAIN * (scatter / spread) ** 0.5 else 0.0

    def _quantum(self) -> float:
        """Return the step of which all differences are integer multiples; 0 without one."""
        kept = self._kept.values()
        levels = np.unique(kept)
        steps = np.diff(levels)
        steps = steps[steps > 1e-9 * (self._high - self._low)] if len(steps) else steps
        if len(steps) < FEW_SAMPLES:
            return 0.0
        smallest = float(np.min(steps))
        tried = steps[steps < MOST_STEPS * smallest]
        smallest = float(np.median(tried[tried < 1.5 * smallest]))
        multiples = np.round(tried / smallest)
        if len(levels) > REPEATED_LEVELS * len(kept) and len(np.unique(multiples)) < LEAST_MULTIPLES:
            return 0.0  # a uniform motion has equal steps too
        off = np.abs(tried / smallest - multiples)
        whole = np.count_nonzero(off < WHOLE_MULTIPLE + 1e-5 * tried / smallest) >= 0.99 * len(tried)
        return smallest if whole and len(tried) >= FEW_SAMPLES else 0.0

    def _saturated(self) -> float:
        counted = sum(n for value, n in self._extremes.items() if value in (self._low, self._high))
        return counted / self._samples if self._samples and self._high > self._low else 0.0
