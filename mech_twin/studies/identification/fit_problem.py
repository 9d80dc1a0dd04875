# SPDX-License-Identifier: Apache-2.0
"""The problem of a fit: its unknowns, and residuals with their derivatives for a fixed order of events.

Unknowns are keys, start times of runs, and sensor parameters that the map leaves free.

Samples close to an event of the model are left out.  A measured event is compared with the nearest model event of its
kind, by its time and the velocities before and after.  Residuals are in standard deviations of their channel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import FREE, PER_RUN
from mech_twin.measurements.units import TURN
from mech_twin.studies.identification.fit_runs import (
    SHARE,
    ColumnCurves,
    Curves,
    FitChannel,
    FitRun,
    ModelRuns,
    first_of_series,
    matched,
    usual_spacing,
)
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion

REFUSED = 1e3  # residual, in standard deviations, if the values are rejected or the simulation fails
GUARD_STEPS = 2.5  # coupling steps left out on either side of an event
BEND_GUARD_STEPS = 1.5  # the same for a position, which has a kink there
KEY_STEP = 1e-4  # step of central differences, in scales of a key
STEPS = 3.0  # ratio of the step lengths that are extrapolated to zero
DOUBTED = 2e-5  # of a key's effect: larger differences between two step lengths are examined
HALVED = 8.0  # factor by which a key's step is shortened if many rows have a kink within it
LEAST_BEND = 1e-3  # standard deviations: a smaller kink is rounding error
CURVED = 0.3  # of the sum of the slopes on either side: a larger difference is a change of the order of events
MOST_BENT = 0.2  # largest share of a channel's rows with a kink
LEAST_EFFECT = 2.0  # standard deviations of all rows for a change of a key by its scale: less is no effect
CLOSE = 0.01  # of the scales: derivatives taken no farther away tell the curvature
SMALL = 0.05  # of a key's rms derivative: smaller differences are ignored
BOTH = (1.0, -1.0)  # signs of the steps of central differences
Mask = npt.NDArray[np.bool_]
Members = tuple[Curves | None, Curves, Curves | None]  # simulations of a key stepped up, at the centre, and down
Place = tuple[int, int]  # run and channel
KEY, BEGIN, ZERO, GAIN, LAG = "key", "begin", "zero", "gain", "lag"
TIME_SCALE_S = 1e-3
LONGEST_LAG_S = 0.5


@dataclass(frozen=True)
class Unknown:
    """One unknown number.

    Attributes
    ----------
    kind : str
        ``key``, ``begin`` (start), ``zero`` (SI units, added to column over gain), ``gain`` (its inverse) or ``lag``.
    name : str
        The key, the file of the run, or the column of the channel.
    runs : tuple of int
        Indices of the runs it applies to.
    place : int
        Index of the key among the keys, or of the channel among the channels.
    scale, low, high : float
        Scale of the unknown, and its bounds.
    """

    kind: str
    name: str
    runs: tuple[int, ...]
    place: int
    scale: float
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True)
class Unknowns:
    """All unknowns of a fit, in the order of its vector; a vector holds each divided by its scale."""

    all: tuple[Unknown, ...]
    start: Array

    @property
    def scales(self) -> Array:
        """Scales, shape (unknowns,)."""
        return np.array([each.scale for each in self.all])

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and upper bounds as vectors."""
        scales = self.scales
        return np.array([u.low for u in self.all]) / scales, np.array([u.high for u in self.all]) / scales

    def keys(self, x: Array) -> Array:
        """Return the values of the keys."""
        chosen = self.places(KEY)
        return x[chosen] * self.scales[chosen]

    def places(self, *kinds: str) -> npt.NDArray[np.intp]:
        """Return the indices of the unknowns of these kinds in the vector."""
        return np.array([i for i, each in enumerate(self.all) if each.kind in kinds], dtype=np.intp)

    def of_channel(self, kind: str, run: int, place: int) -> int | None:
        """Return the index of the unknown of a channel in a run; None if the map gives its value."""
        found = (i for i, u in enumerate(self.all) if u.kind == kind and run in u.runs and u.place == place)
        return next(found, None)

    def value(self, x: Array, kind: str, run: int, place: int, known: float) -> float:
        """Return the value of the unknown of a channel in a run; ``known`` if it is not an unknown."""
        found = self.of_channel(kind, run, place)
        return known if found is None else float(x[found] * self.all[found].scale)


