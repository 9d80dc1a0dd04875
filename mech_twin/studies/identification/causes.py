# SPDX-License-Identifier: Apache-2.0
"""What of the sensors, the clock, the beginning or the priors would explain the residuals of a fit.

Each cause is an unknown that the fit did not have.  To first order it takes a share of the squared residuals away, if
the fit follows.  Beside a fit that noise does not refute, that is judged by the score test (Rao 1948): by chance noise,
with its memory, would hardly take so much away.  A refuted fit may be far from the truth, where first order says
little: it is repeated with each cause that seems likely, and only what then explains the residuals is told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy import stats

from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import FREE
from mech_twin.measurements.units import unit_of
from mech_twin.studies.identification.fit_problem import (
    BEGIN,
    GAIN,
    LAG,
    TIME_SCALE_S,
    ZERO,
    FitProblem,
    Unknown,
    Unknowns,
    problem_of,
    unknowns_of,
)
from mech_twin.studies.identification.fit_quality import (
    TINY,
    Fitted,
    channel_noise,
    in_map,
    noise_misfit,
    refutation,
)
from mech_twin.studies.identification.fit_runs import FitChannel, FitRun
from mech_twin.studies.identification.intervals import Linearised, linearised, remembered_noise
from mech_twin.studies.identification.staged_fit import carried_over, refined, robust_weights

MOST = 0.8  # share of the squared residuals beyond noise that a cause explains, to be told of a refuted fit
ALIKE = 0.95  # of what the best cause explains: one that explains as much is told beside it
SCORE = float(stats.chi2.isf(1e-4, 1))  # a score that noise exceeds once in so many candidates
FARTHEST_BEGIN = 3.0  # times the begin to first order: the bound of a fit with it
LEAST_OWN = 1e-6  # share of a cause's squared effect that the fit does not follow: with less, it explains nothing


class FitCause(NamedTuple):
    """What may be off, and its size by derivatives; ``refitted`` returns the fit with it, and its size there."""

    won: float  # of the squared residuals, to first order
    score: float
    size: float
    words: Callable[[float], str]
    refitted: Callable[[float], tuple[Fitted, float]]


def likely_cause(fitted: Fitted, whole: Fitted, line: Linearised, *, is_refuted: bool) -> str:
    """Return the errors of sensors, times or priors that would explain the residuals of a fit, with sizes; maybe none.

    Parameters
    ----------
    whole : Fitted
        The same point with all keys free, of which ``line`` holds the derivatives at the fit.
    """
    alike = _alike(_causes(fitted, whole, line))
    if not is_refuted:
        words = " or ".join(cause.words(cause.size) for cause in alike)
        best = max((cause.score for cause in alike), default=0.0)
        return f"; but {words} would fit better, which the interval does not hold" if best > SCORE else ""
    found = _explaining(fitted, alike)
    named = [each for each in found if refutation(each[0]) is None] or found
    words, least = " or ".join(words for *_, words in named), min((share for _, share, _ in named), default=1.0)
    return f"; {words} would explain {100.0 * least:.0f} % of what noise does not" if named else ""


def explained(fitted: Fitted) -> bool:
    """Return whether noise does not refute the fit with a cause that would be told, which no other keys would win."""
    found = _explaining(fitted, _alike(_causes(fitted, fitted, linearised(fitted))))
    return any(refutation(with_cause) is None for with_cause, *_ in found)


def _explaining(fitted: Fitted, causes: Sequence[FitCause]) -> list[tuple[Fitted, float, str]]:
    """Return the fits with a cause that explains most of what noise does not, the share of it, and the cause."""
    lacking, explaining = noise_misfit(fitted) ** 2 - 1.0, list[tuple[Fitted, float, str]]()
    for cause in causes if lacking > 0.0 else ():
        found, size = cause.refitted(cause.size)
        share = min((lacking - noise_misfit(found) ** 2 + 1.0) / lacking, 1.0)
        explaining += [(found, share, cause.words(size))] if share > MOST else []
    return explaining


def _alike(causes: Sequence[FitCause]) -> list[FitCause]:
    """Return the causes that explain nearly as much as the likeliest, to first order."""
    most = max(cause.won for cause in causes)
    return [cause for cause in causes if cause.won >= ALIKE * most > 0.0]


def _causes(fitted: Fitted, whole: Fitted, line: Linearised) -> list[FitCause]:
    """Return the causes with what they explain to first order."""
    problem, masks = fitted.problem, fitted.comparison.masks
    opened = [replace(run, channels=tuple(map(_all_open, run.channels))) for run in problem.runs]
    unknowns = unknowns_of(problem.question, opened)
    x = carried_over(fitted, unknowns)
    rows, priors = np.zeros((len(line.residuals), len(x))), np.flatnonzero(line.channels < 0)
    samples, lags, places = len(rows) - len(priors), unknowns.places(LAG), problem.places()
    rows[:samples] = FitProblem(problem.model, unknowns).jacobian(x, fitted.comparison, np.zeros(len(x), bool))
    over_noise = np.array([fitted.comparison.sigmas[j] / channel_noise(problem.runs, j)[0] for _, j in places])
    weights = np.where(line.channels < 0, 1.0, over_noise[line.channels])
    robust = weights * robust_weights(whole.problem.residuals(whole.x, whole.comparison))
    rows *= robust[:, None]
    root, _ = np.linalg.qr(line.jacobian * weights[:, None])

    def left_by_fit(column: Array) -> Array:
        return np.asarray(column - root @ (root.T @ column))

    off = left_by_fit(line.residuals * weights)

    def won_by(column: Array) -> tuple[float, float, float]:
        own = left_by_fit(column)
        power, shared = float(own @ own), float(own @ off)
        if power <= LEAST_OWN * float(column @ column):
            return 0.0, 0.0, 0.0
        by_chance, _ = remembered_noise(own[:, None], off, line.channels)
        return shared**2 / power, shared**2 / max(float(by_chance[0, 0]), TINY), -shared / power

    found = list[FitCause]()
    for i in unknowns.places(ZERO, GAIN, LAG).tolist():
        unknown = unknowns.all[i]
        channel = problem.runs[0].channels[unknown.place]
        is_open = problem.unknowns.of_channel(unknown.kind, 0, unknown.place) is not None
        if is_open or channel.of_events or (channel.turns and unknown.kind == GAIN):  # which would be the clock
            continue
        won, score, step = won_by(rows[:, i])
        words = partial(_of_sensor, unknown.kind, channel)
        found.append(FitCause(won, score, (float(x[i]) + step) * unknown.scale, words, partial(_open, fitted, unknown)))
    for row, (key, (mean, deviation)) in zip(priors, whole.problem.priors.items(), strict=True):
        won, score, step = won_by(np.where(np.arange(len(rows)) == row, robust, 0.0))
        repeated = partial(_without_prior, fitted, key)
        found.append(FitCause(won, score, mean - step * deviation, partial(_of_prior, key), repeated))
    times, by_delay = np.zeros(len(rows)), (rows[:, lags] / unknowns.scales[lags]).sum(axis=1)
    times[:samples] = np.concatenate([problem.runs[i].channels[j].times_s[masks[i][j]] for i, j in places])
    for number, (i, j) in enumerate(places):
        if problem.runs[i].channels[j].of_instants:
            of_channel = line.channels == number
            by_delay[of_channel] = -robust[of_channel] / fitted.comparison.sigmas[j]
    found.append(FitCause(*won_by(by_delay * times), _of_clock, partial(_other_clock, fitted)))
    if all(run.begin_s is not None for run in problem.runs):
        found.append(FitCause(*won_by(-by_delay), _of_begin, partial(_begun, fitted)))
    return found


def _of_sensor(kind: str, channel: FitChannel, size: float) -> str:
    unit = {ZERO: f" {channel.channel.unit or unit_of(channel.name)}", GAIN: " times", LAG: " s"}[kind]
    return f"a {kind} of {channel.name} that is off by {in_map(kind, size, channel):.4g}{unit}"


def _of_prior(key: str, value: float) -> str:
    return f"a prior of {key} about {value:.4g}"


def _of_clock(rate: float) -> str:
    way = "fast" if rate > 0.0 else "slow"
    return f"a clock {100.0 * abs(rate):.3g} % too {way}, or a machine as much the other way,"


def _of_begin(begin_s: float) -> str:
    side = "after" if begin_s > 0.0 else "before"
    return f"a run that begins {abs(begin_s):.4g} s {side} the machine's start"


def _open(fitted: Fitted, unknown: Unknown, size: float) -> tuple[Fitted, float]:
    """Return the fit with a zero, gain or lag that the map gives left free."""
    word = {ZERO: "zero", GAIN: "gain", LAG: "lag_s"}[unknown.kind]

    def opened(run: FitRun) -> FitRun:
        channels = list(run.channels)
        channel = channels[unknown.place]
        channels[unknown.place] = replace(channel, channel=channel.channel.model_copy(update={word: FREE}))
        return replace(run, channels=tuple(channels))

    problem = problem_of(fitted.problem.question, list(map(opened, fitted.problem.runs)))
    place = problem.unknowns.of_channel(unknown.kind, 0, unknown.place)
    x = carried_over(fitted, problem.unknowns)
    x[place] = size / unknown.scale
    found = refined(problem, x)
    return found, float(found.x[place]) * unknown.scale


def _without_prior(fitted: Fitted, key: str, size: float) -> tuple[Fitted, float]:
    """Return the fit without the prior of a key, and the key's value there."""
    question = fitted.problem.question
    priors = {name: prior for name, prior in question.priors.items() if name != key}
    found = refined(problem_of(replace(question, priors=priors), fitted.problem.runs), fitted.x)
    values = dict(zip(question.keys, found.key_values.tolist(), strict=True))
    return found, values.get(key, size)


