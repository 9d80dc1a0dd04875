# SPDX-License-Identifier: Apache-2.0
"""Result of a fit of lengths: verdict and interval of each key, and the score on a held-out run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.geometry_fit import (
    GeometryData,
    GeometryFit,
    GeometryModel,
    GeometryProblem,
    assemblies,
    fit_percent,
    half_width,
    jackknife,
    moving,
    own_errors,
    unseen,
    weighted,
)
from mech_twin.studies.identification.held_out import BY_CHANCE, ljung_box
from mech_twin.studies.identification.keyed_configuration import declared_bounds
from mech_twin.studies.identification.verdicts import (
    COMBINATION,
    IDENTIFIED,
    MODEL_ERROR,
    NOT_EXCITED,
    WIDEST,
    KeyVerdict,
)

CLEARLY = 1.02  # times the least residual: within it, the configured assembly is preferred
TINY = 1e-300
COMBINED = 0.1  # share of a key in unobservable directions
LEAST_FIT_PERCENT = 90.0  # of a channel: with less, the mechanism is probably different


@dataclass(frozen=True)
class HeldOut:
    """Fit (percent) of a channel in the held-out run: with estimated keys, with configured keys, and a constant."""

    channel: str
    fit_percent: float
    before_percent: float
    constant_percent: float = 0.0


@dataclass(frozen=True)
class FittedAssembly:
    """Assembly mode of the mechanism and sense of rotation that fit the measured positions.

    Attributes
    ----------
    configured : dict of str to str
        Configuration keys that differ from before, with their new words.
    sense : int
        -1 if the crank turns opposite to the sign of its channel in the map.
    margin, sense_margin : float
        Residual (rms) of the best other assembly, and of the other sense, over the least; infinite without another.
    """

    configured: dict[str, str]
    sense: int
    margin: float
    sense_margin: float


@dataclass(frozen=True)
class GeometryReport:
    """Keys, fits of the channels over the fitted runs, and scores on the held-out run."""

    keys: tuple[KeyVerdict, ...]
    fit_percent: dict[str, float]
    lags_s: tuple[float, ...]
    held_out: tuple[HeldOut, ...]
    assembly: FittedAssembly

    @property
    def better(self) -> bool:
        """Whether a key is identified, and every held-out channel fits better than before and than a constant."""
        ahead = (each.fit_percent > max(each.before_percent, each.constant_percent) for each in self.held_out)
        return any(key.verdict == IDENTIFIED for key in self.keys) and all(ahead)


def fitted_assembly(
    model: GeometryModel, runs: Sequence[GeometryData], fixed: Sequence[str] = ()
) -> tuple[FittedAssembly, GeometryModel]:
    """Return the assembly mode and sense of rotation that fit best; the configured ones unless clearly worse.

    ``fixed`` are keys that stay as configured.
    """
    tried = [
        (GeometryProblem(each, [run.turning(sense) for run in runs]).solved().cost, words, sense, each)
        for words, each in assemblies(model, fixed)
        for sense in (1, -1)
    ]
    least = min(cost for cost, *_ in tried)
    chosen, words, sense, best = next(each for each in tried if each[0] <= CLEARLY**2 * least)
    others = min((cost for cost, *_, each in tried if each is not best), default=np.inf)
    turned = next(cost for cost, _, other, each in tried if each is best and other != sense)
    margins = np.sqrt(np.array([others, turned]) / max(chosen, TINY)).tolist()
    return FittedAssembly(words, sense, *margins), best


def geometry_report(
    model: GeometryModel, runs: Sequence[GeometryData], held_out: GeometryData | None, fixed: Sequence[str] = ()
) -> tuple[GeometryReport, GeometryModel]:
    """Return the fit over the runs with intervals and the score on a held-out run; and the fitted model.

    A key that moves no position stays as configured.  On the held-out run, only the parameters of a run (zero of the
    crank, zeros of the channels, lags) are fitted, once with the estimated and once with the configured keys.
    ``fixed`` as in `fitted_assembly`.
    """
    asked, configured = model, moving(model)
    assembly, model = fitted_assembly(configured, runs, fixed)
    runs = [run.turning(assembly.sense) for run in runs]
    problem = GeometryProblem(model, runs)
    fit = weighted(model, runs, problem.solved())
    errors = own_errors(fit, len(model.keys), problem.key_scale())
    left_out = jackknife(model, runs, fit)
    errors = errors if left_out is None else np.maximum(errors, left_out)
    names = [channel.name for channel in runs[0].channels]
    fits = {name: min(fit_percent(fit, run, i) for run in range(len(runs))) for i, name in enumerate(names)}
    report = GeometryReport(
        _keys(asked, model, fit, errors, half_width(errors, len(runs))),
        fits,
        tuple(fit.lags_s.tolist()),
        () if held_out is None else _scores((model, configured), held_out, assembly.sense, fit.keys, names),
        assembly,
    )
    return report, replace(model, keys=asked.keys)


def _keys(
    asked: GeometryModel, model: GeometryModel, fit: GeometryFit, errors: Array, widths: Array
) -> tuple[KeyVerdict, ...]:
    """Return the verdict on each key that was asked for; the model holds those that move a position."""
    shares, off, found = unseen(fit, len(model.keys)), _misfit(fit), []
    for key, before in zip(asked.keys, asked.values().tolist(), strict=True):
        low, high = declared_bounds(type(asked.base), key)
        if key not in model.keys:
            found.append(KeyVerdict(key, before, before, np.nan, low, high, NOT_EXCITED, "no channel depends on it"))
            continue
        i = model.keys.index(key)
        value, width = float(fit.keys[i]), float(widths[i])
        verdict, reason = IDENTIFIED, "observable, with an interval within half its value"
        if shares[i] > COMBINED:
            partners = ", ".join(k for j, k in enumerate(model.keys) if j != i and shares[j] > COMBINED)
            verdict, reason = COMBINATION, f"its effect equals that of {partners or 'the zeros and lags'}"
        elif off is not None:
            verdict, reason = MODEL_ERROR, f"a channel fits to {off:.1f} % only: another assembly or mechanism?"
        elif width > WIDEST * abs(value):
            verdict, reason = NOT_EXCITED, "its interval is wider than half its value"
        ends = max(value - width, low), min(value + width, high)
        found.append(KeyVerdict(key, before, value, float(errors[i]), *ends, verdict, reason))
    return tuple(found)


def _misfit(fit: GeometryFit) -> float | None:
    """Return the fit (percent) of the channel that fits worst, too badly and not by noise; None without one."""
    every = [(run, i) for run, parts in enumerate(fit.residuals) for i in range(len(parts))]
    off = [
        percent
        for run, i in every
        if (percent := fit_percent(fit, run, i)) < LEAST_FIT_PERCENT and ljung_box(fit.residuals[run][i]) < BY_CHANCE
    ]
    return min(off, default=None)


def _scores(
    models: tuple[GeometryModel, GeometryModel], held_out: GeometryData, sense: int, keys: Array, names: Sequence[str]
) -> tuple[HeldOut, ...]:
    found, configured = models
    after = GeometryProblem(found, [held_out.turning(sense)], keys).solved()
    before = GeometryProblem(configured, [held_out], configured.values()).solved()
    return tuple(HeldOut(name, fit_percent(after, 0, i), fit_percent(before, 0, i)) for i, name in enumerate(names))
