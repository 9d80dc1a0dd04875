# SPDX-License-Identifier: Apache-2.0
"""How a fit stands beside its channels: residuals, what was found of each sensor, and errors of the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mech_twin.measurements.measurement_map import fixed
from mech_twin.studies.identification.held_out import score
from mech_twin.studies.identification.least_squares_fit import Fitted
from mech_twin.studies.identification.unknowns import GAIN, LAG, ZERO

KNOWN_NOISE, SEEN_NOISE = 2.0, 3.0  # times the noise of a sensor, known or seen: more is an error of the model
MISFIT = 0.01  # of the size of a channel: less does not count, whatever the noise


@dataclass(frozen=True)
class ChannelFit:
    """A channel over the fitted runs: fit, residual, and what was found of it (in the channel's own unit)."""

    channel: str
    fit_percent: float
    rms: float
    sigma: float
    zero: dict[str, float]
    gain: dict[str, float]
    lag_s: dict[str, float]


def model_error(fitted: Fitted, least_misfit: float = MISFIT) -> str | None:
    """Return why the model cannot be that of the runs, None where its residuals are those of the sensors.

    Parameters
    ----------
    fitted : Fitted
        Where a fit ended.
    least_misfit : float
        Share of the size of a channel by which it must be off at least, whatever its noise.
    """
    problem = fitted.problem
    for found in score(problem, fitted.x).channels:
        channels = [c for run in problem.runs for c in run.channels if c.name == found.channel]
        noise = max(channel.noise for channel in channels)
        limit = KNOWN_NOISE if channels[0].channel.sigma else SEEN_NOISE
        misfit = 1.0 - found.fit_percent / 100.0
        if not np.isfinite(found.rms) or (misfit > least_misfit and found.rms > limit * noise and found.white_p < 1e-3):
            return (
                f"{found.channel} is off by {found.rms:.3g} in the rms ({100.0 * misfit:.1f} % of its size), its "
                f"sensor by {noise:.3g}: the model lacks something"
            )
    return None


def channel_fits(fitted: Fitted) -> list[ChannelFit]:
    """Return each channel over the fitted runs."""
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
            )
        )
    return found
