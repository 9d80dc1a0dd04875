# SPDX-License-Identifier: Apache-2.0
"""A fit and its quality for each channel, on data that was fitted and data that was not.

It has the residuals and their whiteness, fitted sensor parameters, match of events, and a test for errors of the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import stats

from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import fixed
from mech_twin.measurements.units import TURN, unit_of
from mech_twin.studies.identification.fit_problem import GAIN, LAG, ZERO, FitProblem, Weighting
from mech_twin.studies.identification.fit_runs import FitChannel, FitRun, first_of_series, matched, usual_spacing

LAGS = 20  # of the whiteness test
KNOWN_NOISE, SEEN_NOISE = 2.0, 3.0  # times the sensor noise, given or estimated: a larger residual is a model error
LEAST_NOISE = 2e-4  # of a channel's standard deviation: error of interpolation between coupling steps
LEAST_SIGMA = 1e-6  # the same, for the weighting
BURSTS = 1.5  # times the robust spread of the residuals, insensitive to bursts: more is a model error
BY_CHANCE = 1e-3
FARTHEST, TINY = 1e4, 1e-300
NORMAL_MEDIAN = 0.6745
ROUNDING = 1e-9  # of the largest number in a unit: a channel that moves less stands still


@dataclass(frozen=True)
class Fitted:
    """Unknowns of a problem, in scales, shape (unknowns,), and the weighting of the samples there."""

    problem: FitProblem
    x: Array
    comparison: Weighting

    @property
    def key_values(self) -> Array:
        """Values of the free keys."""
        return self.problem.unknowns.keys(self.x)

    @cached_property
    def cost(self) -> float:
        """Mean of the squared residuals, in standard deviations of the weighting."""
        rows = self.problem.residuals(self.x, self.comparison)
        return float(rows @ rows) / max(len(rows), 1)

    @cached_property
    def parts(self) -> list[list[Array]]:
        """Residuals of all samples of each channel in each run, in SI units."""
        return self.problem.parts(self.x)

    def off(self, place: int) -> list[Array]:
        """Return the residuals of the samples of a channel that count, one array for each run."""
        return [own[place][mask[place]] for own, mask in zip(self.parts, self.comparison.masks, strict=True)]

    def over(self, runs: Sequence[FitRun]) -> Fitted:
        """Return the same unknowns on other parts of the runs, or on others."""
        return unweighted(self.problem.over(runs), self.x)


def unweighted(problem: FitProblem, x: Array) -> Fitted:
    """Return unknowns with the least standard deviation of each channel."""
    return Fitted(problem, x, problem.comparison(x, noise_floors(problem.runs)))


def weighted(problem: FitProblem, x: Array) -> Fitted:
    """Return unknowns with the robust standard deviation of each channel's residuals, at least a third of their rms."""
    found = unweighted(problem, x)
    spreads = [_spread(np.concatenate(found.off(place))) for place in range(len(problem.runs[0].channels))]
    return Fitted(problem, x, Weighting(np.maximum(found.comparison.sigmas, spreads), found.comparison.masks))


def _spread(off: Array) -> float:
    off = off[np.isfinite(off)]
    if not len(off):
        return 0.0
    return max(float(np.median(np.abs(off))) / NORMAL_MEDIAN, float(np.sqrt(np.mean(off**2))) / 3.0)


def noise_floors(runs: Sequence[FitRun]) -> Array:
    """Return the least standard deviation of each channel over all runs: given noise, or a small share of its own."""
    found = []
    for place in range(len(runs[0].channels)):
        channels = [run.channels[place] for run in runs]
        size = max((float(np.std(each.values)) for each in channels), default=0.0) or 1.0
        known = [each.channel.sigma is not None and each.channel.sigma > 0.0 for each in channels]
        noise = min(each.noise for each in channels) if all(known) else 0.0
        found.append(max(noise, LEAST_SIGMA * size))
    return np.array(found)


@dataclass(frozen=True)
class ChannelScore:
    """Score of one channel.

    Attributes
    ----------
    fit_percent : float
        100 (1 - rms of the residual over the standard deviation of the channel); NaN if that is 0.
    rms : float
        Rms of the residual, SI units.
    white_p : float
        p-value of the Ljung-Box test: probability of at least this autocorrelation in white residuals.
    """

    channel: str
    fit_percent: float
    rms: float
    white_p: float