def _other_clock(fitted: Fitted, rate: float) -> tuple[Fitted, float]:
    """Return the fit of the runs with times as another clock gives them."""

    def slower(channel: FitChannel) -> FitChannel:
        values = channel.values / (1.0 + rate) if channel.of_instants else channel.values
        return replace(channel, times_s=channel.times_s / (1.0 + rate), values=values)

    runs = [replace(run, channels=tuple(map(slower, run.channels))) for run in fitted.problem.runs]
    return refined(problem_of(fitted.problem.question, runs), fitted.x), rate


def _begun(fitted: Fitted, begin_s: float) -> tuple[Fitted, float]:
    """Return the fit of runs that begin at another time of the machine's run, and this time."""
    problem = fitted.problem
    reach = min(FARTHEST_BEGIN * abs(begin_s), *(run.last_s - run.first_s for run in problem.runs))
    runs = [replace(run, begin_s=reach) for run in problem.runs]  # simulated as much longer
    begin = Unknown(BEGIN, "", tuple(range(len(runs))), 0, TIME_SCALE_S, -reach, reach)
    x = np.append(fitted.x, np.clip(begin_s, -reach, reach) / begin.scale)
    unknowns = Unknowns((*problem.unknowns.all, begin), x)
    found = refined(FitProblem(problem.model.over(runs), unknowns, problem.priors), x)
    return found, float(found.x[-1]) * begin.scale


def _all_open(channel: FitChannel) -> FitChannel:
    """Return a channel of which the map leaves zero, gain and lag free, where it gives numbers."""
    given = channel.channel
    words = {kind: FREE for kind in ("zero", "gain", "lag_s") if not isinstance(getattr(given, kind), str)}
    return replace(channel, channel=given.model_copy(update=words))
