# SPDX-License-Identifier: Apache-2.0
"""Identification: from measured runs to keys of a configuration, each with an interval and a verdict."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from mech_twin.capabilities.errors import StudyError
from mech_twin.measurements.blocks import Array
from mech_twin.quantity import Parameters
from mech_twin.studies.identification.channel_fits import ChannelFit, channel_fits, model_error
from mech_twin.studies.identification.combinations import Combination, Sight, base_keys, combinations, sight
from mech_twin.studies.identification.fit_runs import FitRun
from mech_twin.studies.identification.held_out import Score, score, scored
from mech_twin.studies.identification.intervals import NORMAL, Linearised, Uncertainty, linearised, uncertainty
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration
from mech_twin.studies.identification.least_squares_fit import Fitted, Told, noise_floors, quiet, solved, spreads
from mech_twin.studies.identification.model_runs import ModelRuns
from mech_twin.studies.identification.residuals import FitProblem
from mech_twin.studies.identification.unknowns import BEGIN, GAIN, KEY, LAG, ZERO, Unknowns, unknowns_of
from mech_twin.studies.identification.verdicts import (
    COMBINATION,
    IDENTIFIED,
    KeyEvidence,
    KeyVerdict,
    key_verdicts,
)

HOLD_OUT_SHARE = 0.2
FEWEST_RUNS_TO_HOLD_OUT = 3
STARTS = 3  # where the first one ends in an error of the model
START_SPREAD = 0.15  # standard deviation of a further start about the first, over the scale of a key
LARGEST_LOG_ERROR = 0.25  # of a combination that is told


@dataclass(frozen=True)
class IdentificationQuestion:
    """What is asked of a fit.

    Attributes
    ----------
    machine : str
        Machine of the catalogue.
    base : Parameters
        Configuration to start from; keys that are not found keep its values.
    keys : tuple of str
        Keys that may change.
    bounds : mapping
        Least and largest value of some of them.
    priors : mapping
        Mean and standard deviation of some of them.
    longest_begin_s : float
        Latest beginning of a run of unknown beginning, in the machine's own run.
    seed : int
        Of further starts.
    cores : int, optional
        Threads; all cores if absent.
    """

    machine: str
    base: Parameters
    keys: tuple[str, ...]
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    longest_begin_s: float = 0.0
    seed: int = 0
    cores: int | None = None


@dataclass(frozen=True)
class Identification:
    """What was found.

    Attributes
    ----------
    question : IdentificationQuestion
        What was asked.
    parameters : Parameters
        The configuration found: keys identified, or carrying a combination that is, changed; the others as before.
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
    everything = _problem(question, KeyedConfiguration(question.machine, question.base, question.keys), fitted_runs)
    told("which keys the channels see")
    chosen = _chosen(_sight_at(everything, everything.unknowns.start)[0], range(len(question.keys)))
    fitted = _best_fit(question, [question.keys[i] for i in chosen], fitted_runs, told)
    whole, line, seen = _over_all_keys(question, fitted, fitted_runs)
    again = _chosen(seen, range(len(question.keys)))
    if set(again) != set(chosen):
        chosen = again
        fitted = _best_fit(question, [question.keys[i] for i in chosen], fitted_runs, told, fitted)
        whole, line, seen = _over_all_keys(question, fitted, fitted_runs)
    told("intervals")
    kept = np.concatenate([np.array(chosen, dtype=np.intp), _not_keys(whole.unknowns)])
    known = uncertainty(line.of(kept))
    problem_error = model_error(fitted)
    keys, combined = _told(question, whole, seen, chosen, known, line, fitted, problem_error)
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


def _problem(question: IdentificationQuestion, keyed: KeyedConfiguration, runs: Sequence[FitRun]) -> FitProblem:
    bounds = keyed.bounds(question.bounds)
    unknowns = unknowns_of(keyed, bounds, runs, question.longest_begin_s)
    priors = {key: prior for key, prior in question.priors.items() if key in keyed.keys}
    return FitProblem(ModelRuns(keyed, runs, question.longest_begin_s, question.cores), unknowns, priors)


def _not_keys(unknowns: Unknowns) -> npt.NDArray[np.intp]:
    return unknowns.places(BEGIN, ZERO, GAIN, LAG)


def _sight_at(problem: FitProblem, x: Array) -> tuple[Sight, Linearised]:
    floors = noise_floors(problem.runs)
    sigmas = np.maximum(floors, spreads(problem, x, problem.comparison(x, floors)))
    return _sight(Fitted(problem, x, problem.comparison(x, sigmas), 0.0))


