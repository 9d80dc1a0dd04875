# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of all free keys at a fit: derivatives, intervals, and the evidence for each verdict.

Beside them stands what of the sensors, the clock or the priors would explain the residuals.  Each cause is an unknown
that the fit did not have.  To first order it takes a share of the squared residuals away, if the fit follows.  Beside
a fit that noise does not refute, that is judged by the score test (Rao 1948): by chance noise, with its memory, would
hardly take so much away.  A refuted fit may be far from the truth, where first order says little: it is repeated with
each cause that seems likely, and only what then explains the residuals is told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy import stats

from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import FREE
from mech_twin.measurements.units import unit_of
from mech_twin.studies.identification.fit_runs import FitChannel, FitRun
from mech_twin.studies.identification.held_out import TINY, channel_noise, in_map, noise_misfit, refutation
from mech_twin.studies.identification.intervals import (
    Linearised,
    Uncertainty,
    last_step,
    linearised,
    moved_by_fixed,
    remembered_noise,
    uncertainty,
)
from mech_twin.studies.identification.keyed_configuration import unit_at
from mech_twin.studies.identification.least_squares_fit import (
    Fitted,
    Progress,
    carried_over,
    noise_floors,
    problem_of,
    quiet,
    refined,
    robust_weights,
    spreads,
)
from mech_twin.studies.identification.refits import KeyProfile, Refits, family, key_profiles, profiles_spread
from mech_twin.studies.identification.residuals import FitProblem
from mech_twin.studies.identification.staged_search import BENDING, Search
from mech_twin.studies.identification.unknowns import (
    BEGIN,
    GAIN,
    KEY,
    LAG,
    ZERO,
    IdentificationQuestion,
    Unknown,
    unknowns_of,
)
from mech_twin.studies.identification.verdicts import (
    IDENTIFIED,
    Combination,
    Family,
    KeyEvidence,
    KeyVerdict,
    Sensitivity,
    combinations,
    key_verdicts,
    refuted,
    sensitivity,
)

MOST = 0.8  # share of the squared residuals beyond noise that a cause explains, to be told of a refuted fit
ALIKE = 0.95  # of what the best cause explains: one that explains as much is told beside it
SCORE = float(stats.chi2.isf(1e-4, 1))  # a score that noise exceeds once in so many candidates
LEAST_OWN = 1e-6  # share of a cause's squared effect that the fit does not follow: with less, it explains nothing


class FitCause(NamedTuple):
    """What may be off, and its size by derivatives; ``refitted`` returns the fit with it, and its size there."""

    won: float  # of the squared residuals, to first order
    score: float
    size: float
    words: Callable[[float], str]
    refitted: Callable[[float], tuple[Fitted, float]]


def likely_cause(
    question: IdentificationQuestion, fitted: Fitted, whole: FitProblem, line: Linearised, *, is_refuted: bool
) -> str:
    """Return what of sensors, clock or priors would explain the residuals of a fit, with its size; empty without.

    Parameters
    ----------
    whole : FitProblem
        The same with all free keys, of which ``line`` holds the derivatives at the fit.
    """
    causes, beyond = _causes(question, fitted, whole, line)
    most = max(cause.won for cause in causes)
    alike = [cause for cause in causes if cause.won >= ALIKE * most]
    if not is_refuted:
        words = " or ".join(cause.words(cause.size) for cause in alike)
        best = max(cause.score for cause in alike)
        return f"; but {words} would fit better, which the interval does not hold" if best > SCORE else ""
    lacking, named, least = noise_misfit(fitted) ** 2 - 1.0, [], 1.0
    for cause in alike if 0.0 < MOST * beyond < most and lacking > 0.0 else ():
        found, size = cause.refitted(cause.size)
        share = min((lacking - noise_misfit(found) ** 2 + 1.0) / lacking, 1.0)
        if share > MOST:
            named.append(cause.words(size))
            least = min(least, share)
    return f"; {' or '.join(named)} would explain {100.0 * least:.0f} % of what noise does not" if named else ""


