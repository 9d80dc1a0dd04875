# SPDX-License-Identifier: Apache-2.0
"""Global search for the fit: stage by stage, with further starts if the best residual exceeds the sensors' noise.

The first part of a run has few local minima, and determines most keys.  If the residual of a stage exceeds the noise of
the sensors, the fit is in a wrong minimum.  Then points of a Sobol sequence, over the box of the keys and near the
result, are scored by roll-outs as long as the stage.  The best of them are fitted as well, and the next, longer stage
continues from the best few.

An undamped or chaotic motion amplifies a small error of a key: for the later part of a run the minimum is narrower than
any difference step.  A longer stage then adds no information.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.channel_fits import channel_noise, noise_misfit, refutation
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

MOST_POINTS, FEWEST_POINTS = 256, 32  # of a sequence: as many as make up one roll-out of this many whole runs
FITTED = 4  # of them
SURVIVORS = 3  # that go on into the next stage
WITHIN = 2.0  # times the misfit of the best
BOX = 2.5  # times larger and smaller than configured, where nothing narrower is given
ABOUT = 0.2  # of a key: points about one that was found
SAME = 0.3  # of a residual, or of the noise: fits that differ by less ended in one valley
ATTEMPTS = 3  # searches, while the noise refutes the best fit and the starts do not agree
AGREEING = 3  # starts that end in the best valley
SHORTEST = 0.1  # of the runs: at least so much is fitted
BENDING = 0.01  # of a derivative: more difference between the slopes on either side of a step
FAR = 3.0  # of the size of a channel: a sample that is farther off counts no more


@dataclass(frozen=True)
class Search:
    """Statistics of a search over several starts.

    Attributes
    ----------
    starts : int
        Fits of the whole runs.
    valleys : int
        Different motions of the model in which they ended.
    agreeing : int
        How many of them ended in the best.
    margin : float
        Misfit of the second best valley over that of the best; infinite where only one was seen.
    """

    starts: int
    valleys: int
    agreeing: int
    margin: float

    @property
    def agreed(self) -> bool:
        """Whether the best valley is that in which most starts end: then there is hardly a better one."""
        return self.agreeing >= AGREEING and 2 * self.agreeing > self.starts


def searched(
    problem: FitProblem,
    x: Array,
    seed: int,
    progress: Progress = quiet,
    further_fits: Callable[[list[Array], float], list[Fitted]] | None = None,
) -> tuple[Fitted, Search]:
    """Return the best fit, and the statistics of the search.

    Parameters
    ----------
    problem : FitProblem
        What is fitted.
    x : ndarray
        Where to start.
    seed : int
        Of the sequences.
    progress : callable, optional
        Takes a line on the progress.
    further_fits : callable, optional
        Returns the fits from further starts of a share of the runs, computed elsewhere.
    """
    fits = further_fits or (lambda starts, share: [stage_fit(problem, each, share, progress) for each in starts])
    ended: list[Fitted] = []
    for attempt in range(ATTEMPTS):
        found, early = _ends(problem, x, seed + ATTEMPTS * attempt, attempt > 0, progress, fits)
        ended = sorted(found if early else [*ended, *found], key=noise_misfit)
        seen = _seen(ended)
        if early or refutation(ended[0]) is None or seen.agreed:
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
    """Return the fits in which one search ends, and whether it ended before the whole runs.

    ``widely``: with further starts at once.
    """
    survivors = [with_begins(problem, x)]
    for stage, share in enumerate(stage_shares(problem.runs, problem.model.step_s)):
        progress(f"first {100.0 * share:.0f} % of the runs" if share < 1.0 else "whole runs")
        found = sorted((stage_fit(problem, each, share, progress) for each in survivors), key=noise_misfit)
        off = refutation(found[0])
        if off is not None or (widely and stage == 0):
            progress(f"further starts: {off or 'from elsewhere'}")
            part = stage_part(problem, share, found[0].x)
            found = sorted([*found, *fits(_further(part, found, share, seed + stage), share)], key=noise_misfit)
        survivors = _distinct(found)
        if SHORTEST <= share < 1.0 and _bends(found[0]):
            progress(f"first {100.0 * share:.0f} % of the runs alone: later the motion forgets nothing")
            first = problem.over(found[0].problem.runs)  # without the priors of a stage
            return [refined(first, each, progress) for each in survivors], True
    return found, False


def _bends(best: Fitted) -> bool:
    """Return whether a fit has found the motion, but amplifies small errors of the keys strongly at its end."""
    return refutation(best) is None and best.problem.curvature(best.x, best.comparison) > BENDING


def _distinct(found: list[Fitted]) -> list[Array]:
    """Return where the best fits ended, one a valley."""
    near = [each for each in found if noise_misfit(each) <= WITHIN * noise_misfit(found[0])]
    return [valley[0].x for valley in _valleys(near)[:SURVIVORS]]


def _valleys(found: list[Fitted]) -> list[list[Fitted]]:
    """Return fits by the valleys in which they ended, the best first: in one valley the model moves alike."""
    valleys: list[list[Fitted]] = []
    for each in found:
        own = next((valley for valley in valleys if _alike(valley[0], each)), None)
        if own is None:
            valleys.append([each])
        else:
            own.append(each)
    return valleys


def _alike(one: Fitted, other: Fitted) -> bool:
    """Return whether the residuals of two fits differ by no more than a small share of themselves, or the noise."""
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


def _further(part: FitProblem, found: list[Fitted], share: float, seed: int) -> list[Array]:
    """Return the best of many points, over the box of the keys and about what was found."""
    places = part.unknowns.places(KEY)
    if not len(places):
        return []
    count = int(np.clip(2 ** np.floor(np.log2(FEWEST_POINTS / share)), FEWEST_POINTS, MOST_POINTS))
    points = 2.0 * qmc.Sobol(len(places), rng=seed).random(count) - 1.0
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
    scores = coarse_misfits(part, tried)
    return [tried[i] for i in np.argsort(scores, kind="stable")[:FITTED]]


def coarse_misfits(problem: FitProblem, tried: list[Array]) -> Array:
    """Return how far the model is off at each point, over the sizes of the channels, zeros and gains as they fit best.

    The mean of magnitudes, which grows with a difference in time as well as with one in size.
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
