# SPDX-License-Identifier: Apache-2.0
"""Lengths of a mechanism from measured positions: least squares over several runs, with intervals between runs.

The measured crank angle q drives the model x; every other measured position y is compared with it at its own stamps::

    y(t) = x(q(t - lag) - crank_zero; keys) + zero

Both assemblies and both senses of the crank are tried.  Keys are shared by all runs.  The zero of the crank is
estimated for each run (``per_run``) or for all together (``free``), and so are the zeros of the channels.  Each channel
counts by its own residuals: without that, a key that one channel tells would have the interval of the others.  Errors
within one run are correlated.  So the interval is that of the jackknife over runs (Student's t with runs - 1 degrees of
freedom), where it is wider than that of least squares.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, get_args

import numpy as np
from scipy import stats
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from mech_twin.declarations.configuration_tree import ConfigurationError, merged_tree, tree_from_flat
from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.crank_motion import smoothed
from mech_twin.measurements.measurement_map import FREE, PER_RUN
from mech_twin.measurements.model_turn import TURNING
from mech_twin.measurements.runs import MeasuredChannel, MeasuredRun
from mech_twin.measurements.units import TURN
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.parameters.written_configuration import leaves
from mech_twin.roles import CrankState, GuidedLinkage
from mech_twin.studies.identification.fit_quality import BY_CHANCE, TINY, ljung_box
from mech_twin.studies.identification.intervals import remembered_noise
from mech_twin.studies.identification.keyed_configuration import (
    KeyedConfiguration,
    declared_bounds,
    declared_field,
    machine_keys,
    unit_at,
)
from mech_twin.studies.identification.verdicts import (
    COMBINATION,
    IDENTIFIED,
    MODEL_ERROR,
    NOT_EXCITED,
    WIDEST,
    KeyVerdict,
)

LENGTHENED = 1e-3  # relative change of a key: enough to move the mechanism
ANGLES = 180  # in a turn, at which the mechanism is solved; interpolated by a periodic cubic spline
STARTS, TRIED_STARTS = 24, 2  # crank zeros that are compared, and number of fits started from the best
COARSE_SAMPLES = 150  # of a channel, while starts are compared
EVALUATIONS = 40  # of a fit: one that needs more creeps along a valley
KEPT = 32  # positions of the last keys: a change of a zero or lag needs no others
REFUSED = 1e3  # residual, in standard deviations, of a rejected configuration
LAG_SCALE_S = 1e-3
UNSEEN = 1e-6  # of the largest singular value: below it a direction is not observable
LOST = 3e-8  # of the same: below it a direction is rounding error
LEAST_NOISE = 1e-6  # of a channel's standard deviation
ROUNDS = 2  # of weighting by the residuals
CLEARLY = 1.02  # times the least residual: within it, the configured assembly is preferred
COMBINED = 0.1  # share of a key in unobservable directions
LEAST_FIT_PERCENT = 90.0  # of a channel: with less, the mechanism is probably different


@dataclass(frozen=True)
class GeometryModel(KeyedConfiguration):
    """A machine whose joint positions are functions of its crank angle, with lengths as free keys."""

    columns: tuple[str, ...] = ()

    def positions(self, values: Sequence[float] | Array) -> Mapping[str, CubicSpline]:
        """Return each column as a periodic spline over the crank angle (rad).

        Raises
        ------
        ConfigurationError
            The values are rejected, or the joint positions are not functions of the crank angle.
        """
        machine = catalogue_entry(self.machine).build(self.parameters(values))
        if not isinstance(machine.linkage, GuidedLinkage):
            raise ConfigurationError(f"{self.machine}: expected a machine whose joints follow from its crank")
        angles = np.linspace(0.0, TURN, ANGLES + 1)
        rows = [machine.linkage.guided(0, 0.0, CrankState(angle, 1.0, 0.0)).position for angle in angles.tolist()]
        places = [machine.linkage.joints.index(column.split(".")[1]) for column in self.columns]
        found = {}
        for column, place in zip(self.columns, places, strict=True):
            curve = np.array([row[place] for row in rows])
            curve[-1] = curve[0]
            found[column] = CubicSpline(angles, curve, bc_type="periodic")
        return found

    def fixed(self, values: Array) -> GeometryModel:
        """Return the machine with these values of the keys, none of them free."""
        return replace(self, base=self.parameters(values), keys=())


def lengths(name: str, base: Parameters, columns: tuple[str, ...]) -> tuple[str, ...]:
    """Return the keys in metres that the positions in ``columns`` depend on."""
    metres = tuple(key for key in machine_keys(name, base) if unit_at(type(base), key) == "m")
    return moving(GeometryModel(name, base, metres, columns=columns)).keys


def moving(model: GeometryModel) -> GeometryModel:
    """Return the model with only those of its free keys that move a position."""
    alone = [replace(model, keys=(key,)) for key in model.keys]
    found = [one.keys[0] for one in alone if _moves(one, one.values() + LENGTHENED * one.scales())]
    return replace(model, keys=tuple(found))


def assemblies(model: GeometryModel, fixed: Sequence[str] = ()) -> Iterator[tuple[dict[str, str], GeometryModel]]:
    """Yield the mechanism as configured, then in its other assembly modes, each with the changed configuration words.

    Parameters
    ----------
    fixed : sequence of str
        Keys that stay as configured.
    """
    yield {}, model
    entry, base = catalogue_entry(model.machine), type(model.base)
    for key, value in leaves(model.tree):
        declared = declared_field(base, key)
        for other in get_args(declared.annotation) if declared is not None and key not in fixed else ():
            if other == value or not isinstance(other, str):
                continue
            tree = merged_tree(model.tree, tree_from_flat({key: other}))
            try:
                mirrored = replace(model, base=validated(entry, tree, key))
                differs = _moves(model, model.values(), mirrored)
            except ConfigurationError:
                continue
            if differs:
                yield {key: other}, mirrored


def _moves(model: GeometryModel, values: Array, other: GeometryModel | None = None) -> bool:
    """Return whether other key values, or another model, change a position."""
    before = model.positions(model.values())
    try:
        after = (other or model).positions(values)
    except ConfigurationError:
        return False
    return any(not np.allclose(before[each].c, after[each].c, rtol=1e-9, atol=1e-12) for each in model.columns)


@dataclass(frozen=True)
class GeometryData:
    """One run prepared for the fit: crank angle as a function of time, and the other positions."""

    crank: CubicSpline
    first_s: float
    last_s: float
    crank_zero: str | float
    channels: tuple[MeasuredChannel, ...]

    def turning(self, sense: int) -> GeometryData:
        """Return the run with the crank angle multiplied by 1 or -1."""
        return self if sense > 0 else replace(self, crank=CubicSpline(self.crank.x, -self.crank(self.crank.x)))


@dataclass(frozen=True)
class GeometryFit:
    """A fit over several runs: keys, crank zeros (rad), lags (s), residuals over their channel's standard deviation.

    Jacobian and cost are those of the residuals times ``weights`` of their channels, shape (channels,).
    """

    keys: Array
    crank_zeros: Array
    lags_s: Array
    residuals: tuple[tuple[Array, ...], ...]
    jacobian: Array
    cost: float
    weights: Array

    def percent(self, run: int, channel: int) -> float:
        """Return 100 (1 - rms / standard deviation) of a channel in a run; residuals are already in that unit."""
        return 100.0 * (1.0 - float(np.sqrt(np.mean(self.residuals[run][channel] ** 2))))


def geometry_data(run: MeasuredRun, columns: Sequence[str]) -> GeometryData:
    """Return a run prepared for the fit.

    Raises
    ------
    MeasurementError
        The crank, or one of the positions, is not measured.
    """
    crank = next((found for name in TURNING if (found := run.channel(name)) is not None), None)
    if crank is None:
        raise MeasurementError(run.path, "the crank is not measured; expected a channel that is linkage.crank.position")
    channels = tuple(channel for channel in run.channels if channel.name in columns)
    if len(channels) != len(columns):
        raise MeasurementError(run.path, f"expected the channels {', '.join(columns)} in every run")
    angle, _, _ = smoothed(crank.times_s, crank.values)
    spline = CubicSpline(crank.times_s, angle)
    return GeometryData(spline, float(crank.times_s[0]), float(crank.times_s[-1]), crank.channel.zero, channels)


class GeometryProblem:
    """Residuals of a fit over several runs.

    Parameters
    ----------
    weights : ndarray, optional
        Shape (channels,): of residuals over the standard deviation of their channel; 1 if absent.
    """

    def __init__(self, model: GeometryModel, runs: Sequence[GeometryData], weights: Array | None = None) -> None:
        self._model, self._runs = model, tuple(runs)
        self._curves = lru_cache(maxsize=KEPT)(self._positions)
        self._zeros = len(runs) if any(run.crank_zero == PER_RUN for run in runs) else 1
        if not any(isinstance(run.crank_zero, str) for run in runs):
            self._zeros = 0
        channels = runs[0].channels
        self._lag_places = [i for i, channel in enumerate(channels) if isinstance(channel.channel.lag_s, str)]
        self._weights = np.ones(len(channels)) if weights is None else weights
        self._scales = [np.mean([np.std(run.channels[i].values) for run in runs]) for i in range(len(channels))]

    def solved(self, start: Array | None = None) -> GeometryFit:
        """Return the best fit; without a start, the best of several crank zeros."""
        if start is None:
            zeros = np.arange(STARTS) * TURN / STARTS if self._zeros else np.zeros(1)
            firsts = sorted(map(self._first, zeros), key=lambda x: float(np.sum(self._residuals(x, True) ** 2)))
            tried = [self._least_squares(first, coarse=True) for first in firsts[:TRIED_STARTS]]
            start = min(tried, key=lambda each: float(each.cost)).x
        found = self._least_squares(start, coarse=False)
        keys, zeros, lags = self._unpacked(found.x)
        parts = self._parts(found.x, coarse=False)
        return GeometryFit(keys, zeros, lags, parts, found.jac, float(found.cost), self._weights)

    def packed(self, fit: GeometryFit, runs: Sequence[int]) -> Array:
        """Return a fit over all runs as the start vector of a fit over some of them."""
        zeros = fit.crank_zeros[list(runs)] if len(fit.crank_zeros) > 1 else fit.crank_zeros
        return np.concatenate([fit.keys / self.key_scale() - 1.0, zeros[: self._zeros], fit.lags_s / LAG_SCALE_S])

    def key_scale(self) -> Array:
        """Return the scale of each key: its magnitude; for a key of 0, the largest magnitude of all keys."""
        start = np.abs(self._model.values())
        return np.where(start > 0.0, start, max(float(start.max(initial=0.0)), 1e-3))

    def _first(self, zero: float) -> Array:
        keys = self._model.values() / self.key_scale() - 1.0
        return np.concatenate([keys, np.full(self._zeros, zero), np.zeros(len(self._lag_places))])

    def _unpacked(self, x: Array) -> tuple[Array, Array, Array]:
        n = len(self._model.keys)
        return (x[:n] + 1.0) * self.key_scale(), x[n : n + self._zeros], x[n + self._zeros :] * LAG_SCALE_S

    def _least_squares(self, start: Array, *, coarse: bool) -> Any:
        return least_squares(lambda x: self._residuals(x, coarse), start, x_scale="jac", max_nfev=EVALUATIONS)

    def _residuals(self, x: Array, coarse: bool) -> Array:
        found = self._parts(x, coarse=coarse)
        return np.concatenate([part * self._weights[i] for parts in found for i, part in enumerate(parts)])

    def _parts(self, x: Array, *, coarse: bool) -> tuple[tuple[Array, ...], ...]:
        """Return the residuals of each channel in each run over its standard deviation; unknown zeros are removed."""
        keys, zeros, lags = self._unpacked(x)
        curves = self._curves(tuple(keys.tolist()))
        found = []
        for place, run in enumerate(self._runs):
            zero = float(zeros[place if len(zeros) > 1 else 0]) if len(zeros) else 0.0
            parts = []
            for i, channel in enumerate(run.channels):
                lag = float(lags[self._lag_places.index(i)]) if i in self._lag_places else 0.0
                times = channel.times_s - lag
                inside = np.flatnonzero((channel.times_s >= run.first_s) & (channel.times_s <= run.last_s))
                inside = inside[:: max(1, len(inside) // COARSE_SAMPLES)] if coarse else inside
                if curves is None:
                    parts.append(np.full(len(inside), REFUSED))
                    continue
                off = channel.values[inside] - curves[channel.name](run.crank(times[inside]) - zero)
                parts.append((off - off.mean() if channel.channel.zero == PER_RUN else off) / self._scales[i])
            found.append(parts)
        for i, channel in enumerate(self._runs[0].channels):
            if curves is not None and channel.channel.zero == FREE:
                mean = np.concatenate([parts[i] for parts in found]).mean()
                for parts in found:
                    parts[i] = parts[i] - mean
        return tuple(tuple(parts) for parts in found)

    def _positions(self, keys: tuple[float, ...]) -> Mapping[str, CubicSpline] | None:
        """Return the positions, None where the keys are rejected."""
        try:
            return self._model.positions(keys)
        except ConfigurationError:
            return None


def unseen(fit: GeometryFit, keys: int) -> Array:
    """Return, for each key, its share in directions that are not observable (0 to 1)."""
    size = np.linalg.norm(fit.jacobian, axis=0)
    scaled = fit.jacobian / np.where(size > 0.0, size, 1.0)
    _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
    lost = directions[singular < UNSEEN * singular[0]]
    share = np.sqrt(np.sum(lost**2, axis=0)) if len(lost) else np.zeros(len(size))
    return np.where(size > 0.0, share, 1.0)[:keys]


def weighted(model: GeometryModel, runs: Sequence[GeometryData], fit: GeometryFit) -> GeometryFit:
    """Return the fit with each channel weighted by its residuals, from the start of one with equal weights."""
    for _ in range(ROUNDS):
        channels = [np.concatenate([parts[i] for parts in fit.residuals]) for i in range(len(runs[0].channels))]
        weights = 1.0 / np.array([max(float(np.sqrt(np.mean(part**2))), LEAST_NOISE) for part in channels])
        problem = GeometryProblem(model, runs, weights=weights)
        fit = problem.solved(problem.packed(fit, range(len(runs))))
    return fit


def own_errors(fit: GeometryFit, keys: int, scale: Array) -> Array:
    """Return the least-squares standard errors of the keys, the larger of those for white and correlated residuals."""
    parts = [part * fit.weights[i] for parts in fit.residuals for i, part in enumerate(parts)]
    channels = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    residuals, unknowns = np.concatenate(parts), fit.jacobian.shape[1]
    # pinv of J itself: pinv(J^T J) may give negative variances if a direction is hardly observable
    inverse = np.asarray(np.linalg.pinv(fit.jacobian, rcond=LOST), dtype=np.float64)
    white = np.sum(inverse**2, axis=1) * float(residuals @ residuals) / max(len(residuals) - unknowns, 1)
    covariance, samples = remembered_noise(inverse.T, residuals, channels)
    correlated = np.diag(covariance) * samples / max(samples - unknowns, 1.0)
    return np.asarray(np.sqrt(np.maximum(white, correlated)[:keys]) * scale)


def jackknife(model: GeometryModel, runs: Sequence[GeometryData], fit: GeometryFit) -> Array:
    """Return the standard errors of the keys by the jackknife over runs; 0 for fewer than two runs."""
    if len(runs) < 2:
        return np.zeros(len(model.keys))
    found = []
    for out in range(len(runs)):
        kept = [i for i in range(len(runs)) if i != out]
        problem = GeometryProblem(model, [runs[i] for i in kept], weights=fit.weights)
        found.append(problem.solved(problem.packed(fit, kept)).keys)
    keys = np.array(found)
    return np.asarray(np.sqrt((len(runs) - 1) / len(runs) * np.sum((keys - keys.mean(axis=0)) ** 2, axis=0)))


def half_width(error: Array, runs: int) -> Array:
    """Return half the width of the 95 % interval: Student's t with runs - 1; for one run, the normal quantile."""
    share = stats.t.ppf(0.975, runs - 1) if runs > 1 else stats.norm.ppf(0.975)
    return np.asarray(error * share)


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
    errors = np.maximum(own_errors(fit, len(model.keys), problem.key_scale()), jackknife(model, runs, fit))
    names = [channel.name for channel in runs[0].channels]
    fits = {name: min(fit.percent(run, i) for run in range(len(runs))) for i, name in enumerate(names)}
    report = GeometryReport(
        _keys(asked, model, fit, errors, half_width(errors, len(runs))),
        fits,
        tuple(fit.lags_s.tolist()),
        () if held_out is None else _scores((model.fixed(fit.keys), configured), held_out, assembly.sense, names),
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
        if (percent := fit.percent(run, i)) < LEAST_FIT_PERCENT and ljung_box(fit.residuals[run][i]) < BY_CHANCE
    ]
    return min(off, default=None)


def _scores(
    models: tuple[GeometryModel, GeometryModel], held_out: GeometryData, sense: int, names: Sequence[str]
) -> tuple[HeldOut, ...]:
    found, configured = models
    after = GeometryProblem(found, [held_out.turning(sense)]).solved()
    before = GeometryProblem(configured.fixed(configured.values()), [held_out]).solved()
    return tuple(HeldOut(name, after.percent(0, i), before.percent(0, i)) for i, name in enumerate(names))
