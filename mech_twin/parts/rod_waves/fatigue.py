# SPDX-License-Identifier: Apache-2.0
"""Fatigue of a rod: the damage of a blow follows from its stress cycles and a given S-N line.

The cycles are counted by the library `rainflow` after ASTM E1049-85, 5.4.4 (AstmRainflow1985): one that holds the
first point of the history counts half; so do those left at the end.

A cycle of amplitude S_a about a mean S_m, tension positive, counts as S = K S_a/(1 - K S_m/S_u) about 0 (Goodman).  A
mean compression counts as none.  N = N_0 (S/S_0)^(-k) of those break the rod.  Damages add up (Miner).  A blow begins
and ends without stress.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class StressLine(NamedTuple):
    """An S-N line: amplitude S_0 (Pa) at N_0 cycles, slope k, ultimate strength S_u (Pa), notch factor K."""

    amplitude_pa: float
    cycles: float
    slope: float
    ultimate_pa: float
    notch_factor: float


def cycle_damage(line: StressLine, spread: float, mean: float) -> float:
    """Return the damage of a cycle of this range and mean stress (Pa); infinite where its peak is the strength."""
    room = 1.0 - line.notch_factor * max(mean, 0.0) / line.ultimate_pa
    if room <= 0.0:
        return math.inf
    amplitude = 0.5 * line.notch_factor * spread / room
    return float((amplitude / line.amplitude_pa) ** line.slope / line.cycles)


def blow_damage(line: StressLine, forces: Array, area_m2: Array) -> tuple[float, int]:
    """Return the largest damage of a blow in the cells of a chain, and the cell.

    Parameters
    ----------
    line : StressLine
    forces : (n, m) array
        Force in each cell (N), compression positive.
    area_m2 : (m,) array

    Raises
    ------
    ModuleNotFoundError
        The extra ``life`` is not installed.
    """
    from rainflow import extract_cycles

    worst, place = 0.0, 0
    for cell, area in enumerate(area_m2):
        history = np.concatenate([[0.0], -forces[:, cell] / area, [0.0]]).tolist()
        damage = sum(count * cycle_damage(line, spread, mean) for spread, mean, count, _, _ in extract_cycles(history))
        if damage > worst:
            worst, place = damage, cell
    return worst, place
