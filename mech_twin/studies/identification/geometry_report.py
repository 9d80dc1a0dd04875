# SPDX-License-Identifier: Apache-2.0
"""What a fit of lengths comes to: verdict and interval for each key, and a score on a run that it never saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.geometry_fit import (
    GeometryData,
    GeometryFit,
    GeometryProblem,
    fit_percent,
    half_width,
    jackknife,
    own_errors,
    unseen,
)
from mech_twin.studies.identification.geometry_model import GeometryModel
from mech_twin.studies.identification.verdicts import (
    COMBINATION,
    IDENTIFIED,
    MODEL_ERROR,
    NOT_EXCITED,
    WIDEST,
    KeyVerdict,
)

COMBINED = 0.1  # share of a key in directions that are not seen
LEAST_FIT_PERCENT = 90.0  # of a channel: less, and the mechanism is another one


@dataclass(frozen=True)
class HeldOut:
    """Fit (percent) of each channel in the run that was left out: estimated keys, configured keys, a constant."""

    channel: str
    fit_percent: float
    before_percent: float
    constant_percent: float = 0.0


@dataclass(frozen=True)
class GeometryReport:
    """Keys, fits of the channels over the fitted runs, and the score on the run held out."""

    keys: tuple[KeyVerdict, ...]
    fit_percent: dict[str, float]
    lags_s: tuple[float, ...]
    held_out: tuple[HeldOut, ...]

    @property
    def better(self) -> bool:
        """Whether every channel of the run held out fits better than before, and than a constant."""
        return all(each.fit_percent > max(each.before_percent, each.constant_percent) for each in self.held_out)


def geometry_report(
    model: GeometryModel, runs: Sequence[GeometryData], held_out: GeometryData | None
) -> GeometryReport:
    """Return the fit over the runs, its intervals, and its score on a run that the fit never saw.

    On the run held out only what belongs to a run (zero of the crank, zeros of the channels, lags) is fitted, with the
    keys estimated and with those configured.
    """
    problem = GeometryProblem(model, runs)
    fit = problem.solved()
    count = len(model.keys)
    errors = own_errors(fit, count, problem.key_scale())
    left_out = jackknife(model, runs, fit)
    errors = errors if left_out is None else np.maximum(errors, left_out)
    names = [channel.name for channel in runs[0].channels]
    fits = {name: min(fit_percent(fit, run, i) for run in range(len(runs))) for i, name in enumerate(names)}
    return GeometryReport(
        _keys(model, fit, errors, half_width(errors, len(runs)), min(fits.values())),
        fits,
        tuple(fit.lags_s.tolist()),
        () if held_out is None else _scores(model, held_out, fit.keys, names),
    )


def _keys(
    model: GeometryModel, fit: GeometryFit, errors: Array, widths: Array, worst_fit: float
) -> tuple[KeyVerdict, ...]:
    shares, found = unseen(fit, len(model.keys)), []
    for i, (key, before) in enumerate(zip(model.keys, model.values().tolist(), strict=True)):
        verdict, reason = IDENTIFIED, "the channels see it"
        if not np.any(fit.jacobian[:, i]):
            verdict, reason = NOT_EXCITED, "no channel depends on it"
        elif shares[i] > COMBINED:
            partners = ", ".join(k for j, k in enumerate(model.keys) if j != i and shares[j] > COMBINED)
            verdict, reason = COMBINATION, f"the channels see it only together with {partners or 'the zeros and lags'}"
        elif worst_fit < LEAST_FIT_PERCENT:
            verdict, reason = MODEL_ERROR, f"a channel fits to {worst_fit:.1f} % only: another assembly or mechanism?"
        value, width = float(fit.keys[i]), float(widths[i])
        if verdict == IDENTIFIED and width > WIDEST * abs(value):
            verdict, reason = NOT_EXCITED, "the channels leave it open by more than half of itself on either side"
        found.append(KeyVerdict(key, before, value, float(errors[i]), value - width, value + width, verdict, reason))
    return tuple(found)


def _scores(model: GeometryModel, held_out: GeometryData, keys: Array, names: Sequence[str]) -> tuple[HeldOut, ...]:
    after, before = (GeometryProblem(model, [held_out], values).solved() for values in (keys, model.values()))
    return tuple(HeldOut(name, fit_percent(after, 0, i), fit_percent(before, 0, i)) for i, name in enumerate(names))
