# SPDX-License-Identifier: Apache-2.0
"""Everything another process needs to rebuild a fit problem, and the computations distributed this way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.fit_runs import FitRun
from mech_twin.studies.identification.intervals import Linearised
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration
from mech_twin.studies.identification.least_squares_fit import Fitted, stage_fit, stage_part
from mech_twin.studies.identification.model_runs import ModelRuns
from mech_twin.studies.identification.question import IdentificationQuestion
from mech_twin.studies.identification.refits import KeyProfile, key_profile
from mech_twin.studies.identification.residuals import FitProblem, Weighting
from mech_twin.studies.identification.unknowns import KEY, unknowns_of
from mech_twin.studies.spreading import spread


@dataclass(frozen=True)
class FitSetting:
    """A question, the fitted subset of its keys, and the runs: plain values that can be pickled."""

    question: IdentificationQuestion
    keys: tuple[str, ...]
    runs: tuple[FitRun, ...]

    def problem(self) -> FitProblem:
        """Return the fit problem."""
        keyed = KeyedConfiguration(self.question.machine, self.question.base, self.keys)
        return problem_of(self.question, keyed, self.runs)


def problem_of(question: IdentificationQuestion, keyed: KeyedConfiguration, runs: Sequence[FitRun]) -> FitProblem:
    """Return the fit problem of runs with a subset of a question's keys."""
    bounds = keyed.bounds(question.bounds)
    unknowns = unknowns_of(keyed, bounds, runs, question.longest_begin_s)
    priors = {key: prior for key, prior in question.priors.items() if key in keyed.keys}
    return FitProblem(ModelRuns(keyed, runs, question.longest_begin_s, question.cores), unknowns, priors)


def fits_spread(setting: FitSetting, starts: Iterable[Array], share: float, *, scheduler: str) -> list[Fitted]:
    """Return the fits of a stage from several starts, each computed by a worker of a cluster."""
    one = partial(_stage, _alone(setting), share)
    found = sorted(spread(one, list(enumerate(starts)), 1, scheduler), key=lambda each: each[0])
    problem = setting.problem()
    return [Fitted(stage_part(problem, share, x), x, comparison, cost) for _, x, comparison, cost in found]


def _stage(setting: FitSetting, share: float, start: tuple[int, Array]) -> tuple[int, Array, Weighting, float]:
    place, x = start
    fitted = stage_fit(setting.problem(), x, share)
    return place, fitted.x, fitted.comparison, fitted.cost


def profiles_spread(setting: FitSetting, fitted: Fitted, found: Linearised, scheduler: str) -> list[KeyProfile]:
    """Return the profiles of the keys of a fit, each computed by a worker of a cluster."""
    places = list(map(int, fitted.problem.unknowns.places(KEY)))
    one = partial(_profile, _alone(setting), fitted.x, fitted.comparison, found)
    return sorted(spread(one, places, 1, scheduler), key=lambda each: each.place) if places else []


def _profile(setting: FitSetting, x: Array, comparison: Weighting, found: Linearised, place: int) -> KeyProfile:
    return key_profile(Fitted(setting.problem(), x, comparison, 0.0), found, place)


def _alone(setting: FitSetting) -> FitSetting:
    """Return a setting for a worker: one thread, and no scheduler of its own."""
    return replace(setting, question=replace(setting.question, cores=1, scheduler=None))
