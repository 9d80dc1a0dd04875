# SPDX-License-Identifier: Apache-2.0
"""The fit: robust least squares in stages, from the first part of the runs to the whole runs.

With wrong keys, a long simulated motion gets out of phase, and the cost has many local minima.  Over a first, short
part it has one; its solution is the start for the next, longer part.  Standard deviations are re-estimated between
rounds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.fit_runs import ColumnCurves, FitRun
from mech_twin.studies.identification.residuals import FitProblem, Weighting
from mech_twin.studies.identification.unknowns import (
    BEGIN,
    GAIN,
    KEY,
    ZERO,
    IdentificationQuestion,
    ModelRuns,
    Unknowns,
    unknowns_of,
)

HORIZONS = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)  # shares of the run, one stage each
NEAR = 0.3  # of a key's scale: standard deviation of its prior about the start of an early stage
FEWEST_STEPS = 60  # coupling steps of a stage, at least
EVALUATIONS, FEWEST = 30, 10
ROUNDS = 3  # of the last stage
SETTLED = 0.02  # relative change of a standard deviation between rounds that ends them
STAGE_ENDS = 1e-3  # relative change of cost or unknowns that ends an early stage
TRIED_BEGINS = 4000
BEGIN_SAMPLES = 200
FORETOLD = 0.03  # of the residuals' change in a step: with less prediction error, derivatives are updated only
FORETOLD_ROW = 0.01  # the same bound in standard deviations of a row
LOSS, LOSS_SCALE = "soft_l1", 3.0
LEAST_NOISE = 1e-6  # of a channel's standard deviation
NORMAL_MEDIAN = 0.6745

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Fitted:
    """Result of a fit.

    Attributes
    ----------
    x : ndarray
        Shape (unknowns,): unknowns in scales.
    cost : float
        Mean of the squared residuals, in standard deviations of the weighting.
    """

    problem: FitProblem
    x: Array
    comparison: Weighting
    cost: float

    @property
    def key_values(self) -> Array:
        """Values of the free keys."""
        return self.problem.unknowns.keys(self.x)


def problem_of(question: IdentificationQuestion, runs: Sequence[FitRun]) -> FitProblem:
    """Return the fit problem of a question's keys on runs."""
    keyed = question.keyed
    unknowns = unknowns_of(keyed, keyed.bounds(question.bounds), runs, question.longest_begin_s)
    priors = {key: prior for key, prior in question.priors.items() if key in keyed.keys}
    return FitProblem(ModelRuns(keyed, runs, question.longest_begin_s, question.cores), unknowns, priors)


def carried_over(fitted: Fitted, unknowns: Unknowns) -> Array:
    """Return the start vector of other unknowns, with the fitted values where they are the same."""
    found = {(u.kind, u.name, u.runs): fitted.x[i] * u.scale for i, u in enumerate(fitted.problem.unknowns.all)}
    pairs = zip(unknowns.all, unknowns.start, strict=True)
    return np.array([found.get((u.kind, u.name, u.runs), start * u.scale) / u.scale for u, start in pairs])


def quiet(_: str) -> None:
    """Discard progress."""


def stage_fit(problem: FitProblem, x: Array, share: float, progress: Progress = quiet) -> Fitted:
    """Return the fit of the first share of the runs; zeros and gains are initialised in closed form."""
    part = stage_part(problem, share, x)
    return rounds(part, with_offsets(part, x), progress, last=share == 1.0)


def refined(problem: FitProblem, x: Array, progress: Progress = quiet) -> Fitted:
    """Return the fit of the whole runs, started at the end of another fit."""
    return rounds(problem, x, progress, last=True)


def stage_shares(runs: Sequence[FitRun], step_s: float) -> list[float]:
    """Return the shares of the runs used in the stages, rising to 1; ``step_s`` is the coupling step."""
    longest = max(run.end_s - max(run.first_s, run.from_s) for run in runs)
    return [share for share in HORIZONS if share == 1.0 or share * longest >= FEWEST_STEPS * step_s]


def stage_part(problem: FitProblem, share: float, x: Array) -> FitProblem:
    """Return the problem on the first share of each run, with simulations of that length.

    For a share below 1, each key has a prior about its present value, since a short part determines few keys.
    """
    if share == 1.0:
        return problem
    unknowns = problem.unknowns
    keys = [(unknowns.all[i], float(x[i])) for i in unknowns.places(KEY)]
    near = {key.name: (value * key.scale, NEAR * key.scale) for key, value in keys}
    return problem.over([run.first_share(share) for run in problem.runs], near)