def unknowns_of(question: IdentificationQuestion, runs: Sequence[FitRun]) -> Unknowns:
    """Return the unknowns of a fit to these runs."""
    values, scales, bounds = question.values(), question.scales(), question.search_range()
    every = tuple(range(len(runs)))
    found = [
        (Unknown(KEY, key, every, i, float(scales[i]), float(bounds[0, i]), float(bounds[1, i])), float(values[i]))
        for i, key in enumerate(question.keys)
    ]
    for i, run in enumerate(runs):
        if run.begin_s is None:
            found.append((Unknown(BEGIN, str(run.path), (i,), 0, TIME_SCALE_S, 0.0, question.longest_begin_s), 0.0))
    for place in range(len(runs[0].channels)):
        found += _of_channel(runs, place)
    start = np.array([value / unknown.scale for unknown, value in found])
    return Unknowns(tuple(unknown for unknown, _ in found), start)


def _of_channel(runs: Sequence[FitRun], place: int) -> list[tuple[Unknown, float]]:
    fitted = runs[0].channels[place]
    size = float(np.mean([np.std(run.channels[place].values) for run in runs])) or 1.0
    open_words = (
        (ZERO, fitted.channel.zero, size, 0.0, np.inf),
        (GAIN, fitted.channel.gain, 1.0, 1.0, np.inf),
        (LAG, fitted.channel.lag_s, TIME_SCALE_S, 0.0, LONGEST_LAG_S),
    )
    every = tuple(range(len(runs)))
    groups: dict[str | float, list[tuple[int, ...]]] = {FREE: [every], PER_RUN: [(i,) for i in every]}
    return [
        (Unknown(kind, fitted.name, group, place, scale, -reach, reach), start)
        for kind, word, scale, start, reach in open_words
        for group in groups.get(word, ())
    ]


@dataclass(frozen=True)
class Weighting:
    """Standard deviations and masks of the samples used, fixed during a fit."""

    sigmas: Array
    masks: tuple[tuple[Mask, ...], ...]


def contradicting(first: Array, other: Array) -> Mask:
    """Return the rows in which derivatives of two step lengths disagree, shape (rows,).

    Keys without effect are ignored.  If many rows disagree, none is returned: no derivative is reliable then, and
    leaving rows out would hide it.
    """
    off, sizes = np.abs(first - other), np.linalg.norm(first, axis=0)
    usual = np.where(sizes >= LEAST_EFFECT, sizes, np.inf) / np.sqrt(max(len(first), 1))
    larger = np.maximum(np.abs(first), np.abs(other))
    found = ((off > CURVED * larger) & (off > SMALL * usual)).any(axis=1)
    return np.asarray(found if np.mean(found) <= MOST_BENT else np.zeros(len(found), dtype=np.bool_))


def extrapolated(longer: Array, shorter: Array) -> Array:
    """Return the extrapolation to step 0 of central differences over two steps."""
    return shorter + (shorter - longer) / (STEPS**2 - 1.0)


def romberg(longest: Array, middle: Array, shortest: Array) -> tuple[Array, Array]:
    """Return Romberg extrapolations to step 0 of central differences: over three steps, and over the longer two."""
    coarse, fine = extrapolated(longest, middle), extrapolated(middle, shortest)
    return fine + (fine - coarse) / (STEPS**4 - 1.0), coarse


def _differ(first: Array, other: Array) -> Mask:
    """Return the keys whose derivatives differ between two versions."""
    return np.asarray(np.linalg.norm(first - other, axis=0) > DOUBTED * np.linalg.norm(first, axis=0))


