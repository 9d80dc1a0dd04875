# SPDX-License-Identifier: Apache-2.0
"""The table of data quality finds what was put in, however the samples are cut into blocks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mech_twin.measurements.blocks import NO_DELAYS, Array, Block
from mech_twin.measurements.quality import KEPT, Quality, QualityGauge

RATE_HZ, COUNT = 200.0, 4000


def gauged(times_s: Array, values: Array, delays_s: Array = NO_DELAYS, cuts: tuple[int, ...] = ()) -> Quality:
    gauge = QualityGauge()
    for places in np.split(np.arange(len(times_s)), sorted(cuts)):
        gauge.add(Block(0, times_s[places], values[places], delays_s[places] if len(delays_s) else NO_DELAYS))
    return gauge.quality()


def motion(seed: int = 3) -> tuple[Array, Array]:
    times = np.arange(COUNT) / RATE_HZ
    return times, np.sin(2.0 * times) + 0.01 * np.random.default_rng(seed).standard_normal(COUNT)


def test_rate_jitter_and_noise_are_those_that_were_put_in() -> None:
    times, values = motion()
    jittered = times + 1e-4 * np.random.default_rng(4).standard_normal(COUNT)
    found = gauged(jittered, values)
    assert found.rate_hz == pytest.approx(RATE_HZ, rel=0.01)
    assert found.jitter_s == pytest.approx(1.96 * 2.0**0.5 * 1e-4, rel=0.1)  # of a difference of two jittered stamps
    assert found.noise == pytest.approx(0.01, rel=0.05)
    assert found.flaws() == []


def test_samples_that_come_twice_change_no_noise() -> None:
    times, values = (np.repeat(each, 2) for each in motion())
    for cuts in ((), (1, 2, 501, 2000)):
        found = gauged(times, values, cuts=cuts)
        assert found.repeats == COUNT
        assert found.noise == gauged(*motion()).noise


def test_each_flaw_is_counted_and_named() -> None:
    times, values = motion()
    kept = np.delete(np.arange(COUNT), [100, 101, 900])
    times, values = times[kept], values[kept].copy()
    times[50] = times[49]
    times[60] = times[58] - 0.001
    values[[10, 20, 30]] = np.nan
    values[2000:2100] = np.nanmax(values) + 1.0
    found = gauged(times, values)
    assert (found.gaps, found.repeats, found.back, found.nan) == (2 + 1 + 1, 1, 1, 3)  # after a step back, a longer one
    assert found.saturated == pytest.approx(100 / len(times))
    named = "; ".join(found.flaws())
    assert all(word in named for word in ("3 NaN", "go back 1", "1 repeated", "gaps", "end of the range"))


def test_a_sample_without_a_stamp_counts_as_nan_and_hides_no_gap() -> None:
    times, values = (each.copy() for each in motion())
    times[[10, 700]] = np.nan
    values[[10, 20]] = np.nan
    whole, cut = gauged(times, values), gauged(times, values, cuts=(9, 10, 11, 700))
    assert (whole.samples, whole.nan, whole.gaps) == (cut.samples, cut.nan, cut.gaps) == (COUNT, 3, 2)
    times[[0, -1]] = np.nan
    assert gauged(times, values, cuts=(1,)).span_s == pytest.approx((COUNT - 3) / RATE_HZ)


@pytest.mark.parametrize("rows", [4096, 65_536, 400_000])
def test_every_gap_counts_however_many_there_are(rows: int) -> None:
    kept = np.random.default_rng(5).random(400_000) > 0.2
    times = np.flatnonzero(kept) / RATE_HZ
    found = gauged(times, np.sin(times), cuts=tuple(range(rows, len(times), rows)))
    assert found.gaps == np.count_nonzero(np.diff(times) > 1.5 / RATE_HZ) > 60_000


@pytest.mark.parametrize("quantum", [0.05, 0.0439453125, 1e-3])
def test_the_quantum_is_found(quantum: float) -> None:
    times, values = motion()
    assert gauged(times, np.round(values / quantum) * quantum).quantum == pytest.approx(quantum, rel=1e-6)
    assert gauged(times, values).quantum == 0.0


def test_an_even_motion_sampled_evenly_has_no_quantum_to_be_seen() -> None:
    times, _ = motion()
    assert gauged(times, 4.5 * np.arange(COUNT)).quantum == 0.0


def test_drift_of_the_log_clock_is_found() -> None:
    times, values = motion()
    delays = 5e-4 * times + 1e-6 * np.random.default_rng(1).standard_normal(COUNT)
    found = gauged(times, values, delays, cuts=(1000, 3000))
    assert found.drift == pytest.approx(5e-4, rel=0.01)
    assert "drifts 500 ppm" in found.flaws()[0]


def test_delays_that_scatter_are_no_drift() -> None:
    times, values = (each[:300] for each in motion())
    delays = np.random.default_rng(2).uniform(-5e-3, 5e-3, 300)
    delays[[0, -1]] = -5e-3, 5e-3  # 10 ms later at the end, by chance
    for cuts in ((), (1, 120)):
        assert gauged(times, values, delays, cuts=cuts).drift == 0.0
        assert gauged(times, values, delays + 5e-3 * times, cuts=cuts).drift == pytest.approx(5e-3, rel=0.2)


def test_few_samples_and_a_constant_are_named() -> None:
    assert "3 samples" in gauged(np.arange(3.0), np.arange(3.0)).flaws()[0]
    assert gauged(np.arange(20.0), np.full(20, 4.5)).flaws() == ["constant at 4.5"]


def test_a_sample_at_an_end_of_the_range_counts_once() -> None:
    values = np.repeat([0.0, 1.0], 100)
    assert gauged(np.arange(200.0), values, cuts=(100,)).saturated == 1.0


@settings(max_examples=30)
@given(st.lists(st.integers(1, COUNT - 1), max_size=6))
def test_quality_does_not_depend_on_the_blocks(cuts: list[int]) -> None:
    times, values = motion()
    values = np.round(values, 2)
    whole, cut = gauged(times, values), gauged(times, values, cuts=tuple(cuts))
    assert cut._replace(saturated=0.0, noise=0.0) == whole._replace(saturated=0.0, noise=0.0)
    assert cut.noise == pytest.approx(whole.noise, rel=0.1)


def test_memory_does_not_grow_with_the_samples() -> None:
    gauge = QualityGauge()
    for part in range(40):
        times = (np.arange(10_000) + 10_000.0 * part) * 1e-3
        gauge.add(Block(0, times, np.sin(times), NO_DELAYS))
    kept = [thinned.values() for thinned in (gauge._intervals, gauge._bends, gauge._kept)]
    assert all(KEPT // 2 <= len(values) <= KEPT for values in kept)
    assert gauge.quality().rate_hz == pytest.approx(1000.0)
    assert gauge.quality().samples == 400_000