def _causes(
    question: IdentificationQuestion, fitted: Fitted, whole: FitProblem, line: Linearised
) -> tuple[list[FitCause], float]:
    """Return the causes with what they explain to first order, and the squared residuals beyond noise."""
    problem, masks = fitted.problem, fitted.comparison.masks
    opened = [replace(run, channels=tuple(map(_all_open, run.channels))) for run in problem.runs]
    unknowns = unknowns_of(problem.model.keyed, problem.model.keyed.bounds(), opened)
    x = carried_over(fitted, unknowns)
    rows, priors = np.zeros((len(line.residuals), len(x))), np.flatnonzero(line.channels < 0)
    samples, lags, places = len(rows) - len(priors), unknowns.places(LAG), problem.places()
    rows[:samples] = FitProblem(problem.model, unknowns).jacobian(x, fitted.comparison, np.zeros(len(x), bool))
    over_noise = np.array([fitted.comparison.sigmas[j] / channel_noise(problem, j)[0] for _, j in places])
    weights = np.where(line.channels < 0, 1.0, over_noise[line.channels])
    robust = weights * robust_weights(whole.residuals(carried_over(fitted, whole.unknowns), fitted.comparison))
    rows *= robust[:, None]
    root, _ = np.linalg.qr(line.jacobian * weights[:, None])

    def left_by_fit(column: Array) -> Array:
        return np.asarray(column - root @ (root.T @ column))

    all_off = line.residuals * weights
    off, beyond = left_by_fit(all_off), float(all_off @ all_off) - len(rows)

    def explained(column: Array) -> tuple[float, float, float]:
        own = left_by_fit(column)
        power, shared = float(own @ own), float(own @ off)
        if power <= LEAST_OWN * float(column @ column):
            return 0.0, 0.0, 0.0
        by_chance, _ = remembered_noise(own[:, None], off, line.channels)
        return shared**2 / power, shared**2 / max(float(by_chance[0, 0]), TINY), -shared / power

    own, found = question.of(problem.model.keyed.keys), list[FitCause]()
    for i in unknowns.places(ZERO, GAIN, LAG).tolist():
        unknown = unknowns.all[i]
        channel = problem.runs[0].channels[unknown.place]
        is_open = problem.unknowns.of_channel(unknown.kind, 0, unknown.place) is not None
        if is_open or channel.of_events or (channel.turns and unknown.kind == GAIN):  # which would be the clock
            continue
        won, score, step = explained(rows[:, i])
        words = partial(_of_sensor, unknown.kind, channel)
        found.append(
            FitCause(won, score, (float(x[i]) + step) * unknown.scale, words, partial(_open, own, fitted, unknown))
        )
    for row, (key, (mean, deviation)) in zip(priors, whole.priors.items(), strict=True):
        won, score, step = explained(np.where(np.arange(len(rows)) == row, robust, 0.0))
        repeated = partial(_without_prior, own, fitted, key)
        found.append(FitCause(won, score, mean - step * deviation, partial(_of_prior, key), repeated))
    times, by_delay = np.zeros(len(rows)), (rows[:, lags] / unknowns.scales[lags]).sum(axis=1)
    times[:samples] = np.concatenate([problem.runs[i].channels[j].times_s[masks[i][j]] for i, j in places])
    for number, (i, j) in enumerate(places):
        if problem.runs[i].channels[j].of_instants:
            of_channel = line.channels == number
            by_delay[of_channel] = -robust[of_channel] / fitted.comparison.sigmas[j]
    found.append(FitCause(*explained(by_delay * times), _of_clock, partial(_other_clock, own, fitted)))
    return found, beyond


def _of_sensor(kind: str, channel: FitChannel, size: float) -> str:
    unit = {ZERO: f" {channel.channel.unit or unit_of(channel.name)}", GAIN: " times", LAG: " s"}[kind]
    return f"a {kind} of {channel.name} that is off by {in_map(kind, size, channel):.4g}{unit}"


def _of_prior(key: str, value: float) -> str:
    return f"a prior of {key} about {value:.4g}"


def _of_clock(rate: float) -> str:
    way = "fast" if rate > 0.0 else "slow"
    return f"a clock {100.0 * abs(rate):.3g} % too {way}, or a machine as much the other way,"


