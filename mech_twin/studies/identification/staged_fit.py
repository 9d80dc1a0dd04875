# SPDX-License-Identifier: Apache-2.0
"""The fit: robust least squares in stages, from the first part of the runs to the whole runs, and its global search.

With wrong keys, a long simulated motion gets out of phase, and the cost has many local minima.  Over a first, short
part it has few, and most keys have effect; its solution is the start for the next, longer part.  Standard deviations
are re-estimated between rounds.

If the residuals of a stage exceed the sensor noise, the fit is in a wrong minimum.  Then points of a Sobol sequence,
over the box of the keys and about the best fits, are scored by simulations as long as the stage.  The best of them are
fitted too, and the next, longer stage starts from the best few fits.

If the effect of the initial state does not decay, a small error of a key grows: in the later part of a run, the minimum
is narrower than any difference step.  If the response is strongly curved within that step, a longer stage adds no
information.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import Annotated

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from mech_twin.declarations.quantity import Parameters
from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.fit_problem import (
    BEGIN,
    GAIN,
    KEY,
    ZERO,
    FitProblem,
    Unknowns,
    Weighting,
    problem_of,
)
from mech_twin.studies.identification.fit_quality import (
    Fitted,
    channel_noise,
    noise_misfit,
    refutation,
    unweighted,
    weighted,
)
from mech_twin.studies.identification.fit_runs import ColumnCurves, FitRun
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.spreading import spread

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
MOST_POINTS, FEWEST_POINTS = 256, 32  # of a sequence; they cost FEWEST_POINTS simulations of whole runs
FITTED = 4  # points that are fitted, the best
SURVIVORS = 3  # fits that start the next stage
WITHIN = 2.0  # times the misfit of the best, for a fit to start the next stage
BOX = 2.5  # factor of the box about the configured value, within the bounds
ABOUT = 0.2  # relative half width of the box about a fit
SAME = 0.3  # of a residual, or of the noise: fits that differ by less are in the same local minimum
ATTEMPTS = 3  # searches, while noise does not explain the best fit and the starts do not agree
AGREEING = 3  # starts that end in the best minimum
SHORTEST = 0.1  # share of the runs that is fitted, at least
BENDING = 0.01  # relative difference of the slopes on either side of a step that is strongly curved
FAR = 3.0  # standard deviations of a channel: bound of a residual in the score

Progress = Callable[[str], None]


def quiet(_: str) -> None:
    """Discard progress."""


@dataclass(frozen=True)
class Search:
    """Summary of a search over several starts.

    Attributes
    ----------
    starts : int
        Number of fits of the whole runs.
    valleys : int
        Number of local minima that they reached, distinguished by the model's motion.
    agreeing : int
        Number of starts that reached the best one.
    margin : float
        Misfit of the second best minimum over that of the best; infinite with only one.
    """

    starts: int
    valleys: int
    agreeing: int
    margin: Annotated[float, np.inf]

    @property
    def agreed(self) -> bool:
        """Whether most starts reached the best minimum: then a better one is unlikely."""
        return self.agreeing >= AGREEING and 2 * self.agreeing > self.starts


def searched(
    problem: FitProblem,
    seed: int,
    progress: Progress = quiet,
    scheduler: str | None = None,
    explained: Callable[[Fitted], bool] = lambda _: False,
) -> tuple[Fitted, Search]:
    """Return the best fit, and a summary of its search; a ``scheduler`` distributes the further starts.

    ``explained`` tells whether something else than the keys explains what noise does not: then a search is in vain.
    """
    ended: list[Fitted] = []
    for attempt in range(ATTEMPTS):
        found, early = _ends(problem, seed + ATTEMPTS * attempt, attempt > 0, progress, scheduler, explained)
        ended = sorted(found if early else [*ended, *found], key=noise_misfit)
        seen = _search_summary(ended)
        # starts from about a fit alone agree with it wherever it ended
        if early or refutation(ended[0]) is None or (attempt > 0 and seen.agreed):
            break
    return ended[0], seen


def _ends(
    problem: FitProblem,
    seed: int,
    widely: bool,
    progress: Progress,
    scheduler: str | None,
    explained: Callable[[Fitted], bool],
) -> tuple[list[Fitted], bool]:
    """Return the final fits of one search, and whether no other is needed.

    ``widely``: with further starts in the first stage in any case, and half of them from the whole box.
    """
    survivors = [with_begins(problem, problem.unknowns.start)]
    longest_s = max(run.end_s - max(run.first_s, run.from_s) for run in problem.runs)
    shares = [share for share in HORIZONS if share == 1.0 or share * longest_s >= FEWEST_STEPS * problem.model.step_s]
    for stage, share in enumerate(shares):
        progress(f"first {100.0 * share:.0f} % of the runs" if share < 1.0 else "whole runs")
        found = sorted(stage_fits(problem, survivors, share, progress), key=noise_misfit)
        off = refutation(found[0])
        if off is not None and share == 1.0 and explained(found[0]):
            return found, True
        if off is not None or (widely and stage == 0):
            progress(f"further starts: {off or 'from elsewhere'}")
            starts = _further(stage_part(problem, share, found[0].x), found, share, seed + stage, widely)
            found = sorted([*found, *stage_fits(problem, starts, share, progress, scheduler)], key=noise_misfit)
        near = [each for each in found if noise_misfit(each) <= WITHIN * noise_misfit(found[0])]
        survivors = [valley[0].x for valley in _valleys(near)[:SURVIVORS]]
        if SHORTEST <= share < 1.0 and _bends(found[0]):
            progress(f"first {100.0 * share:.0f} % of the runs alone: later the motion forgets nothing")
            first = problem.over(found[0].problem.runs)  # without the priors of a stage
            return [refined(first, each, progress) for each in survivors], True
    return found, False


def _bends(best: Fitted) -> bool:
    """Return whether noise explains the fit, and the response to the keys is strongly curved at its end."""
    return refutation(best) is None and best.problem.curvature(best.x, best.comparison) > BENDING


def _valleys(found: list[Fitted]) -> list[list[Fitted]]:
    """Return the fits grouped by local minimum, the best first; in one minimum the residuals are alike."""
    valleys: list[list[Fitted]] = []
    for each in found:
        own = next((valley for valley in valleys if _alike(valley[0], each)), None)
        if own is None:
            valleys.append([each])
        else:
            own.append(each)
    return valleys


def _alike(one: Fitted, other: Fitted) -> bool:
    """Return whether the residuals of two fits differ by less than a share of themselves, or of the noise."""
    for run, (ones, others) in enumerate(zip(one.parts, other.parts, strict=True)):
        for place, (left, right) in enumerate(zip(ones, others, strict=True)):
            counts = one.comparison.masks[run][place] & np.isfinite(left) & np.isfinite(right)
            if not counts.any():
                return bool(np.isfinite(left).any() == np.isfinite(right).any())
            size = max(float(np.std(left[counts])), channel_noise(one.problem.runs, place)[0])
            if float(np.sqrt(np.mean((left - right)[counts] ** 2))) > SAME * size:
                return False
    return True


def _search_summary(found: list[Fitted]) -> Search:
    valleys = _valleys(found)
    margin = noise_misfit(valleys[1][0]) / noise_misfit(found[0]) if len(valleys) > 1 else np.inf
    return Search(len(found), len(valleys), len(valleys[0]), margin)


def _further(part: FitProblem, found: list[Fitted], share: float, seed: int, widely: bool) -> list[Array]:
    """Return the best of many points, over the box of the keys and about the best fits; ``widely``: half from each."""
    places = part.unknowns.places(KEY)
    if not len(places):
        return []
    count = int(np.clip(2 ** np.floor(np.log2(FEWEST_POINTS / share)), FEWEST_POINTS, MOST_POINTS))
    points = 2.0 * qmc.Sobol(len(places), seed=np.random.default_rng(seed)).random(count) - 1.0
    start = part.unknowns.start[places]
    centres = np.array([each.x[places] for each in found[:SURVIVORS]])
    low, high = (bound[places] for bound in part.unknowns.bounds())
    tried = []
    for number, point in enumerate(points):
        if number % 2:
            keys = np.where(start == 0.0, point, start * BOX**point)
        else:
            centre = centres[number // 2 % len(centres)]
            keys = np.where(centre == 0.0, ABOUT * point, centre * (1.0 + ABOUT * point))
        x = found[0].x.copy()
        x[places] = np.clip(keys, low, high)
        tried.append(x)
    best = np.argsort(coarse_misfits(part, tried), kind="stable")
    if not widely:
        return [tried[i] for i in best[:FITTED]]
    return [tried[i] for odd in (0, 1) for i in best[best % 2 == odd][: FITTED // 2]]


def coarse_misfits(problem: FitProblem, tried: list[Array]) -> Array:
    """Return the mean absolute residual at each point, over the channels' deviations, with zeros removed.

    The mean absolute value grows with errors in time as well as in amplitude.
    """
    scales = problem.unknowns.scales[problem.unknowns.places(KEY)]
    keys = [x[problem.unknowns.places(KEY)] * scales for x in tried]
    found = np.full(len(tried), np.inf)
    for number, (x, curves) in enumerate(zip(tried, problem.model.many(keys), strict=True)):
        if curves is None:
            continue
        total = 0.0
        for run, parts in enumerate(problem.parts(x, curves)):
            for place, off in enumerate(parts):
                channel = problem.runs[run].channels[place]
                counts = (channel.times_s >= problem.runs[run].from_s) & (channel.times_s <= problem.runs[run].until_s)
                if not counts.any():
                    continue
                size = float(np.std(channel.values[counts])) or 1.0
                left = np.nan_to_num(off[counts], nan=FAR * size)
                if any(problem.unknowns.of_channel(kind, run, place) is not None for kind in (ZERO, GAIN)):
                    left = left - float(np.median(left))
                total += float(np.mean(np.minimum(np.abs(left), FAR * size))) / size
        found[number] = total
    return found


def carried_over(fitted: Fitted, unknowns: Unknowns) -> Array:
    """Return the start vector of other unknowns, with the fitted values where they are the same."""
    found = {(u.kind, u.name, u.runs): fitted.x[i] * u.scale for i, u in enumerate(fitted.problem.unknowns.all)}
    pairs = zip(unknowns.all, unknowns.start, strict=True)
    return np.array([found.get((u.kind, u.name, u.runs), start * u.scale) / u.scale for u, start in pairs])


def stage_fits(
    problem: FitProblem, starts: Sequence[Array], share: float, progress: Progress = quiet, scheduler: str | None = None
) -> list[Fitted]:
    """Return the fits of the first share of the runs; zeros and gains are initialised in closed form."""
    if scheduler is None:
        return [_stage_fit(problem, share, (0, start), progress)[1] for start in starts]
    found = sorted(
        spread(partial(_stage_fit, problem, share), list(enumerate(starts)), 1, scheduler), key=itemgetter(0)
    )
    return [replace(fitted, problem=stage_part(problem, share, fitted.x)) for _, fitted in found]


def _stage_fit(
    problem: FitProblem, share: float, start: tuple[int, Array], progress: Progress = quiet
) -> tuple[int, Fitted]:
    """Return the fit from a start, with the number of the start: a cluster gives them in any order."""
    number, x = start
    part = stage_part(problem, share, x)
    return number, refined(part, with_offsets(part, x), progress, last=share == 1.0)


def fixed_fit(question: IdentificationQuestion, parameters: Parameters, runs: Sequence[FitRun]) -> Fitted:
    """Return the best-fitting zeros, gains, lags and start times of a fixed configuration."""
    problem = problem_of(replace(question, base=parameters, keys=()), runs)
    (found,) = stage_fits(problem, [with_begins(problem, problem.unknowns.start)], 1.0)
    return found


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


def refined(problem: FitProblem, x: Array, progress: Progress = quiet, *, last: bool = True) -> Fitted:
    """Return the fit of a stage from a start; of the last in rounds, until the standard deviations converge."""
    low, high = problem.unknowns.bounds()
    fitted = weighted(problem, x)
    for number in range((ROUNDS if last else 1) if len(x) else 0):
        followed = _Followed(problem, fitted.comparison)
        found = least_squares(
            followed.residuals,
            np.clip(fitted.x, low, high),
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
        progress(f"{problem.model.rolled_out} runs of the model")
        before, fitted = fitted, weighted(problem, found.x)
        if np.all(np.abs(fitted.comparison.sigmas / before.comparison.sigmas - 1.0) < SETTLED):
            break
    return fitted


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
    masks, parts = unweighted(problem, x).comparison.masks, problem.parts(plain)
    measured, column = [], []
    for run in runs:
        mask = masks[run][place] & np.isfinite(parts[run][place])
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