def _sight(fitted: Fitted) -> tuple[Sight, Linearised]:
    line = linearised(fitted)
    unknowns = fitted.problem.unknowns
    places = unknowns.places(KEY)
    return sight(line.jacobian, line.other, places, fitted.x[places]), line


def _chosen(seen: Sight, places: Sequence[int]) -> list[int]:
    """Return the keys to estimate: those that have an effect, less those that only repeat the effect of others."""
    return base_keys(seen, [i for i in places if seen.effects[i] >= seen.least_effects[i] and seen.left[i] > 0.0])


def _best_fit(
    question: IdentificationQuestion,
    keys: Sequence[str],
    runs: Sequence[FitRun],
    told: Told,
    near: Fitted | None = None,
) -> Fitted:
    """Return the best fit of some of the keys; further starts where the first ends in an error of the model."""
    keyed = KeyedConfiguration(question.machine, question.base, tuple(keys))
    problem = _problem(question, keyed, runs)
    start = problem.unknowns.start.copy()
    if near is not None:
        start = _carried_over(near, problem.unknowns)
    best = solved(problem, start, told, whole_only=near is not None)
    random = np.random.default_rng(question.seed)
    low, high = problem.unknowns.bounds()
    places = problem.unknowns.places(KEY)
    for number in range(1, STARTS):
        if model_error(best) is None or near is not None:
            break
        told(f"start {number + 1} of {STARTS}")
        moved = start.copy()
        moved[places] += START_SPREAD * random.standard_normal(len(places))
        other = solved(problem, np.clip(moved, low, high), told)
        best = min(best, other, key=_misfit)
    return best


def _carried_over(fitted: Fitted, unknowns: Unknowns) -> Array:
    """Return the start of other unknowns, with what a fit found of them."""
    found = {(u.kind, u.name, u.runs): fitted.x[i] * u.scale for i, u in enumerate(fitted.problem.unknowns.all)}
    pairs = zip(unknowns.all, unknowns.start, strict=True)
    return np.array([found.get((u.kind, u.name, u.runs), start * u.scale) / u.scale for u, start in pairs])


def _misfit(fitted: Fitted) -> float:
    return score(fitted.problem, fitted.x).misfit


def _over_all_keys(
    question: IdentificationQuestion, fitted: Fitted, runs: Sequence[FitRun]
) -> tuple[FitProblem, Linearised, Sight]:
    """Return derivatives by all free keys where the fit of some of them ended."""
    keyed = fitted.problem.model.keyed
    base = keyed.parameters(fitted.key_values)
    whole = _problem(question, KeyedConfiguration(question.machine, base, question.keys), runs)
    x = _carried_over(fitted, whole.unknowns)
    seen, line = _sight(Fitted(whole, x, fitted.comparison, fitted.cost))
    return whole, line, seen


def _told(
    question: IdentificationQuestion,
    whole: FitProblem,
    seen: Sight,
    chosen: Sequence[int],
    known: Uncertainty,
    line: Linearised,
    fitted: Fitted,
    error: str | None,
) -> tuple[list[KeyVerdict], list[Combination]]:
    count = len(question.keys)
    scales = whole.unknowns.scales[:count]
    before = KeyedConfiguration(question.machine, question.base, question.keys).values()
    estimates, errors, halves = before.copy(), np.full(count, np.nan), np.full(count, np.inf)
    values = dict(zip(fitted.problem.model.keyed.keys, fitted.key_values.tolist(), strict=True))
    for place, i in enumerate(chosen):
        estimates[i] = values[question.keys[i]]
        errors[i], halves[i] = known.errors[place] * scales[i], known.half_widths[place] * scales[i]
    freedom = max(len(line.residuals) - line.jacobian.shape[1], 1)
    spread = float(np.sqrt(line.residuals @ line.residuals / freedom))
    combined = combinations(seen, question.keys, estimates, LARGEST_LOG_ERROR, NORMAL * spread * known.widening)
    bounds = KeyedConfiguration(question.machine, question.base, question.keys).bounds(question.bounds)
    evidence = KeyEvidence(
        question.keys,
        before,
        estimates,
        errors,
        halves,
        bounds,
        scales,
        seen,
        frozenset(set(range(count)) - set(chosen)),
        error,
    )
    return key_verdicts(evidence, combined), combined


def _found(question: IdentificationQuestion, keys: Sequence[KeyVerdict], fitted: Fitted) -> Parameters:
    """Return the configuration found: keys that are neither identified nor carry a combination stay as they were."""
    values = {key.key: key.estimate for key in keys if key.verdict in (IDENTIFIED, COMBINATION)}
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
