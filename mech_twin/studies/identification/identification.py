# SPDX-License-Identifier: Apache-2.0
"""Identification: estimates configuration keys from measured runs, each with an interval and a verdict."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import StudyError
from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.fit_runs import FitRun
from mech_twin.studies.identification.held_out import (
    ChannelFit,
    Score,
    beside,
    channel_fits,
    noise_misfit,
    refutation,
    score,
)
from mech_twin.studies.identification.key_knowledge import (
    AroundFit,
    around_fit,
    predictable,
    sensitivity_at,
    settled,
    verdicts_of,
    with_others_as_configured,
)
from mech_twin.studies.identification.least_squares_fit import (
    Fitted,
    Progress,
    carried_over,
    problem_of,
    quiet,
    refined,
)
from mech_twin.studies.identification.refits import fits_spread
from mech_twin.studies.identification.staged_search import Search, searched
from mech_twin.studies.identification.unknowns import BEGIN, KEY, IdentificationQuestion
from mech_twin.studies.identification.verdicts import COMBINATION, IDENTIFIED, ONE_SIDED, Combination, KeyVerdict

WRITTEN = (IDENTIFIED, ONE_SIDED, COMBINATION)  # verdicts whose estimates go into the configuration
HOLD_OUT_SHARE = 0.2
WORSE = 1.2  # times the misfit: a worse fit with fewer keys is rejected
CHOICES = 3  # rounds of choosing the keys to estimate, each at the last fit


@dataclass(frozen=True)
class Identification:
    """Result of an identification.

    Attributes
    ----------
    parameters : Parameters
        Resulting configuration: keys that are identified, one-sided, or part of an identified combination are changed;
        the others are as before.
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
    same_channels([*runs, *held_runs])
    fitted_runs, later = (list(runs), []) if held_runs or share <= 0.0 else _split(runs, share)
    everything = problem_of(question, fitted_runs)
    progress("which keys the channels see")
    places = list(range(len(question.keys)))
    chosen = sensitivity_at(everything, everything.unknowns.start).estimated(places)
    fitted, search = _best_fit(question.of([question.keys[i] for i in chosen]), fitted_runs, progress)
    if len(chosen) < len(places) and refutation(fitted) is not None:
        # the effect of a key at the start of the search may differ from that elsewhere
        with_all = _best_fit(question, fitted_runs, progress)
        if noise_misfit(with_all[0]) < noise_misfit(fitted):
            (fitted, search), chosen = with_all, places
    around = predictable(question, around_fit(question, fitted), progress)
    for _ in range(CHOICES):
        again, wanted = around.seen.estimated(places), False
        if set(again) != set(chosen):
            fewer = _fit_of_fewer(question, around, again, progress)
            # a key is still needed if the fit without it is rejected
            wanted = refutation(fewer) is not None and noise_misfit(fewer) > WORSE * noise_misfit(around.fitted)
            if not wanted:
                # with one key fixed, the others may seem identifiable: it is not freed again
                places = [i for i in places if i in again or i not in chosen]
                chosen, around = again, around_fit(question, fewer)
        if wanted:
            around = around.with_all_of(chosen)
        progress("intervals")
        around, known = settled(question, around, chosen, progress)
        if wanted or set(around.seen.estimated(places)) == set(chosen):
            break
    fitted = around.fitted
    keys, combined = verdicts_of(question, around, chosen, known, search, progress)
    values = {key.key: key.estimate for key in keys if key.verdict in WRITTEN}  # the others keep their values
    parameters = question.of(values).keyed.parameters(list(values.values())) if values else question.base
    progress("what was held out")
    held, before = _scores(question, parameters, fitted_runs, held_runs, later)
    count = len(chosen)
    deviations = np.sqrt(np.diag(known.covariance)[:count])
    sizes = np.outer(deviations, deviations)
    correlation = known.covariance[:count, :count] / np.where(sizes > 0.0, sizes, np.inf)
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
        correlation,
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


def _best_fit(question: IdentificationQuestion, runs: Sequence[FitRun], progress: Progress) -> tuple[Fitted, Search]:
    """Return the best fit, and a summary of its search."""
    problem = problem_of(question, runs)
    fits = None if question.scheduler is None else partial(fits_spread, question, runs)
    return searched(problem, problem.unknowns.start.copy(), question.seed, progress, fits)


def _fit_of_fewer(
    question: IdentificationQuestion, around: AroundFit, chosen: Sequence[int], progress: Progress
) -> Fitted:
    """Return the fit of a subset of the keys, started from a point of equal quality.

    The keys that are no longer estimated are fixed as configured.
    """
    problem = problem_of(question.of([question.keys[i] for i in chosen]), around.whole.runs)
    values = with_others_as_configured(question, around, chosen)
    start = carried_over(around.fitted, problem.unknowns)
    start[problem.unknowns.places(KEY)] = values / problem.unknowns.scales[: len(chosen)]
    return refined(problem, start, progress)


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
    fixed = [beside(question, each, known_from) for each in (parameters, question.base)]
    after, before = (score(problem.over(held), x) for problem, x in fixed)
    return after, before
