# SPDX-License-Identifier: Apache-2.0
"""Damage of a blow: its stress cycles counted by rainflow, and a given S-N line.

Counting by ASTM E1049-85, 5.4.4 (AstmRainflow1985): a range between two turning points is a cycle once the next range
is as large.  One that holds the first point of the history counts half; so do those left at the end.

A cycle of amplitude S_a about a mean S_m, tension positive, counts as S = K S_a/(1 - K S_m/S_u) about 0 (Goodman).  A
mean compression counts as none.  N = N_0 (S/S_0)^(-k) of those break the rod.  Damages add up (Miner).  A blow begins
and ends without stress.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel

Array = NDArray[np.float64]


class StressLine(NamedTuple):
    """An S-N line: amplitude S_0 (Pa) at N_0 cycles, slope k, ultimate strength S_u (Pa), notch factor K."""

    amplitude_pa: float
    cycles: float
    slope: float
    ultimate_pa: float
    notch_factor: float


@kernel
def turning_points(history: Array, points: Array) -> int:
    """Put the turning points of a history, its first and last value among them, into an array; return their number."""
    count = 0
    for value in history:
        if count > 0 and value == points[count - 1]:
            continue
        if count > 1 and (value - points[count - 1]) * (points[count - 1] - points[count - 2]) > 0.0:
            points[count - 1] = value
        else:
            points[count] = value
            count += 1
    return count


@kernel
def rainflow(history: Array, points: Array, cycles: Array) -> int:
    """Count the cycles of a history; return their number.

    Parameters
    ----------
    history : (n,) array
    points : (n,) array
        Room to work.
    cycles : (n, 3) array
        Receives range, mean and count (1 or 0.5) of each.
    """
    count, found, held = turning_points(history, points), 0, 0
    for i in range(count):
        points[held] = points[i]
        held += 1
        while held >= 3:
            last, before = abs(points[held - 1] - points[held - 2]), abs(points[held - 2] - points[held - 3])
            if last < before:
                break
            cycles[found, 0], cycles[found, 1] = before, 0.5 * (points[held - 2] + points[held - 3])
            cycles[found, 2] = 0.5 if held == 3 else 1.0
            found += 1
            if held == 3:
                points[0], points[1] = points[1], points[2]
                held = 2
            else:
                points[held - 3] = points[held - 1]
                held -= 2
    for i in range(held - 1):
        cycles[found, 0], cycles[found, 1] = abs(points[i + 1] - points[i]), 0.5 * (points[i] + points[i + 1])
        cycles[found, 2] = 0.5
        found += 1
    return found


@kernel
def cycle_damage(line: StressLine, spread: float, mean: float) -> float:
    """Return the damage of a cycle of this range and mean stress (Pa); infinite where its peak is the strength."""
    room = 1.0 - line.notch_factor * max(mean, 0.0) / line.ultimate_pa
    if room <= 0.0:
        return math.inf
    amplitude = 0.5 * line.notch_factor * spread / room
    return float((amplitude / line.amplitude_pa) ** line.slope / line.cycles)


@kernel
def blow_damage(line: StressLine, forces: Array, area_m2: Array, rooms: Array, cycles: Array) -> tuple[float, int]:
    """Return the largest damage of a blow in the cells of a chain, and the cell.

    Parameters
    ----------
    line : StressLine
    forces : (n, m) array
        Force in each cell (N), compression positive.
    area_m2 : (m,) array
    rooms, cycles : (2, n + 2) and (n + 2, 3) array
        Room to work.
    """
    worst, place, n = 0.0, 0, len(forces)
    history, points = rooms[0], rooms[1]
    for cell in range(len(area_m2)):
        history[0] = history[n + 1] = 0.0
        for step in range(n):
            history[step + 1] = -forces[step, cell] / area_m2[cell]
        damage = 0.0
        for i in range(rainflow(history, points, cycles)):
            damage += cycles[i, 2] * cycle_damage(line, cycles[i, 0], cycles[i, 1])
        if damage > worst:
            worst, place = damage, cell
    return worst, place