class FitProblem:
    """Residuals of a fit, and their derivatives.

    Parameters
    ----------
    priors : mapping
        Mean and standard deviation of keys with prior knowledge; kept in the order of the keys, as their rows are.
    """

    def __init__(
        self, model: ModelRuns, unknowns: Unknowns, priors: Mapping[str, tuple[float, float]] | None = None
    ) -> None:
        self.model, self.question, self.unknowns = model, model.question, unknowns
        self._curvature: tuple[Array, float] | None = None  # where, and how large
        self.runs = model.runs
        self.priors = {key: priors[key] for key in self.question.keys if priors and key in priors}
        self._priors = [(self.question.keys.index(key), *prior) for key, prior in self.priors.items()]

    def over(self, runs: Sequence[FitRun], near: Mapping[str, tuple[float, float]] | None = None) -> FitProblem:
        """Return the problem on other parts of its runs; ``near`` adds priors for keys without one."""
        return FitProblem(self.model.over(runs), self.unknowns, {**(near or {}), **self.priors})

    def comparison(self, x: Array, sigmas: Array) -> Weighting:
        """Return the weighting near ``x``: samples close to an event of the model are masked out."""
        curves = self.model.at(self.unknowns.keys(x))
        masks = []
        for i, run in enumerate(self.runs):
            own = None if curves is None else curves[i]
            masks.append(tuple(self._mask(x, i, run, place, own) for place in range(len(run.channels))))
        return Weighting(sigmas, tuple(masks))

    def _mask(self, x: Array, i: int, run: FitRun, place: int, curves: ColumnCurves | None) -> Mask:
        channel = run.channels[place]
        counts = (channel.times_s >= run.from_s) & (channel.times_s <= run.until_s)
        if channel.of_events:
            return counts & first_of_series(channel.times_s, usual_spacing(channel.times_s))
        if curves is None:
            return counts
        at = self._model_times(x, i, place)
        counts &= at >= 0.0
        guard = GUARD_STEPS if channel.jumps else BEND_GUARD_STEPS
        return counts & ~curves.beside_event(at, guard * curves.step_s)

    def _model_times(self, x: Array, run: int, place: int) -> Array:
        """Return the times since the machine's start at which the samples of a channel were taken."""
        return (
            self.runs[run].channels[place].times_s + self.begin(x, run) - self.unknowns.value(x, LAG, run, place, 0.0)
        )

    def begin(self, x: Array, run: int) -> float:
        """Return the time since the machine's start at a measured run's time 0."""
        return self.unknowns.value(x, BEGIN, run, 0, self.runs[run].begin_s or 0.0)

    def parts(self, x: Array, curves: Curves | None = None) -> list[list[Array]]:
        """Return measured minus predicted for every sample of each channel in each run, in SI units.

        ``curves`` are the simulations at the keys of ``x``, if already computed.
        """
        curves = self.model.at(self.unknowns.keys(x)) if curves is None else curves
        return [
            [
                np.full(len(channel.times_s), np.nan) if curves is None else self._off(x, i, place, channel, curves[i])
                for place, channel in enumerate(run.channels)
            ]
            for i, run in enumerate(self.runs)
        ]

    def _off(self, x: Array, run: int, place: int, channel: FitChannel, curves: ColumnCurves) -> Array:
        inverse_gain = self.unknowns.value(x, GAIN, run, place, 1.0)
        column = self._column(x, run, place, curves)
        off = channel.values - (column * inverse_gain + self.unknowns.value(x, ZERO, run, place, 0.0))
        simulated = channel.times_s <= self.runs[run].until_s
        if channel.turns and simulated.any():
            off = off - TURN * np.round(np.median(off[simulated]) / TURN)
        return off

    def _column(
        self, x: Array, run: int, place: int, curves: ColumnCurves, centre: ColumnCurves | None = None
    ) -> Array:
        """Return the column of a channel at its samples; events are matched as those of the simulation ``centre``."""
        channel, at = self.runs[run].channels[place], self._model_times(x, run, place)
        if not channel.of_events:
            return curves.at(channel.name, at)
        shown, times = self._event_values(x, run, channel, centre or curves, at)
        return shown if centre is None else self._event_values(x, run, channel, curves, times, shown)[0]

    def _event_values(
        self,
        x: Array,
        run: int,
        channel: FitChannel,
        curves: ColumnCurves,
        at_s: Array,
        otherwise: Array | None = None,
    ) -> tuple[Array, Array]:
        """Return the values and times of the model events matched with instants, nan for no instant.

        Without a match it is ``otherwise``, measured plus a limit if absent, and nan.
        """
        every = curves.of_events(channel.kind, "time")
        begins = first_of_series(every, usual_spacing(channel.times_s))
        times, values = every[begins], curves.of_events(channel.kind, channel.field)[begins]
        values = values - self.begin(x, run) if channel.field == "time" else values
        if otherwise is None:
            instants = channel.field == "time"
            limit = SHARE * min(usual_spacing(channel.times_s), 1e3) if instants else np.std(channel.values)
            otherwise = channel.values + limit
        if not len(times):
            return otherwise, np.full(len(at_s), np.nan)
        known, found = np.isfinite(at_s), np.full(len(at_s), -1, dtype=np.int64)
        found[known] = matched(at_s[known], times)
        hit = (found >= 0) & np.isfinite(values[found])
        return np.where(hit, values[found], otherwise), np.where(hit, times[found], np.nan)

    def prepare(self, points: Sequence[Array]) -> None:
        """Simulate a few points whose residuals will be asked for, on all cores."""
        self.model.prepare([self.unknowns.keys(x) for x in points])

    def residuals(self, x: Array, comparison: Weighting) -> Array:
        """Return the residuals of the unmasked samples and the priors, in standard deviations, shape (rows,)."""
        rows = []
        for run, parts in enumerate(self.parts(x)):
            for place, off in enumerate(parts):
                kept = off[comparison.masks[run][place]] / comparison.sigmas[place]
                rows.append(np.clip(np.nan_to_num(kept, nan=REFUSED), -REFUSED, REFUSED))
        keys = self.unknowns.keys(x)
        rows.append(np.array([(keys[i] - mean) / deviation for i, mean, deviation in self._priors]))
        return np.concatenate(rows)

    def jacobian(self, x: Array, comparison: Weighting, among: Mask | None = None) -> Array:
        """Return the derivatives of `residuals`, shape (rows, unknowns).

        ``among``, shape (unknowns,), selects unknowns for a descent beside a fit: one-sided differences suffice there.
        The columns of other keys are 0.
        """
        if among is None:
            return self._with_others(x, comparison, self._straightened(x, comparison, KEY_STEP)[0])
        places = self.unknowns.places(KEY)
        chosen = np.flatnonzero(among[places])
        steps = np.full(len(places), KEY_STEP)
        return self._with_others(x, comparison, self._key_columns(x, comparison, steps, chosen, (1.0,))[0])

    def two_jacobians(self, x: Array, comparison: Weighting) -> tuple[Array, Array]:
        """Return the derivatives of `residuals`, and a less accurate version: they differ by at least the error.

        Central differences over two steps are extrapolated to step 0, over three for a key in which the versions differ
        (Romberg 1955).  If a key's response is strongly curved, its steps are shortened; if rounding dominates, plain
        differences are used.  In rows that still disagree, the order of events changes within the steps: the
        derivatives by the keys are set to 0 in both.
        """
        longest, steps = self._straightened(x, comparison, STEPS * KEY_STEP)
        middle = self._key_columns(x, comparison, steps / STEPS)[0]
        first, other = extrapolated(longest, middle), middle.copy()
        doubted = np.flatnonzero(_differ(first, other))
        if len(doubted):
            shortest = self._key_columns(x, comparison, steps / STEPS**2, doubted)[0]
            first[:, doubted], other[:, doubted] = (each[:, doubted] for each in romberg(longest, middle, shortest))
            still = _differ(first, other)
            bends = np.linalg.norm(shortest - middle, axis=0) < np.linalg.norm(middle - longest, axis=0)
            bent, rounded = np.flatnonzero(still & bends), still & ~bends
            first[:, rounded], other[:, rounded] = middle[:, rounded], longest[:, rounded]
            if len(bent):
                again = self._key_columns(x, comparison, steps / STEPS**3, bent)[0]
                first[:, bent], other[:, bent] = romberg(middle[:, bent], shortest[:, bent], again[:, bent])
        lost = contradicting(first, other)
        first[lost] = other[lost] = 0.0
        return self._with_others(x, comparison, first), self._with_others(x, comparison, other)

    def curvature(self, x: Array, comparison: Weighting) -> float:
        """Return the median over keys of the relative difference between the slopes on either side of a step.

        It is that of the last derivatives if they were taken close by; else derivatives are computed here.
        """
        if self._curvature is None or np.any(np.abs(x - self._curvature[0]) > CLOSE):
            self.jacobian(x, comparison)
        return 0.0 if self._curvature is None else self._curvature[1]

    def _with_others(self, x: Array, comparison: Weighting, keys: Array) -> Array:
        """Return the derivatives by the keys, complemented by those by other unknowns and the rows of priors."""
        rows = [self._columns(x, comparison, run, place) for run, place in self.places()]
        found = np.concatenate([*rows, np.zeros((len(self._priors), len(x)))])
        found[: len(found) - len(self._priors), self.unknowns.places(KEY)] = keys
        for row, (i, _, deviation) in enumerate(self._priors, len(found) - len(self._priors)):
            found[row, i] = self.unknowns.all[i].scale / deviation
        return found

    def places(self) -> list[Place]:
        """Return the indices (run, channel) of each group of rows, in order."""
        return [(run, place) for run, each in enumerate(self.runs) for place in range(len(each.channels))]

    def _columns(self, x: Array, comparison: Weighting, run: int, place: int) -> Array:
        """Return the derivatives by all unknowns but keys, of one channel in one run."""
        channel, mask = self.runs[run].channels[place], comparison.masks[run][place]
        found = np.zeros((int(mask.sum()), len(x)))
        curves = self.model.at(self.unknowns.keys(x))
        if curves is None:
            return found
        column = self._column(x, run, place, curves[run])[mask]
        inverse_gain = self.unknowns.value(x, GAIN, run, place, 1.0)
        if channel.of_events:
            by_begin = inverse_gain * np.full(len(column), -1.0 if channel.field == "time" else 0.0)
            by_lag = np.zeros(len(column))
        else:
            by_begin = inverse_gain * curves[run].slope(channel.name, self._model_times(x, run, place)[mask])
            by_lag = -by_begin
        slopes = ((ZERO, np.ones(len(column))), (GAIN, column), (LAG, by_lag), (BEGIN, by_begin))
        for kind, slope in slopes:
            unknown = self.unknowns.of_channel(kind, run, 0 if kind == BEGIN else place)
            if unknown is not None:
                found[:, unknown] = -slope * self.unknowns.all[unknown].scale / comparison.sigmas[place]
        return found

    def _straightened(self, x: Array, comparison: Weighting, step: float) -> tuple[Array, Array]:
        """Return the derivatives by the keys, and the steps used: shorter ones where too many rows had a kink."""
        steps = np.full(len(self.unknowns.places(KEY)), step)
        found, bent = self._key_columns(x, comparison, steps)
        again = np.flatnonzero(bent > MOST_BENT)
        if len(again):
            shorter, less = self._key_columns(x, comparison, steps / HALVED, again)
            better = again[less[again] < bent[again]]
            found[:, better], steps[better] = shorter[:, better], steps[better] / HALVED
        return found, steps

    def _key_columns(
        self,
        x: Array,
        comparison: Weighting,
        steps: Array,
        among: npt.NDArray[np.intp] | None = None,
        signs: tuple[float, ...] = BOTH,
    ) -> tuple[Array, Array]:
        """Return differences of the rows by each key, and the largest share of rows with a kink in a channel.

        ``among`` are the indices of the keys to compute, all if absent; other columns are 0.  ``signs`` are those of
        the steps.
        """
        centre = self.model.at(self.unknowns.keys(x))
        found = np.zeros((sum(int(mask.sum()) for masks in comparison.masks for mask in masks), len(steps)))
        bent, curved = np.zeros(len(steps)), np.zeros(len(steps))
        places = range(len(steps)) if among is None else among.tolist()
        if centre is not None:
            for place, (up, down) in zip(places, self._members(x, places, steps, signs), strict=True):
                found[:, place], bent[place], curved[place] = self._difference(
                    x, comparison, (up, centre, down), float(steps[place])
                )
        if among is None and len(steps):
            self._curvature = x.copy(), float(np.median(curved * KEY_STEP / steps))
        return found, bent

    def _members(
        self, x: Array, places: Sequence[int], steps: Array, signs: tuple[float, ...] = BOTH
    ) -> list[tuple[Curves | None, Curves | None]]:
        """Return the simulations with each key stepped up and down; None for a sign without a step."""
        keys, scales = self.unknowns.keys(x), self.unknowns.scales[self.unknowns.places(KEY)]
        asked = []
        for place in places:
            for sign in signs:
                moved = keys.copy()
                moved[place] += sign * steps[place] * scales[place]
                asked.append(moved)
        rolled = iter(self.model.many(asked))
        return [(next(rolled), next(rolled) if len(signs) > 1 else None) for _ in places]

    def _difference(self, x: Array, comparison: Weighting, members: Members, step: float) -> tuple[Array, float, float]:
        """Return the derivative of the rows by a scaled key, the largest share of rows with a kink, and the curvature.

        Where the slopes on either side of the centre disagree, the order of events changed on one side; the smaller
        slope is taken as that of the centre's order.
        """
        slopes, bent, off, whole = [], 0.0, 0.0, 0.0
        for run, place in self.places():
            sides = self._sides(x, comparison, (run, place), members, step)
            if not sides:
                slopes.append(np.zeros(int(comparison.masks[run][place].sum())))
                continue
            first, last = sides[0], sides[-1]
            size = np.abs(first) + np.abs(last)
            bends = np.abs(first - last) > CURVED * size + LEAST_BEND / step
            slopes.append(-np.where(bends, np.where(np.abs(first) < np.abs(last), first, last), 0.5 * (first + last)))
            bent = max(bent, float(np.mean(bends)) if len(bends) else 0.0)
            off, whole = off + float(np.sum((first - last) ** 2)), whole + float(np.sum((first + last) ** 2))
        return np.concatenate(slopes), bent, np.sqrt(off) / max(np.sqrt(whole), LEAST_EFFECT)

    def _sides(self, x: Array, comparison: Weighting, at: Place, members: Members, step: float) -> list[Array]:
        """Return the one-sided slopes of a channel in a run, for each side whose simulation succeeded."""
        (run, place), centre = at, members[1]
        mask, sigma = comparison.masks[run][place], comparison.sigmas[place]
        inverse_gain = self.unknowns.value(x, GAIN, run, place, 1.0)
        middle = inverse_gain * self._column(x, run, place, centre[run])[mask]
        return [
            sign * (inverse_gain * self._column(x, run, place, member[run], centre[run])[mask] - middle) / step / sigma
            for sign, member in ((1.0, members[0]), (-1.0, members[2]))
            if member is not None
        ]


def problem_of(question: IdentificationQuestion, runs: Sequence[FitRun]) -> FitProblem:
    """Return the fit problem of a question's keys on runs."""
    return FitProblem(ModelRuns(question, runs), unknowns_of(question, runs), question.priors)