def _open(question: IdentificationQuestion, fitted: Fitted, unknown: Unknown, size: float) -> tuple[Fitted, float]:
    """Return the fit with a zero, gain or lag that the map gives left free."""
    word = {ZERO: "zero", GAIN: "gain", LAG: "lag_s"}[unknown.kind]

    def opened(run: FitRun) -> FitRun:
        channels = list(run.channels)
        channel = channels[unknown.place]
        channels[unknown.place] = replace(channel, channel=channel.channel.model_copy(update={word: FREE}))
        return replace(run, channels=tuple(channels))

    problem = problem_of(question, list(map(opened, fitted.problem.runs)))
    place = problem.unknowns.of_channel(unknown.kind, 0, unknown.place)
    x = carried_over(fitted, problem.unknowns)
    x[place] = size / unknown.scale
    found = refined(problem, x)
    return found, float(found.x[place]) * unknown.scale


def _without_prior(question: IdentificationQuestion, fitted: Fitted, key: str, size: float) -> tuple[Fitted, float]:
    """Return the fit without the prior of a key, and the key's value there."""
    priors = {name: prior for name, prior in question.priors.items() if name != key}
    found = refined(problem_of(replace(question, priors=priors), fitted.problem.runs), fitted.x)
    values = dict(zip(question.keys, found.key_values.tolist(), strict=True))
    return found, values.get(key, size)


def _other_clock(question: IdentificationQuestion, fitted: Fitted, rate: float) -> tuple[Fitted, float]:
    """Return the fit of the runs with times as another clock gives them."""

    def slower(channel: FitChannel) -> FitChannel:
        values = channel.values / (1.0 + rate) if channel.of_instants else channel.values
        return replace(channel, times_s=channel.times_s / (1.0 + rate), values=values)

    runs = [replace(run, channels=tuple(map(slower, run.channels))) for run in fitted.problem.runs]
    return refined(problem_of(question, runs), fitted.x), rate


def _all_open(channel: FitChannel) -> FitChannel:
    """Return a channel of which the map leaves zero, gain and lag free, where it gives numbers."""
    given = channel.channel
    words = {kind: FREE for kind in ("zero", "gain", "lag_s") if not isinstance(getattr(given, kind), str)}
    return replace(channel, channel=given.model_copy(update=words))


REFITS = 2  # at most, if a step or a profile shows that the fit had not converged
PREDICTABLE = (0.5, 0.25, 0.12)  # shares of the runs to try if derivatives over the whole runs are unreliable
OFFSET = 0.1  # of a half width: with a longer next step, the fit has not converged


@dataclass(frozen=True)
class AroundFit:
    """A fit of some of the free keys, and derivatives by all of them at its end."""

    fitted: Fitted
    whole: FitProblem
    line: Linearised
    seen: Sensitivity

    @property
    def x(self) -> Array:
        """The fit's result as the unknowns of all free keys."""
        return carried_over(self.fitted, self.whole.unknowns)

    @property
    def bends(self) -> bool:
        """Whether derivatives do not predict the effect of keys, since small errors of a key have grown large."""
        problem = self.fitted.problem
        return self.seen.contradicted or problem.curvature(self.fitted.x, self.fitted.comparison) > BENDING

    def refits(self) -> Refits:
        """Return refits about this fit, by all free keys."""
        return Refits(Fitted(self.whole, self.x, self.fitted.comparison, self.fitted.cost), self.line)

    def with_all_of(self, chosen: Sequence[int]) -> AroundFit:
        """Return the same with these keys marked as distinguishable, since the runs reject leaving one out."""
        return replace(self, seen=self.seen.with_all_of(chosen))


def sensitivity_at(problem: FitProblem, x: Array) -> Sensitivity:
    """Return the sensitivity of the channels to the keys before anything is fitted."""
    floors = noise_floors(problem.runs)
    comparison = problem.comparison(x, np.maximum(floors, spreads(problem, x, problem.comparison(x, floors))))
    weights = robust_weights(problem.residuals(x, comparison))
    jacobian = problem.jacobian(x, comparison) * weights[:, None]
    places = problem.unknowns.places(KEY)
    return sensitivity(jacobian, jacobian, places, x[places])


