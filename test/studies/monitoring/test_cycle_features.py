# SPDX-License-Identifier: Apache-2.0
"""Features of a cycle: laws of each number, and one answer however the samples come."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from mech_twin.capabilities.cycle import (
    CycleFeature,
    CycleFeatures,
    CycleReference,
    event_ratio,
    event_share,
    harmonic,
    mean,
    period,
    share_above,
    speed_harmonic,
    swing,
    upper,
)
from mech_twin.errors import StudyError
from mech_twin.studies.monitoring.cycle_features import PATIENCE_S, FeatureFeed, FeatureVector, feed_channels

CRANK, TORQUE, TIME, PRE, POST = "crank", "torque", "event.blow.time", "event.blow.pre", "event.blow.post"
SPEED, RIPPLE_COS, RIPPLE_SIN = 20.0, 0.03, -0.02
FEATURES = (
    period(),
    speed_harmonic("speed_cos", CRANK, 1, "cos", "x"),
    speed_harmonic("speed_sin", CRANK, 1, "sin", "x"),
    mean("mean", "N.m", TORQUE, "x"),
    harmonic("cos_2", "N.m", TORQUE, 2, "cos", "x"),
    harmonic("sin_2", "N.m", TORQUE, 2, "sin", "x"),
    upper("upper", "N.m", TORQUE, "x", 0.01),
    swing("swing", "N.m", TORQUE, "x", 0.01),
    share_above("above", TORQUE, 0.5, "x"),
    event_share("share", TIME, "x"),
    event_ratio("ratio", POST, PRE, "x"),
)
Channels = dict[str, tuple[np.ndarray, np.ndarray]]


def turned(times_s: np.ndarray) -> np.ndarray:
    """Return an angle whose relative speed is 1 + c cos psi + s sin psi, psi = speed * time."""
    psi = SPEED * times_s
    return psi + RIPPLE_COS * np.sin(psi) - RIPPLE_SIN * np.cos(psi) + RIPPLE_SIN


def measured(seed: int, noise: float = 0.0, duration_s: float = 8.0) -> Channels:
    """Return a crank that counts from 0 to a turn, a torque of its angle at a rate of its own, and blows."""
    random = np.random.default_rng(seed)
    crank_s = np.arange(0.0, duration_s, 1e-3) + random.uniform(0.0, 4e-4, round(duration_s * 1000))
    torque_s = np.arange(0.0, duration_s, 7e-4) + random.uniform(0.0, 3e-4, len(np.arange(0.0, duration_s, 7e-4)))
    angle = turned(torque_s)
    torque = 5.0 + 3.0 * np.cos(2.0 * angle) - 2.0 * np.sin(2.0 * angle)
    fine_s = np.arange(0.0, duration_s, 1e-5)
    blows = np.interp(2.0 * pi * (np.arange(int(turned(fine_s[-1:])[0] / (2.0 * pi))) + 0.25), turned(fine_s), fine_s)
    return {
        TIME: (blows, blows),
        PRE: (blows, np.full(len(blows), 2.0)),
        POST: (blows, np.full(len(blows), -0.7)),
        TORQUE: (torque_s, torque + noise * random.standard_normal(len(torque_s))),
        CRANK: (crank_s, np.mod(turned(crank_s) + noise * 1e-3 * random.standard_normal(len(crank_s)), 2.0 * pi)),
    }


def fresh(features: tuple[CycleFeature, ...] = FEATURES, begin: float = 0.0) -> FeatureFeed:
    return FeatureFeed(CycleFeatures(CycleReference(CRANK, "turn", begin), features), (TIME, PRE, POST, TORQUE, CRANK))


def same(one: list[FeatureVector], other: list[FeatureVector]) -> bool:
    return len(one) == len(other) and all(
        a[:4] == b[:4] and np.array_equal(a.values, b.values, equal_nan=True) for a, b in zip(one, other, strict=True)
    )


@pytest.mark.slow
def test_each_feature_is_what_it_says() -> None:
    vectors = feed_channels(fresh(), measured(1))
    assert len(vectors) == int(turned(np.array([7.999]))[0] / (2.0 * pi)) - 1  # the first turn begins before the run
    size = np.hypot(3.0, 2.0)
    expected = {
        "period_s": 2.0 * pi / SPEED, "speed_cos": RIPPLE_COS, "speed_sin": RIPPLE_SIN, "mean": 5.0, "cos_2": 3.0,
        "sin_2": -2.0, "upper": 5.0 + size, "swing": 2.0 * size, "above": 0.5, "share": 0.25, "ratio": 0.35,
    }  # fmt: skip
    for vector in vectors:
        for name, value in zip(vector.names, vector.values, strict=True):
            assert value == pytest.approx(expected[name], abs=6e-3), name
        assert vector.values[0] == pytest.approx(2.0 * pi / SPEED, rel=1e-5)


def test_extremes_and_shares_have_no_steps_where_a_number_of_samples_changes() -> None:
    """A twentieth of thirty samples is one and a half of them; an effect of speed must not jump there."""
    features = (upper("upper", "N.m", TORQUE, "x"), swing("swing", "N.m", TORQUE, "x"))
    features = (*features, share_above("above", TORQUE, 0.5, "x"))
    scatter, means = [], []
    for samples in (28.7, 29.4, 30.6, 31.4):
        times_s = np.arange(0.0, 200.0, 1.0 / samples)
        channels = {CRANK: (times_s, 2.0 * pi * times_s), TORQUE: (times_s, np.cos(2.0 * pi * times_s - 1.0))}
        values = [vector.values for vector in feed_channels(fresh(features), channels)]
        means.append(np.mean(values, axis=0))
        scatter.append(np.std(values, axis=0)[2])
    exact = np.sin(0.05 * pi) / (0.05 * pi)  # the mean of a cosine over its largest twentieth
    np.testing.assert_allclose(means, np.tile([exact, 2.0 * exact, 0.5], (4, 1)), rtol=2e-3)
    np.testing.assert_allclose(np.diff(means, axis=0) / exact, 0.0, atol=5e-4)
    assert max(scatter) < 0.002  # of a share; a thirtieth by whole samples


@pytest.mark.parametrize("begin", [0.0, 1.0, 3.0, -2.0])
def test_a_turn_begins_at_the_declared_angle(begin: float) -> None:
    (first, *_) = feed_channels(fresh((period(), event_share("share", TIME, "x")), begin), measured(2))
    assert np.mod(turned(np.array([first.begin_s]))[0] - begin + pi, 2.0 * pi) == pytest.approx(pi, abs=1e-3)
    assert first.values[1] == pytest.approx(np.mod(0.25 - begin / (2.0 * pi), 1.0), abs=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_the_features_do_not_depend_on_how_the_samples_come(seed: int) -> None:
    channels, random = measured(seed, noise=1.0, duration_s=3.0), np.random.default_rng(seed)
    whole = feed_channels(fresh(), channels)
    feed, found, done = fresh(), [], dict.fromkeys(channels, 0)
    while any(done[column] < len(channels[column][0]) for column in channels):
        ahead = {c: channels[c][0][done[c]] for c in channels if done[c] < len(channels[c][0])}
        # any channel whose next sample is not far ahead of the rest: events at once, as they precede their cycle's end
        column = str(random.choice([c for c, at in ahead.items() if at <= min(ahead.values()) + 0.05]))
        part = slice(done[column], done[column] + int(random.integers(1, 40)))
        found += feed.feed(column, *(values[part] for values in channels[column]))
        done[column] = part.stop
    assert len(whole) > 5 and same(whole, [*found, *feed.finish()])


def test_sample_by_sample_gives_the_same_bits() -> None:
    channels = measured(3, noise=1.0, duration_s=1.5)
    samples = sorted((at, column, value) for column, each in channels.items() for at, value in zip(*each, strict=True))
    feed, found = fresh(), []
    for at, column, value in samples:
        found += feed.feed(column, [at], [value])
    assert same(feed_channels(fresh(), channels), [*found, *feed.finish()])


def turned_wrong(times: np.ndarray, angles: np.ndarray, gain: float) -> np.ndarray:
    """Return an unwrapped angle that is shown with a gain from 1 s to 2 s."""
    angles = np.unwrap(angles)
    return np.where((times >= 1.0) & (times < 2.0), angles * gain, angles)


@pytest.mark.parametrize("gain", [-1.0, 180.0 / pi, -180.0 / pi, 150.0])
@pytest.mark.parametrize("every", [4, 10])
def test_turns_that_are_none_of_the_machine_are_told_in_the_time_of_its_turns(gain: float, every: int) -> None:
    whole = measured(1, duration_s=4.0)
    times, angles = (each[::every] for each in whole[CRANK])
    channels = {**whole, CRANK: (times, turned_wrong(times, angles, gain))}
    found = feed_channels(fresh(), channels)
    told = [vector for vector in found if CRANK in vector.quality and vector.quality[CRANK].wrong_turns]
    assert 2 <= len(told) <= 4 and all(vector.begin_s > 0.6 and vector.end_s < 2.7 for vector in told)
    assert all(np.isnan(vector.values).all() for vector in told)
    assert gain != -1.0 or told[0].quality[CRANK].wrong_turns == -1
    assert sum(np.isfinite(vector.values).all() for vector in found) >= 4  # before and after
    feed, piecewise = fresh(), []
    for column, samples in channels.items():
        piecewise += [] if column == CRANK else feed.feed(column, *samples)
    for at, value in zip(*channels[CRANK], strict=True):
        piecewise += feed.feed(CRANK, [at], [value])
    assert same(found, [*piecewise, *feed.finish()])


@pytest.mark.parametrize("share", [0.55, 0.7, 0.9])
def test_turns_are_not_told_where_samples_are_lost_for_half_a_turn_and_more(share: float) -> None:
    """The shortest way round from one sample to the next is backward there, though the encoder is right."""
    channels = measured(1)
    times, angles = channels[CRANK]
    lost = (times > 3.0) & (times < 5.0)
    lost[:: round(share * 2.0 * pi / SPEED * 1000.0)] = False
    channels[CRANK] = (times[~lost], angles[~lost])
    feed = fresh()
    found = feed_channels(feed, channels)
    assert not any(vector.quality[CRANK].wrong_turns for vector in found)
    assert feed.skipped >= 1
    assert sum(vector.begin_s > 5.0 for vector in found) >= 4


def test_a_silent_channel_is_waited_for_and_then_missing() -> None:
    channels = measured(4)
    torque_s, torque = channels[TORQUE]
    channels[TORQUE] = (torque_s[torque_s < 4.0], torque[torque_s < 4.0])
    feed = fresh()
    for column in (TIME, PRE, POST, TORQUE):
        feed.feed(column, *channels[column])
    crank_s, crank = channels[CRANK]
    found = feed.feed(CRANK, crank_s[crank_s < 4.0 + 0.9 * PATIENCE_S], crank[crank_s < 4.0 + 0.9 * PATIENCE_S])
    assert found[-1].end_s <= 4.0
    found += feed.feed(CRANK, crank_s[crank_s >= 4.0 + 0.9 * PATIENCE_S], crank[crank_s >= 4.0 + 0.9 * PATIENCE_S])
    silent = [bool(np.isnan(vector.values[3])) for vector in found]
    assert [vector.end_s > 4.0 for vector in found] == silent and any(silent)  # half a cycle of samples is no cycle


def test_each_cycle_of_a_standstill_is_left_out_however_many_boundaries_noise_finds_in_it() -> None:
    speed = np.repeat([SPEED, SPEED / 40.0, SPEED], [2000, 30_000, 2000])  # turns that last forty times a usual one
    channels = {CRANK: (1e-3 * np.arange(len(speed)), np.cumsum(1e-3 * speed))}
    feed = FeatureFeed(CycleFeatures(CycleReference(CRANK, "turn", 0.0), FEATURES), [CRANK])
    found = feed_channels(feed, channels)
    assert feed.skipped >= 2
    assert all(vector.end_s - vector.begin_s < 12.0 * pi / SPEED for vector in found)
    assert sum(vector.begin_s > 32.0 for vector in found) >= 4


def test_a_cycle_with_a_gap_in_the_reference_is_left_out_and_counted() -> None:
    channels = measured(5)
    crank_s, crank = channels[CRANK]
    kept = (crank_s < 3.0) | (crank_s > 3.2)
    channels[CRANK] = (crank_s[kept], crank[kept])
    feed = fresh()
    found = feed_channels(feed, channels)
    assert feed.skipped >= 1
    assert not any(vector.begin_s < 3.1 < vector.end_s for vector in found)
    assert all(vector.values[0] == pytest.approx(2.0 * pi / SPEED, rel=1e-3) for vector in found)


@pytest.mark.parametrize("column", [CRANK, TORQUE])
def test_a_gap_of_any_length_is_never_taken_for_a_change(column: str) -> None:
    channels, random = measured(7, duration_s=4.0), np.random.default_rng(7)
    for length_s in np.geomspace(2e-3, 0.5, 12):
        (times, values), begin_s = channels[column], random.uniform(0.5, 3.0)
        kept = (times < begin_s) | (times > begin_s + length_s)
        gapped = feed_channels(fresh(), {**channels, column: (times[kept], values[kept])})
        whole = {round(vector.begin_s, 4): vector.values for vector in feed_channels(fresh(), channels)}
        assert len(gapped) >= len(whole) - 4
        for vector in gapped:
            known = np.isfinite(vector.values)
            expected = whole[min(whole, key=lambda at_s: abs(at_s - vector.begin_s))]
            np.testing.assert_allclose(vector.values[known], expected[known], atol=0.01)


def test_stamps_that_repeat_or_go_back_and_what_is_no_number_change_nothing() -> None:
    channels = measured(6, noise=1.0)
    dirty = dict(channels)
    times, values = channels[TORQUE]
    dirty[TORQUE] = (np.repeat(times, 2), np.column_stack([values, values + 1e3]).ravel())
    dirty[TORQUE][0][5001], dirty[TORQUE][1][7001] = 0.0, np.nan
    assert same(feed_channels(fresh(), channels), feed_channels(fresh(), dirty))


def test_a_signal_that_repeats_is_counted_by_its_rises() -> None:
    times = np.arange(0.0, 2.0, 1e-3)
    square = np.where(np.arange(len(times)) % 50 < 35, 1000.0, -500.0)
    declared = CycleFeatures(CycleReference("force", "rise", 250.0), (period(), mean("mean", "N", "force", "x")))
    vectors = feed_channels(FeatureFeed(declared, ("force",)), {"force": (times, square)})
    assert len(vectors) == 38
    for vector in vectors:
        np.testing.assert_allclose(vector.values, [0.05, 550.0], rtol=0.02)


def test_without_what_cycles_are_counted_by_there_is_one_line() -> None:
    with pytest.raises(StudyError, match="no channel is crank, which cycles are counted by"):
        FeatureFeed(CycleFeatures(CycleReference(CRANK), FEATURES), (TORQUE,))


@pytest.mark.parametrize("far_s", [1e6, 1e15, 1e300])
def test_a_stamp_far_ahead_changes_no_cycle_before_it(far_s: float) -> None:
    channels = measured(3, duration_s=3.0)
    expected = feed_channels(fresh(), channels)
    stamps, angles = channels[CRANK]
    late = {**channels, CRANK: (np.append(stamps, [far_s, 2.0 * far_s]), np.append(angles, [0.0, 1.0]))}
    found = feed_channels(fresh(), late)
    assert same(found[: len(expected) - 1], expected[:-1])
    assert len(found) <= len(expected) + 1
