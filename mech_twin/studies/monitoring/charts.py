# SPDX-License-Identifier: Apache-2.0
"""Control charts of prewhitened features: two-sided CUSUM of each, jump of the vector (GLR), chi-square of the vector.

With u the innovation of a feature over its standard deviation and z the whitened vector::

    up_t = max(0, up_(t-1) + u_t - k),   down_t = max(0, down_(t-1) - u_t - k),   k = 0.5      (drift)
    glr_t = max over n <= N of |z_(t-n+1) + ... + z_t|^2/n                                   (jump n cycles ago)
    chi_t = |z_t|^2                                                                    (one cycle that is off)

Sources: PageInspection1954, SiegmundSequential1985 (run length), LaiSequential1995 (window), HotellingQuality1947.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import NamedTuple

import numpy as np

from mech_twin.capabilities.cycle import Array
from mech_twin.kernels.kernel import kernel

ALLOWANCE = 0.5  # k, in standard deviations: best against a drift of one
WINDOW = 60  # cycles that the jump chart looks back
CHARTS = ("cusum", "glr", "chi_square")


class ChartValues(NamedTuple):
    """The charts at a cycle: the largest CUSUM, jump and chi-square; which feature drifts, how old the jump is."""

    cusum: float
    glr: float
    chi_square: float
    feature: int
    jump_cycles: int

    @property
    def statistics(self) -> tuple[float, float, float]:
        """The three statistics in the order of `CHARTS`."""
        return self.cusum, self.glr, self.chi_square


@kernel
def advance_cusum(u: Array, allowance: float, cap: float, up: Array, down: Array) -> tuple[float, int]:
    """Advance the sums of each feature by one cycle, bounded by ``cap``; return the largest and its feature."""
    largest, feature = 0.0, 0
    for i in range(len(u)):
        up[i] = min(max(0.0, up[i] + u[i] - allowance), cap)
        down[i] = min(max(0.0, down[i] - u[i] - allowance), cap)
        here = max(up[i], down[i])
        if here > largest:
            largest, feature = here, i
    return largest, feature


@kernel
def jump_statistic(recent: Array, newest: int, count: int, total: Array) -> tuple[float, int]:
    """Return the largest |sum of the last n|^2/n over n up to ``count``, and that n; ``recent`` is a ring (N, d)."""
    length, width = recent.shape
    total[:] = 0.0
    best, age = 0.0, 0
    for n in range(1, count + 1):
        place = (newest - n + 1) % length
        square = 0.0
        for i in range(width):
            total[i] += recent[place, i]
            square += total[i] * total[i]
        if square > best * n:
            best, age = square / n, n
    return best, age


@kernel
def chart_rows(u: Array, z: Array, allowance: float, window: int) -> Array:
    """Return the three statistics (n, 3) of a run of standardised (n, d) and whitened (n, d) innovations."""
    cycles, width = z.shape
    up, down, total = np.zeros(width), np.zeros(width), np.zeros(width)
    recent = np.zeros((window, width))
    found = np.zeros((cycles, 3))
    for t in range(cycles):
        found[t, 0], _ = advance_cusum(u[t], allowance, 1e300, up, down)
        newest = t % window
        recent[newest] = z[t]
        found[t, 1], _ = jump_statistic(recent, newest, min(t + 1, window), total)
        for i in range(width):
            found[t, 2] += z[t, i] * z[t, i]
    return found


@dataclass
class ChartState:
    """The charts of one monitor; `advance` takes one cycle.

    Parameters
    ----------
    width : int
        Number of features.
    cap : float
        Bound of the sums: a long fault must not take as long to be forgotten.
    """

    width: int
    cap: float

    def __post_init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Begin anew, as after a fault has gone."""
        self._up, self._down, self._total = (np.zeros(self.width) for _ in range(3))
        self._recent = np.zeros((WINDOW, self.width))
        self._cycles = 0

    def advance(self, u: Array, z: Array) -> ChartValues:
        """Return the charts after a cycle of standardised (d,) and whitened (d,) innovations."""
        cusum, feature = advance_cusum(u, ALLOWANCE, self.cap, self._up, self._down)
        newest = self._cycles % WINDOW
        self._recent[newest] = z
        self._cycles += 1
        glr, age = jump_statistic(self._recent, newest, min(self._cycles, WINDOW), self._total)
        return ChartValues(float(cusum), float(glr), float(z @ z), int(feature), int(age))


def siegmund_run_length(threshold: float, allowance: float = ALLOWANCE, shift: float = 0.0) -> float:
    """Return Siegmund's approximate mean run length of the two-sided CUSUM of unit normal values.

    One-sided, with D = shift - k and b = h + 1.166: (exp(-2 D b) + 2 D b - 1)/(2 D^2), b^2 for D = 0; two-sided,
    1/ARL = 1/ARL+ + 1/ARL-.  Source: SiegmundSequential1985; MontgomeryQuality2013, chapter 9.
    """
    b = threshold + 1.166

    def one_sided(drift: float) -> float:
        if abs(drift) < 1e-9:
            return b * b
        return (exp(min(-2.0 * drift * b, 700.0)) + 2.0 * drift * b - 1.0) / (2.0 * drift * drift)

    return 1.0 / (1.0 / one_sided(shift - allowance) + 1.0 / one_sided(-shift - allowance))
