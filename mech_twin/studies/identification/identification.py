# SPDX-License-Identifier: Apache-2.0
"""Identification: from measured runs to keys of a configuration, each with an interval and a verdict."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mech_twin.capabilities.errors import StudyError
from mech_twin.measurements.blocks import Array
from mech_twin.quantity import Parameters
from mech_twin.studies.identification.channel_fits import ChannelFit, channel_fits, model_error
from mech_twin.studies.identification.combinations import Combination, Sight, base_keys
from mech_twin.studies.identification.fit_runs import FitRun
from mech_twin.studies.identification.fit_setting import FitSetting, fits_from, problem_of
from mech_twin.studies.identification.held_out import Score, score, scored
from mech_twin.studies.identification.key_knowledge import (
    AroundFit,
    around_fit,
    carried_over,
    settled,
    sight_at,
    verdicts_of,
    with_held_as_configured,
)
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration
from mech_twin.studies.identification.least_squares_fit import Fitted, Told, quiet, refined, solved
from mech_twin.studies.identification.question import IdentificationQuestion
from mech_twin.studies.identification.residuals import FitProblem
from mech_twin.studies.identification.unknowns import BEGIN, KEY
from mech_twin.studies.identification.verdicts import COMBINATION, IDENTIFIED, ONE_SIDED, KeyVerdict

WRITTEN = (IDENTIFIED, ONE_SIDED, COMBINATION)  # verdicts whose estimates go into the configuration
HOLD_OUT_SHARE = 0.2
FEWEST_RUNS_TO_HOLD_OUT = 3
CHOICES = 3  # of the keys to estimate, made again where the fit ended
STARTS = 3  # where the first one ends in residuals that are not those of the sensors
SMALL_MISFIT = 1e-3  # of the size of a channel: no error of the model, but perhaps of the fit
START_SPREAD = 0.15  # standard deviation of a further start about the first, over the scale of a key


@dataclass(frozen=True)
class Identification:
    """What was found.

    Attributes
    ----------
    question : IdentificationQuestion
        What was asked.
    parameters : Parameters
        The configuration found: keys identified, bounded to one side, or carrying a combination that is, changed; the
        others as before.
    keys : tuple of KeyVerdict
        The keys that were free.
    combinations : tuple of Combination
        What is seen of keys that are not seen alone.
    channels : tuple of ChannelFit
        Over the fitted runs.
    held_out, before : Score or None
        On what the fit never saw, with the configuration found and with the one before; a constant has a fit of 0.
    begins_s : dict of str to float
        Beginnings that were found, by run.
    correlation : ndarray
        Shape (fitted keys, fitted keys), in the order of ``fitted_keys``.
    seconds : float
        Time it took.
    """

    question: IdentificationQuestion
    parameters: Parameters
    keys: tuple[KeyVerdict, ...]
    combinations: tuple[Combination, ...]
    channels: tuple[ChannelFit, ...]
    held_out: Score | None
    before: Score | None
    begins_s: dict[str, float]
    fitted_keys: tuple[str, ...]
    correlation: Array
    model_runs: int
    seconds: float
    fitted: Fitted

    @property
    def better(self) -> bool:
        """Whether what was held out is foretold better than before, and than by a constant."""
        if self.held_out is None or self.before is None:
            return True
        return self.held_out.misfit < min(self.before.misfit, 1.0)


def identified(
    question: IdentificationQuestion,
    runs: Sequence[FitRun],
    held_runs: Sequence[FitRun] = (),
    share: float = 0.0,
    told: Told = quiet,
) -> Identification:
    """Fit keys of a configuration to runs and return what may be said of them.

    Parameters
    ----------
    question : IdentificationQuestion
        What is asked.
    runs : sequence of FitRun
        Runs to fit.
    held_runs : sequence of FitRun
        Runs that score the fit.
    share : float
        Share at the end of each fitted run that is not fitted and scores the fit, where no run is held out.
    told : callable, optional
        Takes a line on the progress.
    """
    began = time.monotonic()
    if not question.keys:
        raise StudyError("expected at least one free key")
    same_channels([*runs, *held_runs])
    fitted_runs, later = (list(runs), []) if held_runs or share <= 0.0 else _split(runs, share)
    everything = problem_of(question, KeyedConfiguration(question.machine, question.base, question.keys), fitted_runs)
    told("which keys the channels see")
    places = list(range(len(question.keys)))
    chosen = _chosen(sight_at(everything, everything.unknowns.start), places)
    fitted = _best_fit(question, [question.keys[i] for i in chosen], fitted_runs, told)
    around = around_fit(question, fitted)
    for _ in range(CHOICES):
        again, wanted = _chosen(around.seen, places), False
        if set(again) != set(chosen):
            fewer = _fit_of_fewer(question, around, again, told)
            wanted = model_error(fewer) is not None and model_error(around.fitted) is None  # the key that is left out
            if not wanted:
                # where a key is held as configured the others may seem to be told: it is not taken up again
                places = [i for i in places if i in again or i not in chosen]
                chosen, around = again, around_fit(question, fewer)
        told("intervals")
        around, known = settled(question, around, chosen, told)
        if wanted or set(_chosen(around.seen, places)) == set(chosen):
            break
    fitted = around.fitted
    keys, combined = verdicts_of(question, around, chosen, known, told)
    parameters = _found(question, keys, fitted)
    told("what was held out")
    held, before = _scores(question, parameters, fitted, fitted_runs, held_runs, later)
    count = len(chosen)
    deviations = np.sqrt(np.diag(known.covariance)[:count])
    correlation = known.covariance[:count, :count] / np.outer(deviations, deviations) if count else np.zeros((0, 0))
    return Identification(
        question,
        parameters,
        tuple(keys),
        tuple(combined),
        tuple(channel_fits(fitted)),
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
    """Raise unless all runs have the same channels."""
    names = [tuple(channel.name for channel in run.channels) for run in runs]
    for run, own in zip(runs, names, strict=True):
        if own != names[0]:
            raise StudyError(f"{run.path}: has the channels {', '.join(own)}; expected {', '.join(names[0])}")


def _split(runs: Sequence[FitRun], share: float) -> tuple[list[FitRun], list[FitRun]]:
    """Return the runs without their last share, and that share."""
    first, rest = [], []
    for run in runs:
        border = run.last_s - share * (run.last_s - run.first_s)
        first.append(run.within(-np.inf, border))
        rest.append(run.within(border, np.inf))
    return first, rest


def _chosen(seen: Sight, places: Sequence[int]) -> list[int]:
    """Return the keys to estimate: those that have an effect, less those that only repeat the effect of others."""
    return base_keys(seen, [i for i in places if seen.effects[i] >= seen.least_effects[i] and seen.left[i] > 0.0])


def _best_fit(question: IdentificationQuestion, keys: Sequence[str], runs: Sequence[FitRun], told: Told) -> Fitted:
    """Return the best fit of some of the keys; further starts where the residuals of the first contradict the sensors.

    A fit that has ended beside its minimum, in a motion with impacts, may be off by less than an error of the model.
    """
    keyed = KeyedConfiguration(question.machine, question.base, tuple(keys))
    problem = problem_of(question, keyed, runs)
    start = problem.unknowns.start.copy()
    best = solved(problem, start, told)
    others = _further_starts(question, problem)
    if question.scheduler is not None and model_error(best, SMALL_MISFIT) is not None:
        told("further starts, on the cluster")
        setting = FitSetting(question, tuple(keys), tuple(runs))
        return min([best, *fits_from(setting, others, question.scheduler)], key=_misfit)
    for number, other in enumerate(others, 2):
        if model_error(best, SMALL_MISFIT) is None:
            break
        told(f"start {number} of {STARTS}")
        best = min(best, solved(problem, other, told), key=_misfit)
    return best


def _further_starts(question: IdentificationQuestion, problem: FitProblem) -> list[Array]:
    """Return other places to start from, about that of the configuration."""
    random = np.random.default_rng(question.seed)
    places, found = problem.unknowns.places(KEY), []
    for _ in range(1, STARTS):
        moved = problem.unknowns.start.copy()
        moved[places] += START_SPREAD * random.standard_normal(len(places))
        found.append(np.clip(moved, *problem.unknowns.bounds()))
    return found


def _fit_of_fewer(question: IdentificationQuestion, around: AroundFit, chosen: Sequence[int], told: Told) -> Fitted:
    """Return the fit of other keys than those of a fit, from a place that fits as well; from the start if it does not.

    The keys that are no longer estimated are held as configured.
    """
    names = tuple(question.keys[i] for i in chosen)
    problem = problem_of(question, KeyedConfiguration(question.machine, question.base, names), around.whole.runs)
    values = with_held_as_configured(question, around, chosen)
    start = carried_over(around.fitted, problem.unknowns)
    start[problem.unknowns.places(KEY)] = values[list(chosen)] / problem.unknowns.scales[: len(chosen)]
    found = refined(problem, start, told)
    if model_error(found) is None or model_error(around.fitted) is not None:
        return found
    return min(found, _best_fit(question, names, around.whole.runs, told), key=_misfit)


def _misfit(fitted: Fitted) -> float:
    return score(fitted.problem, fitted.x).misfit


def _found(question: IdentificationQuestion, keys: Sequence[KeyVerdict], fitted: Fitted) -> Parameters:
    """Return the configuration found: keys of which nothing is told stay as they were."""
    values = {key.key: key.estimate for key in keys if key.verdict in WRITTEN}
    keyed = KeyedConfiguration(question.machine, question.base, tuple(values))
    return keyed.parameters(list(values.values())) if values else question.base


def _scores(
    question: IdentificationQuestion,
    parameters: Parameters,
    fitted: Fitted,
    fitted_runs: Sequence[FitRun],
    held_runs: Sequence[FitRun],
    later: Sequence[FitRun],
) -> tuple[Score | None, Score | None]:
    if not held_runs and not later:
        return None, None
    known_from, held = (held_runs, held_runs) if held_runs else (fitted_runs, later)
    begin = question.longest_begin_s
    after, before = (scored(question.machine, p, known_from, held, begin) for p in (parameters, question.base))
    return after, before