@dataclass(frozen=True)
class Score:
    """Score of a configuration on runs.

    Attributes
    ----------
    channels : tuple of ChannelScore
        Scores of the sampled channels.
    event_time_rms_s : float or None
        Rms time error of the matched events; None without a channel of event times.
    missed, false : int
        Model events without a measured match, and measured events without a model match.
    """

    channels: tuple[ChannelScore, ...]
    event_time_rms_s: float | None
    missed: int
    false: int

    @property
    def misfit(self) -> float:
        """Mean over the channels that vary of the residual's rms, each relative to its standard deviation."""
        shares = [1.0 - each.fit_percent / 100.0 for each in self.channels if not np.isnan(each.fit_percent)]
        return float(np.mean(shares)) if shares else np.inf


def score(fitted: Fitted) -> Score:
    """Return the score of fitted unknowns on the runs of their problem."""
    return Score(tuple(_sampled(fitted).values()), *_events(fitted))


def _sampled(fitted: Fitted) -> dict[int, ChannelScore]:
    """Return the score of each sampled channel by its place."""
    runs, found = fitted.problem.runs, dict[int, ChannelScore]()
    for place, (channel, label) in enumerate(zip(runs[0].channels, _labels(runs), strict=True)):
        off = fitted.off(place)
        whole = np.nan_to_num(np.concatenate(off), nan=np.inf)
        if channel.of_events or not len(whole):
            continue
        masks = (mask[place] for mask in fitted.comparison.masks)
        values = [run.channels[place].values[mask] for run, mask in zip(runs, masks, strict=True)]
        centred = np.concatenate([each - each.mean() for each in values if len(each)])
        size, rms = float(np.sqrt(np.mean(centred**2))), float(np.sqrt(np.mean(whole**2)))
        fit = 100.0 * (1.0 - rms / size) if size > rounding_of(runs, channel) else np.nan
        found[place] = ChannelScore(label, fit, rms, min(map(ljung_box, off)))
    return found


def _labels(runs: Sequence[FitRun]) -> list[str]:
    """Return a name for each channel: its quantity, with its source where several sensors have the same."""
    names = [channel.name for channel in runs[0].channels]
    pairs = zip(runs[0].channels, names, strict=True)
    return [name if names.count(name) == 1 else f"{name} ({each.channel.source.label})" for each, name in pairs]


def _events(fitted: Fitted) -> tuple[float | None, int, int]:
    """Return the rms time error of matched events (s), and the numbers of unmatched model and measured events."""
    problem, off = fitted.problem, list[float]()
    missed = false = 0
    any_times = False
    curves = problem.model.at(fitted.key_values)
    for i, run in enumerate(problem.runs):
        for channel in run.channels:
            if not channel.of_instants or curves is None:
                continue
            any_times = True
            begin = problem.begin(fitted.x, i)
            first, last = max(run.from_s, run.first_s), run.end_s
            spacing = usual_spacing(channel.times_s)
            own = channel.values[first_of_series(channel.times_s, spacing)]
            own = own[(own >= first) & (own <= last)]
            model = curves[i].of_events(channel.kind, "time") - begin
            model = model[first_of_series(model, spacing)]
            model = model[(model >= first) & (model <= last)]
            places = matched(own, model)
            off += (own[places >= 0] - model[places[places >= 0]]).tolist()
            false += int(np.count_nonzero(places < 0))
            missed += len(model) - int(np.count_nonzero(places >= 0))
    return (float(np.sqrt(np.mean(np.square(off)))) if off else None if not any_times else np.nan), missed, false