def rounds(problem: FitProblem, x: Array, progress: Progress, *, last: bool) -> Fitted:
    """Return the fit of a stage; in the last stage in rounds, until the standard deviations converge."""
    sigmas = noise_floors(problem.runs)
    low, high = problem.unknowns.bounds()
    fitted: Fitted | None = None
    for number in range(ROUNDS if last else 1):
        sigmas_now = np.maximum(sigmas, spreads(problem, x, problem.comparison(x, sigmas)))
        if fitted is not None and np.all(np.abs(sigmas_now / fitted.comparison.sigmas - 1.0) < SETTLED):
            break
        comparison = problem.comparison(x, sigmas_now)
        if not len(x):
            return _fitted(problem, x, comparison)
        followed = _Followed(problem, comparison)
        found = least_squares(
            followed.residuals,
            np.clip(x, low, high),
            followed.jacobian,
            bounds=(low, high),
            x_scale="jac",
            loss=LOSS,
            f_scale=LOSS_SCALE,
            max_nfev=EVALUATIONS if number == 0 else FEWEST,
            xtol=1e-9 if last else STAGE_ENDS,
            ftol=1e-7 if last else STAGE_ENDS,
            gtol=1e-9,
        )
        x = found.x
        progress(f"{problem.model.rolled_out} runs of the model")
        fitted = _fitted(problem, x, comparison)
    sigmas = np.maximum(sigmas, spreads(problem, x, problem.comparison(x, sigmas)))
    return _fitted(problem, x, problem.comparison(x, sigmas))


class _Followed:
    """Residuals, and derivatives updated from step to step as long as they predict the change of the residuals."""

    def __init__(self, problem: FitProblem, comparison: Weighting) -> None:
        self._problem, self._comparison, self._tried = problem, comparison, 0
        self._last: tuple[Array, Array, Array] | None = None

    def residuals(self, x: Array) -> Array:
        """Return the weighted residuals."""
        self._tried += 1
        return self._problem.residuals(x, self._comparison)

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives at a point, updated if the last step was predicted well, else recomputed."""
        rows, found = self._problem.residuals(x, self._comparison), None
        if self._last is not None and self._tried == 1:
            from_x, from_rows, jacobian = self._last
            moved, changed = x - from_x, rows - from_rows
            off = float(np.linalg.norm(changed - jacobian @ moved))
            if off <= max(FORETOLD * float(np.linalg.norm(changed)), FORETOLD_ROW * np.sqrt(len(rows))):
                found = brought_on(jacobian, moved, changed)
        found = self._problem.jacobian(x, self._comparison) if found is None else found
        self._last, self._tried = (x.copy(), rows, found), 0
        return found


def robust_weights(rows: Array) -> Array:
    """Return the factors of residuals and derivatives with which least squares is the robust fit nearby."""
    return np.asarray((1.0 + (rows / LOSS_SCALE) ** 2) ** -0.25)


def brought_on(jacobian: Array, moved: Array, changed: Array) -> Array:
    """Return Broyden's update of derivatives, which reproduces the change of the residuals over a step.

    The norm of each column scales its unknown, so that the update does not depend on the unknowns' scales.
    """
    sizes = np.linalg.norm(jacobian, axis=0)
    step = moved * sizes**2
    length = float(moved @ step)
    return jacobian if length <= 0.0 else jacobian + np.outer(changed - jacobian @ moved, step / length)


def _fitted(problem: FitProblem, x: Array, comparison: Weighting) -> Fitted:
    rows = problem.residuals(x, comparison)
    return Fitted(problem, x, comparison, float(rows @ rows) / max(len(rows), 1))


def noise_floors(runs: Sequence[FitRun]) -> Array:
    """Return the least standard deviation of each channel over all runs: given noise, or a small share of its own."""
    found = []
    for place in range(len(runs[0].channels)):
        channels = [run.channels[place] for run in runs]
        size = max((float(np.std(each.values)) for each in channels), default=0.0) or 1.0
        known = [each.channel.sigma is not None and each.channel.sigma > 0.0 for each in channels]
        noise = min(each.noise for each in channels) if all(known) else 0.0
        found.append(max(noise, LEAST_NOISE * size))
    return np.array(found)


def spreads(problem: FitProblem, x: Array, comparison: Weighting) -> Array:
    """Return the robust standard deviation of each channel's residuals, SI units, at least a third of their rms."""
    parts, found = problem.parts(x), []
    for place in range(len(problem.runs[0].channels)):
        kept = [parts[run][place][comparison.masks[run][place]] for run in range(len(problem.runs))]
        off = np.concatenate(kept)
        off = off[np.isfinite(off)]
        if not len(off):
            found.append(0.0)
            continue
        rms = float(np.sqrt(np.mean(off**2)))
        found.append(max(float(np.median(np.abs(off))) / NORMAL_MEDIAN, rms / 3.0))
    return np.array(found)