def around_fit(question: IdentificationQuestion, fitted: Fitted) -> AroundFit:
    """Return derivatives by all free keys at the end of a fit of some of them."""
    base = fitted.problem.model.keyed.parameters(fitted.key_values)
    whole = problem_of(replace(question, base=base), fitted.problem.runs)
    x = carried_over(fitted, whole.unknowns)
    line = linearised(Fitted(whole, x, fitted.comparison, fitted.cost))
    places = whole.unknowns.places(KEY)
    return AroundFit(fitted, whole, line, sensitivity(line.jacobian, line.other, places, x[places]))


def predictable(question: IdentificationQuestion, around: AroundFit, progress: Progress = quiet) -> AroundFit:
    """Return the fit of the longest initial share of the runs for which derivatives are reliable.

    If the effect of the initial state does not decay, a small error of a key grows.  In the later part of a run, the
    minimum is then narrower than any difference step, and derivatives there do not give a key's interval.  A share
    in which a key has no effect yet says nothing of it.
    """
    problem, here = around.fitted.problem, around
    for share in PREDICTABLE if around.bends else ():
        progress(f"first {100.0 * share:.0f} % of the runs alone")
        part = problem.over([run.first_share(share) for run in problem.runs])
        here = around_fit(question, refined(part, around.fitted.x, progress))
        if not here.bends:
            return here if (here.seen.acting >= around.seen.acting).all() else around
    return around


def with_others_as_configured(question: IdentificationQuestion, around: AroundFit, chosen: Sequence[int]) -> Array:
    """Return the best-fitting values of the chosen keys with the other free keys as configured, shape (chosen,)."""
    whole = around.whole.unknowns
    fixed = [i for i in range(len(question.keys)) if i not in chosen]
    before = question.keyed.values() / whole.scales[: len(question.keys)]
    refits = around.refits()
    follows = ~np.isin(np.arange(len(around.x)), fixed)
    return whole.keys(refits.with_held(fixed, before[fixed], follows, [refits.fit]).x)[list(chosen)]


def settled(
    question: IdentificationQuestion, around: AroundFit, chosen: Sequence[int], progress: Progress = quiet
) -> tuple[AroundFit, Uncertainty]:
    """Return the converged fit, and the uncertainty of its unknowns.

    Parameters
    ----------
    chosen : sequence of int
        Indices of the free keys that it estimates; the others are fixed.
    """
    kept = np.concatenate([np.array(chosen, dtype=np.intp), around.whole.unknowns.places(BEGIN, ZERO, GAIN, LAG)])
    for left in reversed(range(REFITS + 1)):
        fitted = around.fitted
        own = around.line.of(kept).over(fitted.problem.unknowns.scales / around.whole.unknowns.scales[kept])
        known, left_over = uncertainty(own), _left_over(fitted, own)
        profiles = _profiles(question, fitted, own, progress)
        better = max(profiles, key=lambda each: each.won, default=None)
        x = fitted.x if better is None or better.better is None else better.better
        ended = x is fitted.x and np.all(np.abs(left_over) <= OFFSET * known.half_widths[0])
        if ended or left == 0:
            break
        progress("the fit once more, from where it had not ended")
        again = around_fit(question, refined(fitted.problem, x, progress))
        around = again.with_all_of(chosen) if around.seen.distinguished else again
    return around, _widened(known, own, around.seen, chosen, np.abs(left_over), profiles)


def _profiles(
    question: IdentificationQuestion, fitted: Fitted, own: Linearised, progress: Progress
) -> list[KeyProfile]:
    if refutation(fitted) is not None:
        return []
    if question.scheduler is None:
        return key_profiles(fitted, own, progress)
    progress("profiles, on the cluster")
    return profiles_spread(question, fitted, own)


def _left_over(fitted: Fitted, own: Linearised) -> Array:
    """Return the next Gauss-Newton step of a fit; 0 for unknowns at a bound."""
    low, high = fitted.problem.unknowns.bounds()
    inside = np.flatnonzero((fitted.x > low) & (fitted.x < high))
    found = np.zeros(len(fitted.x))
    found[inside] = last_step(own.of(inside))
    return found