def autocorrelations(residual: Array) -> Array:
    """Return the autocorrelation of a residual about 0 at lags from 1 on; empty for too few samples.

    Noise has no mean: one that is left is an offset, and correlates like any other error of the model.
    """
    power, lags = float(residual @ residual), min(LAGS, len(residual) // 4)
    if lags < 1 or not np.isfinite(power) or power == 0.0:
        return np.zeros(0)
    return np.array([float(residual[lag:] @ residual[:-lag]) / power for lag in range(1, lags + 1)])


def ljung_box(residual: Array) -> float:
    """Return the p-value of the Ljung-Box test of whiteness; 0 without a usable autocorrelation."""
    n, correlations = len(residual), autocorrelations(residual)
    lags = len(correlations)
    if not lags:
        return 0.0
    statistic = n * (n + 2.0) * float(np.sum(correlations**2 / (n - np.arange(1, lags + 1))))
    return float(stats.chi2.sf(statistic, lags))


@dataclass(frozen=True)
class ChannelFit:
    """Result of a channel over the fitted runs: fit, residual (SI), and sensor parameters (the channel's own unit).

    ``autocorrelation`` is that of the residuals from lag 1 on, the mean over the runs.  For white residuals, 95 % of
    the values lie within 1.96 / sqrt(``samples``).
    """

    channel: str
    fit_percent: float
    rms: float
    sigma: float
    zero: dict[str, float]
    gain: dict[str, float]
    lag_s: dict[str, float]
    samples: int
    autocorrelation: tuple[float, ...]


def rounding_of(runs: Sequence[FitRun], channel: FitChannel) -> float:
    """Return the rounding error of a channel, a small share of the largest number in its unit (SI)."""
    unit = unit_of(channel.name)
    every = [each for run in runs for each in run.channels if not each.of_events]
    return ROUNDING * max(float(np.abs(each.values).max()) for each in every if unit_of(each.name) == unit)


def stands_still(runs: Sequence[FitRun], place: int) -> bool:
    """Return whether a sampled channel has a single value in each run: it has no size and no noise to judge it by."""
    own = [run.channels[place] for run in runs]
    return not own[0].of_events and max(float(np.ptp(each.values)) for each in own) <= rounding_of(runs, own[0])


def _stuck(fitted: Fitted) -> str | None:
    """Return which channel stands still although it moves in the model; None without one."""
    runs = fitted.problem.runs
    for place, channel in enumerate(runs[0].channels):
        if not stands_still(runs, place):
            continue
        moves = max((float(np.std(each)) for each in fitted.off(place) if len(each)), default=0.0)
        least = max(KNOWN_NOISE * channel_noise(runs, place)[0], rounding_of(runs, channel))
        if not moves <= least:
            return (
                f"{channel.name} stands still at {channel.values[0]:.6g}, the model's moves by {moves:.3g} in the rms"
            )
    return None


def refutation(fitted: Fitted, *, agreed: bool = True) -> str | None:
    """Return which channel's residual exceeds its sensor noise, and by how much; None if noise explains all.

    The residual must exceed the given or estimated noise by a factor, and be non-white by the Ljung-Box test.
    A filter in a sensor hides noise from the estimate.  If starts have not ``agreed``, the factor for estimated noise
    is smaller, since the fit has probably missed the global minimum.  A channel that stands still refutes only a model
    in which it moves.
    """
    stuck = _stuck(fitted)
    if stuck is not None:
        return stuck
    for place, found in _judged(fitted).items():
        noise, known = channel_noise(fitted.problem.runs, place)
        most = noise * (KNOWN_NOISE if known else SEEN_NOISE if agreed else BURSTS)
        if not known:  # a filter in a sensor hides its noise from differences, but causes no bursts
            most = min(most, BURSTS * max(noise, float(fitted.comparison.sigmas[place])))
        if not np.isfinite(found.rms) or (found.rms > most and found.white_p < BY_CHANCE):
            part = "" if np.isnan(found.fit_percent) else f", {100.0 - found.fit_percent:.2g} % of its size"
            off = f"{found.channel} is off by {found.rms:.3g} in the rms{part}"
            return f"{off}; expected at most {most:.3g} by its noise"
    return None


def _size(channel: FitChannel) -> float:
    """Return the size of a channel within a cycle (SI), that does not grow with the run: a turn of an angle at most."""
    if channel.of_instants:
        return usual_spacing(channel.times_s) if len(channel.times_s) > 1 else 0.0
    return min(float(np.std(channel.values)), TURN if channel.turns else np.inf)


def noise_misfit(fitted: Fitted) -> float:
    """Return the rms over channels of residual over sensor noise; about 1 if the model is right."""
    runs = fitted.problem.runs
    shares = [found.rms / channel_noise(runs, place)[0] for place, found in _judged(fitted).items()]
    return float(np.sqrt(np.mean(np.minimum(shares, FARTHEST) ** 2))) if shares else fitted.cost


def channel_noise(runs: Sequence[FitRun], place: int) -> tuple[float, bool]:
    """Return the noise of a channel (SI), at least the model's interpolation error; and whether it was given."""
    channels = [run.channels[place] for run in runs]
    noise = max(channel.noise for channel in channels)
    return max(noise, LEAST_NOISE * max(map(_size, channels)), TINY), bool(channels[0].channel.sigma)


def _judged(fitted: Fitted) -> dict[int, ChannelScore]:
    """Return the score, by its place, of each channel that does not stand still, and of events with a given noise.

    Events are too few for a test of whiteness: in its place stands the chance of so large a residual by that noise.
    """
    runs, found = fitted.problem.runs, _sampled(fitted)
    found = {place: each for place, each in found.items() if not stands_still(runs, place)}
    for place, (channel, label) in enumerate(zip(runs[0].channels, _labels(runs), strict=True)):
        rms, count = _event_rms(fitted, place)
        if channel.of_events and channel.channel.sigma and count:
            chance = float(stats.chi2.sf(count * (rms / channel_noise(runs, place)[0]) ** 2, count))
            found[place] = ChannelScore(label, np.nan, rms, chance)
    return found


def _event_rms(fitted: Fitted, place: int) -> tuple[float, int]:
    """Return the rms residual of a channel of events (SI units), infinite with a missed one, and their number."""
    off = np.concatenate(fitted.off(place))
    return float(np.sqrt(np.mean(np.nan_to_num(off, nan=np.inf) ** 2))) if len(off) else np.nan, len(off)


def channel_fits(fitted: Fitted) -> list[ChannelFit]:
    """Return the result of each channel over the fitted runs."""
    problem, scores, found = fitted.problem, _sampled(fitted), list[ChannelFit]()
    for place, (channel, label) in enumerate(zip(problem.runs[0].channels, _labels(problem.runs), strict=True)):
        own = scores.get(place) or ChannelScore(label, np.nan, _event_rms(fitted, place)[0], np.nan)
        sigma = float(fitted.comparison.sigmas[place]) / channel.channel.si_factor
        open_numbers: dict[str, dict[str, float]] = {ZERO: {}, GAIN: {}, LAG: {}}
        for i, unknown in enumerate(problem.unknowns.all):
            if unknown.place == place and unknown.kind in open_numbers:
                together = len(unknown.runs) > 1 or len(problem.runs) == 1
                run = "all" if together else str(problem.runs[unknown.runs[0]].path)
                value = in_map(unknown.kind, float(fitted.x[i]) * unknown.scale, channel)
                open_numbers[unknown.kind][run] = value
        sigma /= abs(fixed(channel.channel.gain, 1.0))
        zero, gain, lag = open_numbers.values()
        memory = _memory(fitted.off(place))
        found.append(ChannelFit(label, own.fit_percent, own.rms, sigma, zero, gain, lag, *memory))
    return found


def in_map(kind: str, value: float, channel: FitChannel) -> float:
    """Return a fitted zero, gain or lag (SI) as the map writes it, a zero in the channel's unit."""
    if kind == ZERO:
        return channel.channel.sign * value / fixed(channel.channel.gain, 1.0) / channel.channel.si_factor
    return 1.0 / value if kind == GAIN else value


def _memory(off: Sequence[Array]) -> tuple[int, tuple[float, ...]]:
    """Return the number of fitted samples of a channel, and the autocorrelation of their residuals in each run."""
    runs = [each for own in off if len(each := autocorrelations(own[np.isfinite(own)]))]
    lags = min(map(len, runs), default=0)
    mean = np.mean([each[:lags] for each in runs], axis=0).tolist() if lags else []
    return sum(map(len, off)), tuple(mean)
