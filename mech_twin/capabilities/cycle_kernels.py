# SPDX-License-Identifier: Apache-2.0
"""Compiled arithmetic of cycle features: the same code for live samples and for recordings.

Sums are in the order of the samples, so that a feature is reproducible to the bit.
"""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import numpy.typing as npt

from mech_twin.kernels.kernel import kernel

Array = npt.NDArray[np.float64]
TURN = 2.0 * pi


@kernel
def phase_weights(phase_rad: Array) -> Array:
    """Return the share of the cycle that each sample represents; phases that decrease by noise are held constant."""
    count = len(phase_rad)
    standing, weights = np.empty(count), np.empty(count)
    for i in range(count):
        standing[i] = phase_rad[i] if i == 0 else max(standing[i - 1], phase_rad[i])
    for i in range(count):
        after = standing[i + 1] if i + 1 < count else standing[0] + TURN
        before = standing[i - 1] if i > 0 else standing[count - 1] - TURN
        weights[i] = (after - before) / (2.0 * TURN)
    return weights


@kernel
def weighted_sum(weights: Array, values: Array) -> float:
    """Return the weighted sum of the values."""
    total = 0.0
    for i in range(len(values)):
        total += weights[i] * values[i]
    return total


@kernel
def fourier_coefficient(weights: Array, phase_rad: Array, values: Array, order: int, of_sine: bool) -> float:
    """Return ``2 <x cos n phi>``, or ``2 <x sin n phi>``."""
    total = 0.0
    for i in range(len(values)):
        angle = order * phase_rad[i]
        total += weights[i] * (sin(angle) if of_sine else cos(angle)) * values[i]
    return 2.0 * total


@kernel
def lead(times_s: Array, phase_rad: Array, begin_s: float, period_s: float) -> tuple[Array, Array]:
    """Return the angle psi of a uniform rotation, and the lead of the joint's phase over it (rad), shape (n,) each."""
    psi, ahead = np.empty(len(times_s)), np.empty(len(times_s))
    for i in range(len(times_s)):
        psi[i] = TURN * (times_s[i] - begin_s) / period_s
        ahead[i] = phase_rad[i] - psi[i]
    return psi, ahead


@kernel
def mean_of_ordered(values: Array, first: int, count: int) -> float:
    """Return the mean of ``count`` values from the ``first`` on, in ascending order."""
    ordered = np.sort(values)
    total = 0.0
    for i in range(first, first + count):
        total += ordered[i]
    return total / count


@kernel
def weight_above(weights: Array, values: Array, level: float) -> float:
    """Return the sum of the weights of the values above a level."""
    total = 0.0
    for i in range(len(values)):
        if values[i] > level:
            total += weights[i]
    return total


@kernel
def fitted_slope(x: Array, y: Array) -> float:
    """Return the slope of the least-squares line through points; nan if all have the same x."""
    mean_x, mean_y = x.mean(), y.mean()
    along, across = 0.0, 0.0
    for i in range(len(x)):
        along += (x[i] - mean_x) * (x[i] - mean_x)
        across += (x[i] - mean_x) * (y[i] - mean_y)
    return across / along if along > 0.0 else np.nan


@kernel
def phase_of_turn(angles_rad: Array, start_rad: float) -> Array:
    """Return the phase (rad) of the samples of a turn from its start angle; its ends 0 and 2 pi are added."""
    count = len(angles_rad)
    phase = np.empty(count + 2)
    phase[0], phase[count + 1] = 0.0, TURN
    for i in range(count):
        phase[i + 1] = min(max(angles_rad[i] - start_rad, 0.0), TURN)
    return phase


@kernel
def gap_limits(times_s: Array, begin_s: float, end_s: float) -> tuple[float, float]:
    """Return the largest gap of a channel in a cycle, to its ends included, and the median spacing (s)."""
    spacing = np.diff(times_s)
    largest = max(times_s[0] - begin_s, end_s - times_s[-1])
    for each in spacing:
        largest = max(largest, each)
    return largest, float(np.median(spacing))


@kernel
def sample_quality(times_s: Array, values: Array) -> tuple[float, int, float]:
    """Return lower quartile of the spacing (s), length of the longest run of equal values, and isolation (SI)."""
    count, longest, run, isolation = len(values), 1, 1, 0.0
    spacings_s = np.empty(count - 1)
    for i in range(count - 1):
        spacings_s[i] = times_s[i + 1] - times_s[i]
        run = run + 1 if values[i + 1] - values[i] == 0.0 else 1
        longest = max(longest, run)
    for i in range(1, count - 1):
        apart = abs(values[i] - 0.5 * (values[i - 1] + values[i + 1])) - 2.0 * abs(values[i + 1] - values[i - 1])
        isolation = max(isolation, apart)
    place = (count - 2) // 4
    return np.partition(spacings_s, place)[place], longest, isolation


@kernel
def crossed_turn(
    times_s: Array, angles_rad: Array, first: int, boundary_rad: float, about_rad: float
) -> tuple[float, float]:
    """Return when an angle crosses a boundary, by a line through nearby samples; and the next boundary.

    The time is nan while samples are missing.  Boundaries within a gap of whole turns are skipped.
    """
    count, last = len(angles_rad), first
    while last < count and angles_rad[last] < boundary_rad + about_rad:
        last += 1
    if last == count:
        return np.nan, boundary_rad
    while angles_rad[last] - boundary_rad >= TURN:
        boundary_rad += TURN
    crossing = last
    while crossing >= 0 and angles_rad[crossing] >= boundary_rad:
        crossing -= 1
    if crossing < 0:
        return times_s[last], boundary_rad + TURN
    low = crossing
    while low >= 0 and angles_rad[low] >= boundary_rad - about_rad:
        low -= 1
    low += 1
    if last - low < 3:
        low, last = crossing, last + 1
    along, times = 0.0, 0.0
    for i in range(low, last):
        along += angles_rad[i] - boundary_rad
        times += times_s[i] - times_s[crossing]
    along, times = along / (last - low), times / (last - low)
    square, product = 0.0, 0.0
    for i in range(low, last):
        off = angles_rad[i] - boundary_rad - along
        square += off * off
        product += off * (times_s[i] - times_s[crossing])
    return times_s[crossing] + times - product / square * along, boundary_rad + TURN


@kernel
def first_rise(values: Array, first: int, level: float) -> int:
    """Return the index of the first sample from ``first`` on after which the level is reached; -1 without one."""
    for i in range(first, len(values) - 1):
        if values[i] < level <= values[i + 1]:
            return i
    return -1