def _widened(
    known: Uncertainty,
    own: Linearised,
    seen: Sensitivity,
    chosen: Sequence[int],
    left_over: Array,
    profiles: Sequence[KeyProfile],
) -> Uncertainty:
    """Return intervals widened by the errors of fixed keys, remaining steps and profiles."""
    ends = np.full(known.half_widths.shape, np.nan)
    for each in profiles:
        ends[:, each.place] = each.lower, each.upper

    def with_fixed(fixed: Sequence[int]) -> Array:
        moved = moved_by_fixed(own, seen.jacobian[:, list(fixed)])
        return np.asarray(np.fmax(np.hypot(known.half_widths, moved) + left_over, ends))

    fixed = [i for i in range(len(seen.effects)) if i not in chosen]
    halves = with_fixed(fixed)
    given = halves.copy()
    for group in seen.groups():
        places = [place for place, i in enumerate(chosen) if i in group]
        given[:, places] = with_fixed([i for i in fixed if i not in group])[:, places]
    return replace(known, half_widths=halves, given_tied=given)


def combined(
    question: IdentificationQuestion,
    refits: Refits,
    seen: Sensitivity,
    chosen: Sequence[int],
    half_widths: Array,
    progress: Progress = quiet,
) -> list[Combination]:
    """Return the identifiable combinations of tied keys, from refits with the fixed ones moved.

    Parameters
    ----------
    refits : Refits
        Refits about the fit; the free keys are its first unknowns.
    chosen : sequence of int
        Indices of the fitted keys.
    half_widths : ndarray
        Shape (2, keys): half widths of the 95 % intervals, the fixed keys held.
    """
    names, families, count = question.keys, [], len(question.keys)
    scales = refits.problem.unknowns.scales[:count]
    bounds = question.keyed.bounds(question.bounds) / scales
    follows = ~np.isin(np.arange(len(refits.x)), [i for i in range(count) if i not in chosen])
    for group in seen.groups():
        fixed, fitted = [i for i in group if i not in chosen], [i for i in group if i in chosen]
        if fixed and fitted:
            progress(f"what fits as well with other {', '.join(names[i] for i in fixed)}")
            points = family(refits, fixed, follows, bounds)
            if points is not None:
                families.append(Family(tuple(fitted), tuple(fixed), points[:, :count] * scales))
    units = [unit_at(type(question.base), key) for key in names]
    return combinations(families, names, units, half_widths)


def verdicts_of(
    question: IdentificationQuestion,
    around: AroundFit,
    chosen: Sequence[int],
    known: Uncertainty,
    search: Search,
    progress: Progress = quiet,
) -> tuple[list[KeyVerdict], list[Combination]]:
    """Return the verdict on each free key, and the identifiable combinations."""
    count, seen = len(question.keys), around.seen
    scales = around.whole.unknowns.scales[:count]
    keyed, fitted = question.keyed, around.fitted
    before = keyed.values()
    estimates, errors = before.copy(), np.full(count, np.nan)
    halves, given = np.full((2, count), np.inf), np.full((2, count), np.inf)
    values = dict(zip(fitted.problem.model.keyed.keys, fitted.key_values.tolist(), strict=True))
    for place, i in enumerate(chosen):
        estimates[i], scale = values[question.keys[i]], fitted.problem.unknowns.all[place].scale
        errors[i], halves[:, i] = known.errors[place] * scale, known.half_widths[:, place] * scale
        given[:, i] = known.given_tied[:, place] * scale
    around_it = (question, fitted, around.whole, around.line)
    lacking, found = refutation(fitted, agreed=search.agreed or search.starts == 1), list[Combination]()
    if lacking is None:
        found = combined(question, around.refits(), seen, chosen, given, progress)
    else:
        lacking += likely_cause(*around_it, is_refuted=True)
    fixed = frozenset(set(range(count)) - set(chosen))
    evidence = KeyEvidence(
        *(question.keys, before, estimates, errors, halves, keyed.bounds(question.bounds)),
        *(scales, seen, fixed, refuted(lacking, search)),
    )
    doubt = likely_cause(*around_it, is_refuted=False) if lacking is None else ""
    return [
        replace(key, reason=key.reason + doubt) if key.verdict == IDENTIFIED else key
        for key in key_verdicts(evidence, found)
    ], found
