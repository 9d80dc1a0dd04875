# SPDX-License-Identifier: Apache-2.0
"""The global search of a fit: stage by stage, with further starts if sensor noise does not explain the residuals.

Over the first part of a run, the cost has few local minima, and most keys have effect.  If the residuals of a stage
exceed the sensor noise, the fit is in a wrong minimum.  Then points of a Sobol sequence, over the box of the keys and
about the best fits, are scored by simulations as long as the stage.  The best of them are fitted too, and the next,
longer stage starts from the best few fits.

If the effect of the initial state does not decay, a small error of a key grows: in the later part of a run, the minimum
is narrower than any difference step.  If the response is strongly curved within that step, a longer stage adds no
information.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.stats import qmc

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.held_out import channel_noise, noise_misfit, refutation
from mech_twin.studies.identification.least_squares_fit import (
    Fitted,
    Progress,
    quiet,
    refined,
    stage_fit,
    stage_part,
    stage_shares,
    with_begins,
)
from mech_twin.studies.identification.residuals import FitProblem
from mech_twin.studies.identification.unknowns import GAIN, KEY, ZERO

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
    x: Array,
    seed: int,
    progress: Progress = quiet,
    further_fits: Callable[[list[Array], float], list[Fitted]] | None = None,
) -> tuple[Fitted, Search]:
    """Return the best fit, and a summary of its search.

    Parameters
    ----------
    further_fits : callable, optional
        Returns the fits of a share of the runs from further starts, for example computed on a cluster.
    """
    fits = further_fits or (lambda starts, share: [stage_fit(problem, each, share, progress) for each in starts])
    ended: list[Fitted] = []
    for attempt in range(ATTEMPTS):
        found, early = _ends(problem, x, seed + ATTEMPTS * attempt, attempt > 0, progress, fits)
        ended = sorted(found if early else [*ended, *found], key=noise_misfit)
        seen = _seen(ended)
        # starts from about a fit alone agree with it wherever it ended
        if early or refutation(ended[0]) is None or (attempt > 0 and seen.agreed):
            break
    return ended[0], seen


def _ends(
    problem: FitProblem,
    x: Array,
    seed: int,
    widely: bool,
    progress: Progress,
    fits: Callable[[list[Array], float], list[Fitted]],
) -> tuple[list[Fitted], bool]:
    """Return the final fits of one search, and whether it ended before the whole runs.

    ``widely``: with further starts in the first stage in any case, and half of them from the whole box.
    """
    survivors = [with_begins(problem, x)]
    for stage, share in enumerate(stage_shares(problem.runs, problem.model.step_s)):
        progress(f"first {100.0 * share:.0f} % of the runs" if share < 1.0 else "whole runs")
        found = sorted((stage_fit(problem, each, share, progress) for each in survivors), key=noise_misfit)
        off = refutation(found[0])
        if off is not None or (widely and stage == 0):
            progress(f"further starts: {off or 'from elsewhere'}")
            part = stage_part(problem, share, found[0].x)
            found = sorted([*found, *fits(_further(part, found, share, seed + stage, widely), share)], key=noise_misfit)
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
    pairs = zip(one.problem.parts(one.x), other.problem.parts(other.x), strict=True)
    for run, (ones, others) in enumerate(pairs):
        for place, (left, right) in enumerate(zip(ones, others, strict=True)):
            counts = one.comparison.masks[run][place] & np.isfinite(left) & np.isfinite(right)
            if not counts.any():
                return bool(np.isfinite(left).any() == np.isfinite(right).any())
            size = max(float(np.std(left[counts])), channel_noise(one.problem, place)[0])
            if float(np.sqrt(np.mean((left - right)[counts] ** 2))) > SAME * size:
                return False
    return True


def _seen(found: list[Fitted]) -> Search:
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
