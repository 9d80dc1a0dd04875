# SPDX-License-Identifier: Apache-2.0
"""Identification: estimates configuration keys from measured runs, each with an interval and a verdict.

The keys that the channels see are fitted.  At the fit, derivatives by all free keys tell which of them the runs
distinguish; those are fitted again, until their choice and their intervals settle.  Then each key gets its verdict, and
what was held out scores the result.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import StudyError
from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.causes import explained, likely_cause
from mech_twin.studies.identification.fit_problem import BEGIN, GAIN, KEY, LAG, ZERO, FitProblem, problem_of
from mech_twin.studies.identification.fit_quality import (
    ChannelFit,
    Fitted,
    Score,
    channel_fits,
    noise_misfit,
    refutation,
    score,
    weighted,
)
from mech_twin.studies.identification.fit_runs import FitRun
from mech_twin.studies.identification.intervals import (
    Linearised,
    Uncertainty,
    last_step,
    linearised,
    moved_by_fixed,
    uncertainty,
)
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion, unit_at
from mech_twin.studies.identification.refits import KeyProfile, Refits, family, key_profiles
from mech_twin.studies.identification.staged_fit import (
    BENDING,
    Progress,
    Search,
    carried_over,
    fixed_fit,
    quiet,
    refined,
    robust_weights,
    searched,
)
from mech_twin.studies.identification.verdicts import (
    COMBINATION,
    IDENTIFIED,
    ONE_SIDED,
    Combination,
    Family,
    KeyEvidence,
    KeyVerdict,
    Sensitivity,
    combinations,
    refuted,
    sensitivity,
)

WRITTEN = (IDENTIFIED, ONE_SIDED, COMBINATION)  # verdicts whose estimates go into the configuration
HOLD_OUT_SHARE = 0.2
WORSE = 1.2  # times the misfit: a worse fit with fewer keys is rejected
CHOICES = 3  # rounds of choosing the keys to estimate, each at the last fit
REFITS = 2  # at most, if a step or a profile shows that the fit had not converged
PREDICTABLE = (0.5, 0.25, 0.12)  # shares of the runs to try if derivatives over the whole runs are unreliable
NEEDED = "; but without it the others do not explain the runs"
OFFSET = 0.1  # of a half width: with a longer next step, the fit has not converged


@dataclass(frozen=True)
class Identification:
    """Result of an identification.

    Attributes
    ----------
    parameters : Parameters
        Resulting configuration: keys that are identified, one-sided, or part of an identified combination are changed,
        and fitted ones that these need to explain the runs; the others are as before.
    combinations : tuple of Combination
        Identifiable combinations of keys that are not identifiable alone.
    search : Search
        Number of starts, of local minima that they reached, and the margin of the best.
    held_out, before : Score or None
        Scores on held-out data with the resulting and the previous configuration; a constant has a fit of 0.
    begins_s : dict of str to float
        Estimated start times, by run.
    correlation : ndarray
        Shape (fitted keys, fitted keys): correlation of the estimates, in the order of ``fitted_keys``.
    fitted : Fitted or None
        The final fit with its runs; None if this was read from a document, which holds no runs.
    """

    question: IdentificationQuestion
    parameters: Parameters
    keys: tuple[KeyVerdict, ...]
    combinations: tuple[Combination, ...]
    channels: tuple[ChannelFit, ...]
    search: Search
    held_out: Score | None
    before: Score | None
    begins_s: dict[str, float]
    fitted_keys: tuple[str, ...]
    correlation: Array
    model_runs: int
    seconds: float
    fitted: Fitted | None = None

    @property
    def better(self) -> bool:
        """Whether a key is identified, and held-out data is predicted better than before and than by a constant."""
        return not self.lack

    @property
    def lack(self) -> str:
        """Why the result is no better than the previous configuration; empty if it is."""
        if not any(key.verdict in WRITTEN for key in self.keys):
            return "no key is identified"
        if self.held_out is None or self.before is None or self.held_out.misfit < min(self.before.misfit, 1.0):
            return ""
        other = "before" if self.held_out.misfit >= self.before.misfit else "by a constant"
        return f"what was held out is predicted no better than {other}"

    @property
    def held_out_fits(self) -> tuple[tuple[str, float, float], ...]:
        """Each channel of the held-out data, its fit in percent with the resulting and the previous configuration."""
        scores = (each.channels if each is not None else () for each in (self.held_out, self.before))
        return tuple((one.channel, one.fit_percent, other.fit_percent) for one, other in zip(*scores, strict=True))


def identified(
    question: IdentificationQuestion,
    runs: Sequence[FitRun],
    held_runs: Sequence[FitRun] = (),
    share: float = 0.0,
    progress: Progress = quiet,
) -> Identification:
    """Fit keys of a configuration to runs and return estimates, intervals and verdicts.

    Parameters
    ----------
    held_runs : sequence of FitRun
        Held-out runs that score the fit.
    share : float
        Share at the end of each run that is held out to score the fit, if no whole run is.
    """
    began = time.monotonic()
    if not question.keys:
        raise StudyError("expected at least one free key")
    if not runs:
        raise StudyError("runs: expected at least one to fit")
    same_channels([*runs, *held_runs])
    fitted_runs, later = (list(runs), []) if held_runs or share <= 0.0 else _split(runs, share)
    chosen, best, search = _best_fit(question, fitted_runs, progress)
    around = predictable(question, around_fit(question, best), progress)
    around, chosen, known = _settled_choice(question, around, chosen, progress)
    fitted = around.fitted
    keys, combined = verdicts_of(question, around, chosen, known, search, progress)
    parameters, keys = _written(question, fitted, keys, chosen)
    progress("what was held out")
    held, before = _scores(question, parameters, fitted_runs, held_runs, later)
    return Identification(
        question,
        parameters,
        tuple(keys),
        tuple(combined),
        tuple(channel_fits(fitted)),
        search,
        held,
        before,
        {u.name: float(fitted.x[i] * u.scale) for i, u in enumerate(fitted.problem.unknowns.all) if u.kind == BEGIN},
        tuple(question.keys[i] for i in chosen),
        known.correlation(len(chosen)),
        fitted.problem.model.rolled_out,
        time.monotonic() - began,
        fitted,
    )


def same_channels(runs: Sequence[FitRun]) -> None:
    """Raise a StudyError unless all runs have the same channels."""
    names = [tuple(channel.name for channel in run.channels) for run in runs]
    for run, own in zip(runs, names, strict=True):
        if own != names[0]:
            raise StudyError(f"{run.path}: has the channels {', '.join(own)}; expected {', '.join(names[0])}")


def _split(runs: Sequence[FitRun], share: float) -> tuple[list[FitRun], list[FitRun]]:
    """Return the runs without the given share at their ends, and these ends."""
    first, rest = [], []
    for run in runs:
        border = run.last_s - share * (run.last_s - run.first_s)
        first.append(run.within(-np.inf, border))
        rest.append(run.within(border, np.inf))
    return first, rest


def _best_fit(
    question: IdentificationQuestion, runs: Sequence[FitRun], progress: Progress
) -> tuple[list[int], Fitted, Search]:
    """Return the indices of the keys that the channels see, their best fit, and a summary of its search."""
    everything, places = problem_of(question, runs), list(range(len(question.keys)))
    progress("which keys the channels see")
    chosen = sensitivity_at(everything, everything.unknowns.start).estimated(places)
    some = problem_of(question.of([question.keys[i] for i in chosen]), runs)
    found = searched(some, question.seed, progress, question.scheduler, explained)
    if len(chosen) < len(places) and refutation(found[0]) is not None:
        # the effect of a key at the start of the search may differ from that elsewhere
        with_all = searched(problem_of(question, runs), question.seed, progress, question.scheduler, explained)
        if noise_misfit(with_all[0]) < noise_misfit(found[0]):
            return places, *with_all
    return chosen, *found


def _settled_choice(
    question: IdentificationQuestion, around: AroundFit, chosen: list[int], progress: Progress
) -> tuple[AroundFit, list[int], Uncertainty]:
    """Return the converged fit of the keys that are distinguishable at its end, their indices, and its uncertainty."""
    places = list(range(len(question.keys)))
    for _ in range(CHOICES):
        again, wanted = around.seen.estimated(places), False
        if set(again) != set(chosen):
            fewer = _fit_of_fewer(question, around, again, progress)
            # a key is still needed if the fit without it is rejected
            wanted = refutation(fewer) is not None and noise_misfit(fewer) > WORSE * noise_misfit(around.fitted)
            if wanted:
                around = replace(around, seen=around.seen.with_all_of(chosen))
            else:
                # with one key fixed, the others may seem identifiable: it is not freed again
                places = [i for i in places if i in again or i not in chosen]
                chosen, around = again, around_fit(question, fewer)
        progress("intervals")
        around, known = converged_fit(question, around, chosen, progress)
        if wanted or set(around.seen.estimated(places)) == set(chosen):
            break
    return around, chosen, known


def _fit_of_fewer(
    question: IdentificationQuestion, around: AroundFit, chosen: Sequence[int], progress: Progress
) -> Fitted:
    """Return the fit of a subset of the keys, started from a point of equal quality.

    The keys that are no longer estimated are fixed as configured.
    """
    whole, problem = (
        around.whole,
        problem_of(question.of([question.keys[i] for i in chosen]), around.fitted.problem.runs),
    )
    fixed = [i for i in range(len(question.keys)) if i not in chosen]
    before = question.values() / whole.problem.unknowns.scales[: len(question.keys)]
    refits, follows = Refits(whole, around.line), ~np.isin(np.arange(len(whole.x)), fixed)
    equal = refits.with_held(fixed, before[fixed], follows, [refits.fit]).x
    start = carried_over(around.fitted, problem.unknowns)
    values = whole.problem.unknowns.keys(equal)[list(chosen)]
    start[problem.unknowns.places(KEY)] = values / problem.unknowns.scales[: len(chosen)]
    return refined(problem, start, progress)


@dataclass(frozen=True)
class AroundFit:
    """A fit of some of the free keys, the same point with all of them free (``whole``), and derivatives there."""

    fitted: Fitted
    whole: Fitted
    line: Linearised
    seen: Sensitivity

    @property
    def bends(self) -> bool:
        """Whether derivatives do not predict the effect of keys, since small errors of a key have grown large."""
        problem = self.fitted.problem
        return self.seen.contradicted or problem.curvature(self.fitted.x, self.fitted.comparison) > BENDING


def sensitivity_at(problem: FitProblem, x: Array) -> Sensitivity:
    """Return the sensitivity of the channels to the keys before anything is fitted."""
    comparison = weighted(problem, x).comparison
    weights = robust_weights(problem.residuals(x, comparison))
    jacobian = problem.jacobian(x, comparison) * weights[:, None]
    places = problem.unknowns.places(KEY)
    return sensitivity(jacobian, jacobian, places, x[places])


def around_fit(question: IdentificationQuestion, fitted: Fitted) -> AroundFit:
    """Return derivatives by all free keys at the end of a fit of some of them."""
    base = fitted.problem.question.parameters(fitted.key_values)
    problem = problem_of(replace(question, base=base), fitted.problem.runs)
    whole = Fitted(problem, carried_over(fitted, problem.unknowns), fitted.comparison)
    line, places = linearised(whole), problem.unknowns.places(KEY)
    return AroundFit(fitted, whole, line, sensitivity(line.jacobian, line.other, places, whole.x[places]))


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


def converged_fit(
    question: IdentificationQuestion, around: AroundFit, chosen: Sequence[int], progress: Progress = quiet
) -> tuple[AroundFit, Uncertainty]:
    """Return the converged fit, and the uncertainty of its unknowns.

    Parameters
    ----------
    chosen : sequence of int
        Indices of the free keys that it estimates; the others are fixed.
    """
    unknowns = around.whole.problem.unknowns
    kept = np.concatenate([np.array(chosen, dtype=np.intp), unknowns.places(BEGIN, ZERO, GAIN, LAG)])
    for left in reversed(range(REFITS + 1)):
        fitted = around.fitted
        own = around.line.of(kept).over(fitted.problem.unknowns.scales / around.whole.problem.unknowns.scales[kept])
        known, left_over = uncertainty(own), _left_over(fitted, own)
        profiles = [] if refutation(fitted) is not None else key_profiles(fitted, own, progress, question.scheduler)
        better = max(profiles, key=lambda each: each.won, default=None)
        x = fitted.x if better is None or better.better is None else better.better
        ended = x is fitted.x and np.all(np.abs(left_over) <= OFFSET * known.half_widths[0])
        if ended or left == 0:
            break
        progress("the fit once more, from where it had not ended")
        again = around_fit(question, refined(fitted.problem, x, progress))
        around = again if not around.seen.distinguished else replace(again, seen=again.seen.with_all_of(chosen))
    return around, _widened(known, own, around.seen, chosen, np.abs(left_over), profiles)


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
    bounds = question.search_range() / scales
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
    scales = around.whole.problem.unknowns.scales[:count]
    fitted, before = around.fitted, question.values()
    estimates, errors = before.copy(), np.full(count, np.nan)
    halves, given = np.full((2, count), np.inf), np.full((2, count), np.inf)
    own, places = slice(len(chosen)), list(chosen)
    sizes = fitted.problem.unknowns.scales[own]
    estimates[places], errors[places] = fitted.key_values, known.errors[own] * sizes
    halves[:, places], given[:, places] = known.half_widths[:, own] * sizes, known.given_tied[:, own] * sizes
    around_it = (fitted, around.whole, around.line)
    lacking, cause, found = refutation(fitted, agreed=search.agreed or search.starts == 1), "", list[Combination]()
    if lacking is None:
        found = combined(question, Refits(around.whole, around.line), seen, chosen, given, progress)
    else:
        cause = likely_cause(*around_it, is_refuted=True)
    fixed = frozenset(set(range(count)) - set(chosen))
    evidence = KeyEvidence(
        *(question.keys, before, estimates, errors, halves, question.search_range()),
        *(scales, seen, fixed, refuted(lacking, search, cause), found),
    )
    doubt = likely_cause(*around_it, is_refuted=False) if lacking is None else ""
    return [
        replace(key, reason=key.reason + doubt) if key.verdict == IDENTIFIED else key for key in evidence.verdicts()
    ], found


def _written(
    question: IdentificationQuestion, fitted: Fitted, keys: Sequence[KeyVerdict], chosen: Sequence[int]
) -> tuple[Parameters, list[KeyVerdict]]:
    """Return the resulting configuration, and the keys with their final reasons.

    Keys that are not seen keep their values.  Fitted ones do so unless the others, which were fitted beside them, do
    not explain the runs without them.
    """

    def with_values(values: Mapping[str, float]) -> Parameters:
        return question.of(values).parameters(list(values.values())) if values else question.base

    values = {key.key: key.estimate for key in keys if key.verdict in WRITTEN}
    beside = {keys[i].key: keys[i].estimate for i in chosen if keys[i].verdict not in WRITTEN}
    if values and beside and refutation(fitted) is None:
        without = fixed_fit(question, with_values(values), fitted.problem.runs)
        if refutation(without) is not None:
            values |= beside
            keys = [replace(k, reason=k.reason + NEEDED) if k.key in beside else k for k in keys]
    return with_values(values), list(keys)


def _scores(
    question: IdentificationQuestion,
    parameters: Parameters,
    fitted_runs: Sequence[FitRun],
    held_runs: Sequence[FitRun],
    later: Sequence[FitRun],
) -> tuple[Score | None, Score | None]:
    if not held_runs and not later:
        return None, None
    known_from, held = (held_runs, held_runs) if held_runs else (fitted_runs, later)
    fixed = [fixed_fit(question, each, known_from) for each in (parameters, question.base)]
    after, before = (score(fitted.over(held)) for fitted in fixed)
    return after, before
