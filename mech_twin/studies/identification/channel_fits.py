# SPDX-License-Identifier: Apache-2.0
"""Quality of a fit for each channel: residuals, fitted sensor parameters, and test for errors of the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mech_twin.measurements.measurement_map import fixed
from mech_twin.studies.identification.held_out import ChannelScore, autocorrelations, score
from mech_twin.studies.identification.least_squares_fit import Fitted
from mech_twin.studies.identification.residuals import FitProblem
from mech_twin.studies.identification.unknowns import GAIN, LAG, ZERO

KNOWN_NOISE, SEEN_NOISE = 2.0, 3.0  # times the sensor noise, given or estimated: a larger residual is a model error
LEAST_NOISE = 2e-4  # of a channel's standard deviation: error of interpolation between coupling steps
BURSTS = 1.5  # times the robust spread of the residuals, insensitive to bursts: more is a model error
BY_CHANCE = 1e-3
FARTHEST, TINY = 1e4, 1e-300


@dataclass(frozen=True)
class ChannelFit:
    """Result of a channel over the fitted runs: fit, residual, and sensor parameters (in the channel's own unit).

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


def refutation(fitted: Fitted, *, agreed: bool = True) -> str | None:
    """Return which channel's residual exceeds its sensor noise, and by how much; None if noise explains all.

    The residual must exceed the given or estimated noise by a factor, and be non-white by the Ljung-Box test.
    A filter in a sensor hides noise from the estimate.  If starts have not ``agreed``, the factor for estimated noise
    is smaller, since the fit has probably missed the global minimum.
    """
    problem = fitted.problem
    for place, found in _scored(fitted):
        noise, known = channel_noise(problem, place)
        most = noise * (KNOWN_NOISE if known else SEEN_NOISE if agreed else BURSTS)
        if not known:  # a filter in a sensor hides its noise from differences, but causes no bursts
            most = min(most, BURSTS * max(noise, float(fitted.comparison.sigmas[place])))
        if not np.isfinite(found.rms) or (found.rms > most and found.white_p < BY_CHANCE):
            return (
                f"{found.channel} is off by {found.rms:.3g} in the rms, {100.0 - found.fit_percent:.2g} % of its size, "
                f"and its sensor's noise is {noise:.3g}"
            )
    return None


def noise_misfit(fitted: Fitted) -> float:
    """Return the rms over channels of residual over sensor noise; about 1 if the model is right."""
    shares = [found.rms / channel_noise(fitted.problem, place)[0] for place, found in _scored(fitted)]
    return float(np.sqrt(np.mean(np.minimum(shares, FARTHEST) ** 2))) if shares else fitted.cost


def channel_noise(problem: FitProblem, place: int) -> tuple[float, bool]:
    """Return the noise of a channel (SI), at least the model's interpolation error; and whether it was given."""
    channels = [run.channels[place] for run in problem.runs]
    size = max(float(np.std(channel.values)) for channel in channels)
    noise = max(channel.noise for channel in channels)
    return max(noise, LEAST_NOISE * size, TINY), bool(channels[0].channel.sigma)


def _scored(fitted: Fitted) -> list[tuple[int, ChannelScore]]:
    names = [channel.name for channel in fitted.problem.runs[0].channels]
    return [(names.index(each.channel), each) for each in score(fitted.problem, fitted.x).channels]


def channel_fits(fitted: Fitted) -> list[ChannelFit]:
    """Return the result of each channel over the fitted runs."""
    problem, found = fitted.problem, []
    scores = {each.channel: each for each in score(problem, fitted.x).channels}
    for place, channel in enumerate(problem.runs[0].channels):
        own = scores.get(channel.name)
        unit = channel.channel.si_factor
        sigma = float(fitted.comparison.sigmas[place]) / unit / abs(fixed(channel.channel.gain, 1.0))
        open_numbers: dict[str, dict[str, float]] = {ZERO: {}, GAIN: {}, LAG: {}}
        for i, unknown in enumerate(problem.unknowns.all):
            if unknown.place != place or unknown.kind not in open_numbers:
                continue
            value = float(fitted.x[i]) * unknown.scale
            if unknown.kind == ZERO:
                gain = fixed(channel.channel.gain, 1.0)
                value = channel.channel.sign * value / gain / unit
            elif unknown.kind == GAIN:
                value = 1.0 / value
            run = "all" if len(unknown.runs) > 1 or len(problem.runs) == 1 else str(problem.runs[unknown.runs[0]].path)
            open_numbers[unknown.kind][run] = value
        found.append(
            ChannelFit(
                channel.name,
                np.nan if own is None else own.fit_percent,
                sigma if own is None else own.rms,
                sigma,
                open_numbers[ZERO],
                open_numbers[GAIN],
                open_numbers[LAG],
                *_memory(fitted, place),
            )
        )
    return found


def _memory(fitted: Fitted, place: int) -> tuple[int, tuple[float, ...]]:
    """Return the number of fitted samples of a channel, and the autocorrelation of their residuals."""
    parts = [each[place] for each in fitted.problem.parts(fitted.x)]
    masks = [each[place] for each in fitted.comparison.masks]
    runs = [autocorrelations(off[mask & np.isfinite(off)]) for off, mask in zip(parts, masks, strict=True)]
    lags = min((len(each) for each in runs if len(each)), default=0)
    mean = np.mean([each[:lags] for each in runs if len(each)], axis=0).tolist() if lags else []
    return int(sum(mask.sum() for mask in masks)), tuple(mean)
