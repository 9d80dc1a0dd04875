# SPDX-License-Identifier: Apache-2.0
"""What a fit knows of all free keys: derivatives where it ended, intervals, and the evidence for a verdict on each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.channel_fits import refutation
from mech_twin.studies.identification.combinations import Combination, Family, Sensitivity, combinations, sensitivity
from mech_twin.studies.identification.fit_setting import FitSetting, problem_of, profiles_spread
from mech_twin.studies.identification.intervals import (
    Linearised,
    Uncertainty,
    last_step,
    linearised,
    moved_by_fixed,
    uncertainty,
)
from mech_twin.studies.identification.key_dependence import family
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration, unit_at
from mech_twin.studies.identification.least_squares_fit import Fitted, Progress, noise_floors, quiet, refined, spreads
from mech_twin.studies.identification.profile_likelihood import Profile, Walk, no_profile, profiled
from mech_twin.studies.identification.question import IdentificationQuestion
from mech_twin.studies.identification.residuals import FitProblem
from mech_twin.studies.identification.staged_search import Search
from mech_twin.studies.identification.unknowns import BEGIN, GAIN, KEY, LAG, ZERO, Unknowns
from mech_twin.studies.identification.verdicts import KeyEvidence, KeyVerdict, key_verdicts, refuted

LARGEST_ERROR = 0.5  # half width over the size of a key: of a combination that is stated
REFITS = 2  # where a step or a profile shows that the fit had not ended
FARTHEST = 1.0  # logarithm by which a key may move where another goes back to what is configured
PREDICTABLE = (0.5, 0.25, 0.12)  # shares of the runs, where derivatives over the whole contradict each other
OFFSET = 0.1  # of a half width: a step left over that is longer


@dataclass(frozen=True)
class AroundFit:
    """A fit of some of the free keys, and derivatives by all of them where it ended."""

    fitted: Fitted
    whole: FitProblem
    line: Linearised
    seen: Sensitivity

    @property
    def x(self) -> Array:
        """What was found, as unknowns of the whole."""
        return carried_over(self.fitted, self.whole.unknowns)

    def with_all_of(self, chosen: Sequence[int]) -> AroundFit:
        """Return the same where the runs speak against leaving any of these keys out."""
        return replace(self, seen=self.seen.with_all_of(chosen))


def sensitivity_at(problem: FitProblem, x: Array) -> Sensitivity:
    """Return how the channels see the keys before anything is fitted."""
    floors = noise_floors(problem.runs)
    sigmas = np.maximum(floors, spreads(problem, x, problem.comparison(x, floors)))
    return _sensitivity(Fitted(problem, x, problem.comparison(x, sigmas), 0.0))[0]


def _sensitivity(fitted: Fitted) -> tuple[Sensitivity, Linearised]:
    line = linearised(fitted)
    places = fitted.problem.unknowns.places(KEY)
    return sensitivity(line.jacobian, line.other, places, fitted.x[places]), line


def carried_over(fitted: Fitted, unknowns: Unknowns) -> Array:
    """Return the start of other unknowns, with what a fit found of them."""
    found = {(u.kind, u.name, u.runs): fitted.x[i] * u.scale for i, u in enumerate(fitted.problem.unknowns.all)}
    pairs = zip(unknowns.all, unknowns.start, strict=True)
    return np.array([found.get((u.kind, u.name, u.runs), start * u.scale) / u.scale for u, start in pairs])


def around_fit(question: IdentificationQuestion, fitted: Fitted) -> AroundFit:
    """Return derivatives by all free keys where the fit of some of them ended."""
    base = fitted.problem.model.keyed.parameters(fitted.key_values)
    keyed = KeyedConfiguration(question.machine, base, question.keys)
    whole = problem_of(question, keyed, fitted.problem.runs)
    x = carried_over(fitted, whole.unknowns)
    seen, line = _sensitivity(Fitted(whole, x, fitted.comparison, fitted.cost))
    return AroundFit(fitted, whole, line, seen)


def predictable(question: IdentificationQuestion, around: AroundFit, progress: Progress = quiet) -> AroundFit:
    """Return the fit of the longest first share of the runs over which derivatives tell where the keys lead.

    A motion that forgets nothing of its beginning makes a small error of a key large.  The later part of a run then has
    a valley narrower than any difference, and derivatives there say nothing of a key's interval.
    """
    problem, here = around.fitted.problem, around
    for share in PREDICTABLE if around.seen.contradicted else ():
        progress(f"first {100.0 * share:.0f} % of the runs alone")
        runs = [
            run.within(run.from_s, run.first_s + share * (min(run.last_s, run.until_s) - run.first_s))
            for run in problem.runs
        ]
        here = around_fit(question, refined(problem.over(runs), around.fitted.x, progress))
        if not here.seen.contradicted:
            return here
    return around


def with_fixed_as_configured(question: IdentificationQuestion, around: AroundFit, chosen: Sequence[int]) -> Array:
    """Return values of all free keys that fit as well, those that are to be fixed as configured, shape (keys,).

    Along a direction that the channels do not see, the fit does not change: on it the fixed keys go back.
    """
    keyed = KeyedConfiguration(question.machine, question.base, question.keys)
    before, values = keyed.values(), around.whole.unknowns.keys(around.whole.unknowns.start)
    logs = np.log(np.where(before * values > 0.0, before / np.where(values == 0.0, 1.0, values), 1.0))
    sizes = np.linalg.norm(around.seen.jacobian, axis=0)
    directions = around.seen.unseen / np.where(sizes > 0.0, sizes, np.inf)[:, None]
    fixed = np.setdiff1d(np.arange(len(values)), np.array(chosen, dtype=np.intp))
    along, *_ = np.linalg.lstsq(directions[fixed], logs[fixed], rcond=None)
    moved = values * np.exp(np.clip(directions @ along, -FARTHEST, FARTHEST))
    return np.asarray(
        np.clip(np.where(np.isin(np.arange(len(values)), fixed), before, moved), *keyed.bounds(question.bounds))
    )


def settled(
    question: IdentificationQuestion, around: AroundFit, chosen: Sequence[int], progress: Progress = quiet
) -> tuple[AroundFit, Uncertainty]:
    """Return the fit where it truly ends, and what is known there of its unknowns.

    Parameters
    ----------
    question : IdentificationQuestion
        What is asked.
    around : AroundFit
        A fit and derivatives by all free keys.
    chosen : sequence of int
        Which of the free keys it estimates; the others it holds.
    progress : callable, optional
        Takes a line on the progress.
    """
    kept = np.concatenate([np.array(chosen, dtype=np.intp), around.whole.unknowns.places(BEGIN, ZERO, GAIN, LAG)])
    for left in reversed(range(REFITS + 1)):
        fitted = around.fitted
        own = around.line.of(kept).over(fitted.problem.unknowns.scales / around.whole.unknowns.scales[kept])
        known, left_over = uncertainty(own), _left_over(fitted, own)
        profile = _profile(question, fitted, own, progress)
        ended = profile.better is None and np.all(np.abs(left_over) <= OFFSET * known.half_widths[0])
        if ended or left == 0:
            break
        progress("the fit once more, from where it had not ended")
        x = fitted.x if profile.better is None else profile.better
        again = around_fit(question, refined(fitted.problem, x, progress))
        around = again.with_all_of(chosen) if around.seen.distinguished else again
    return around, _widened(known, own, around.seen, chosen, np.abs(left_over), profile)


def _profile(question: IdentificationQuestion, fitted: Fitted, own: Linearised, progress: Progress) -> Profile:
    if refutation(fitted) is not None:
        return no_profile(len(fitted.x))
    if question.scheduler is None:
        return profiled(fitted, own, progress)
    progress("profiles, on the cluster")
    setting = FitSetting(question, fitted.problem.model.keyed.keys, fitted.problem.runs)
    return profiles_spread(setting, fitted, own, question.scheduler)


def _left_over(fitted: Fitted, own: Linearised) -> Array:
    """Return the step that a fit has not taken; what stands at a bound takes none."""
    low, high = fitted.problem.unknowns.bounds()
    inside = np.flatnonzero((fitted.x > low) & (fitted.x < high))
    found = np.zeros(len(fitted.x))
    found[inside] = last_step(own.of(inside))
    return found


def _widened(
    known: Uncertainty, own: Linearised, seen: Sensitivity, chosen: Sequence[int], left_over: Array, profile: Profile
) -> Uncertainty:
    """Return intervals that hold what keys fixed, steps left over and profiles add to them."""
    ends = np.array([profile.lower, profile.upper])

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


def fixed_families(
    walk: Walk,
    seen: Sensitivity,
    names: Sequence[str],
    chosen: Sequence[int],
    bounds: Array,
    progress: Progress = quiet,
) -> list[Family]:
    """Return what fits as well where keys that are fixed move, for each group of keys that are tied together.

    Parameters
    ----------
    walk : Walk
        About the fit, its first unknowns the free keys.
    seen : Sensitivity
        How the channels see them.
    names : sequence of str
        Their names.
    chosen : sequence of int
        Those that are fitted.
    bounds : ndarray
        Shape (2, keys): what fixed keys may be.
    progress : callable, optional
        Takes a line on the progress.
    """
    count, found = len(names), []
    scales = walk.problem.unknowns.scales[:count]
    follows = ~np.isin(np.arange(len(walk.x)), np.setdiff1d(np.arange(count), np.array(chosen, dtype=np.intp)))
    for group in seen.groups():
        fixed, fitted = [i for i in group if i not in chosen], [i for i in group if i in chosen]
        if fixed and fitted:
            progress(f"what fits as well with other {', '.join(names[i] for i in fixed)}")
            met = family(walk, fixed, follows, bounds / scales)
            if met is not None:
                found.append(Family(tuple(fitted), tuple(fixed), met[:, :count] * scales))
    return found


def verdicts_of(
    question: IdentificationQuestion,
    around: AroundFit,
    chosen: Sequence[int],
    known: Uncertainty,
    search: Search,
    progress: Progress = quiet,
) -> tuple[list[KeyVerdict], list[Combination]]:
    """Return the verdict on each free key, and what is seen of keys that are not seen alone."""
    count, seen = len(question.keys), around.seen
    scales = around.whole.unknowns.scales[:count]
    keyed = KeyedConfiguration(question.machine, question.base, question.keys)
    before, fitted = keyed.values(), around.fitted
    estimates, errors = before.copy(), np.full(count, np.nan)
    halves, given = np.full((2, count), np.inf), np.full((2, count), np.inf)
    values = dict(zip(fitted.problem.model.keyed.keys, fitted.key_values.tolist(), strict=True))
    for place, i in enumerate(chosen):
        estimates[i], scale = values[question.keys[i]], fitted.problem.unknowns.all[place].scale
        errors[i], halves[:, i] = known.errors[place] * scale, known.half_widths[:, place] * scale
        given[:, i] = known.given_tied[:, place] * scale
    bounds, lacking, combined = keyed.bounds(question.bounds), refutation(fitted), []
    if lacking is None:
        walk = Walk(Fitted(around.whole, around.x, fitted.comparison, fitted.cost), around.line)
        families = fixed_families(walk, seen, question.keys, chosen, bounds, progress)
        units = [unit_at(type(question.base), key) for key in question.keys]
        combined = combinations(families, question.keys, units, given, LARGEST_ERROR)
    fixed = frozenset(set(range(count)) - set(chosen))
    evidence = KeyEvidence(
        *(question.keys, before, estimates, errors, halves, bounds),
        *(scales, seen, fixed, refuted(lacking, search)),
    )
    return key_verdicts(evidence, combined), combined