def with_offsets(problem: FitProblem, x: Array) -> Array:
    """Return the unknowns with the best-fitting zeros and gains for these keys, by channel in closed form."""
    x = x.copy()
    unknowns = problem.unknowns
    for i, unknown in enumerate(unknowns.all):
        if unknown.kind not in (ZERO, GAIN):
            continue
        gain = unknowns.of_channel(GAIN, unknown.runs[0], unknown.place)
        if unknown.kind == GAIN and unknowns.of_channel(ZERO, unknown.runs[0], unknown.place) is not None:
            continue  # estimated together with the zero
        measured, column = _paired(problem, x, unknown.runs, unknown.place)
        if not len(measured):
            continue
        if unknown.kind == ZERO and gain is None:
            x[i] = float(np.median(measured - column)) / unknown.scale
        elif unknown.kind == GAIN:
            x[i] = float(measured @ column) / max(float(column @ column), 1e-300)
        else:
            slope, offset = np.polyfit(column, measured, 1) if np.ptp(column) > 0.0 else (1.0, 0.0)
            x[i], x[gain] = offset / unknown.scale, slope
    return x


def _paired(problem: FitProblem, x: Array, runs: Sequence[int], place: int) -> tuple[Array, Array]:
    """Return measured values of a channel and the model's values at the same samples, over runs."""
    plain = x.copy()
    for i, unknown in enumerate(problem.unknowns.all):
        if unknown.place == place and unknown.kind in (ZERO, GAIN):
            plain[i] = 1.0 if unknown.kind == GAIN else 0.0
    comparison, parts = problem.comparison(x, noise_floors(problem.runs)), problem.parts(plain)
    measured, column = [], []
    for run in runs:
        mask = comparison.masks[run][place] & np.isfinite(parts[run][place])
        values = problem.runs[run].channels[place].values[mask]
        measured.append(values)
        column.append(values - parts[run][place][mask])
    return np.concatenate(measured), np.concatenate(column)


def with_begins(problem: FitProblem, x: Array) -> Array:
    """Return the unknowns with the start time of each run that fits the simulation best."""
    x, places = x.copy(), problem.unknowns.places(BEGIN).tolist()
    curves = problem.model.at(problem.unknowns.keys(x)) if places else None
    if curves is None:
        return x
    for i in places:
        unknown = problem.unknowns.all[i]
        tried = np.linspace(unknown.low, unknown.high, TRIED_BEGINS)
        cost = _begin_costs(problem.runs[unknown.runs[0]], curves[unknown.runs[0]], tried)
        x[i] = tried[int(np.argmin(cost))] / unknown.scale
    return x


def _begin_costs(run: FitRun, curves: ColumnCurves, begins_s: Array) -> Array:
    """Return the mean absolute residual for each start time, over the standard deviations of the channels."""
    cost = np.zeros(len(begins_s))
    for channel in run.channels:
        if channel.of_events:
            continue
        counts = np.flatnonzero(channel.times_s <= run.until_s)
        counts = counts[:: max(1, len(counts) // BEGIN_SAMPLES)][:BEGIN_SAMPLES]
        size = float(np.std(channel.values)) or 1.0
        zero_open = isinstance(channel.channel.zero, str)
        for j, begin in enumerate(begins_s.tolist()):
            off = channel.values[counts] - curves.at(channel.name, channel.times_s[counts] + begin)
            if channel.turns:
                around = np.angle(np.mean(np.exp(1j * off))) if zero_open else 0.0
                cost[j] += float(np.mean(np.abs(np.angle(np.exp(1j * (off - around))))))
            else:
                cost[j] += float(np.mean(np.abs(off - off.mean() if zero_open else off))) / size
    return cost
