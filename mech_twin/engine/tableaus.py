# SPDX-License-Identifier: Apache-2.0
"""The Runge and Kutta methods in use, as data: see `mech_twin.engine.integration` for the fields.

``COOPER_VERNER_8``: 11 stages, order 8, no error estimate; for motions cut into short steps by their events.
``DORMAND_PRINCE_8``: 12 stages, order 8 with errors of order 5 and 3, dense output of order 7 (DOP853).
``DORMAND_PRINCE_5``: 6 stages, order 5 with an error of order 4, dense output of order 4.
The coefficients of the last two are those of `scipy.integrate.DOP853` and `RK45`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853, RK45

from mech_twin.engine.integration import Tableau

Array = NDArray[np.float64]


def _with_end_row(stages: Array, weights: Array, nodes: Array) -> tuple[Array, Array]:
    """Return stages and nodes with a row for the end of the step."""
    count = len(weights)
    table = np.zeros((count + 1, count + 1))
    table[:count, :count] = stages
    table[count, :count] = weights
    return table, np.append(nodes, 1.0)


def _hermite(weights: Array) -> Array:
    """Return the cubic through both ends and both rates as powers of the share of the step, (stages + 1, 3)."""
    powers = np.zeros((len(weights) + 1, 3))
    powers[:-1] = np.outer(weights, [0.0, 3.0, -2.0])
    powers[0] += [1.0, -2.0, 1.0]
    powers[-1] += [0.0, -1.0, 1.0]
    return powers


def _cooper_verner_8() -> Tableau:
    r = math.sqrt(21.0)
    rows: tuple[tuple[float, ...], ...] = (
        (),
        (1 / 2,),
        (1 / 4, 1 / 4),
        (1 / 7, (-7 - 3 * r) / 98, (21 + 5 * r) / 49),
        ((11 + r) / 84, 0, (18 + 4 * r) / 63, (21 - r) / 252),
        ((5 + r) / 48, 0, (9 + r) / 36, (-231 + 14 * r) / 360, (63 - 7 * r) / 80),
        ((10 - r) / 42, 0, (-432 + 92 * r) / 315, (633 - 145 * r) / 90, (-504 + 115 * r) / 70, (63 - 13 * r) / 35),
        (1 / 14, 0, 0, 0, (14 - 3 * r) / 126, (13 - 3 * r) / 63, 1 / 9),
        (1 / 32, 0, 0, 0, (91 - 21 * r) / 576, 11 / 72, (-385 - 75 * r) / 1152, (63 + 13 * r) / 128),
        (1 / 14, 0, 0, 0, 1 / 9, (-733 - 147 * r) / 2205, (515 + 111 * r) / 504, (-51 - 11 * r) / 56,
         (132 + 28 * r) / 245),
        (0, 0, 0, 0, (-42 + 7 * r) / 18, (-18 + 28 * r) / 45, (-273 - 53 * r) / 72, (301 + 53 * r) / 72,
         (28 - 28 * r) / 45, (49 - 7 * r) / 18),
    )  # fmt: skip
    early, late = (7 - r) / 14, (7 + r) / 14
    nodes = np.array([0, 0.5, 0.5, late, late, 0.5, early, early, 0.5, late, 1])
    weights = np.array([1 / 20, 0, 0, 0, 0, 0, 0, 49 / 180, 16 / 45, 49 / 180, 1 / 20])
    stages = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        stages[i, : len(row)] = row
    table, all_nodes = _with_end_row(stages, weights, nodes)
    return Tableau(all_nodes, table, weights, np.zeros((0, len(rows) + 1)), _hermite(weights), 8, 8)


def _dormand_prince_8() -> Tableau:
    """DOP853; its interpolant is y + F0 x + F1 x (1 - x) + F2 x^2 (1 - x) + F3 x^2 (1 - x)^2 + ..., F = h sum w k."""
    count = len(DOP853.B)
    stages = np.zeros((16, 16))
    stages[:count, :count] = DOP853.A[:count, :count]
    stages[count, :count] = DOP853.B
    stages[count + 1 :, :] = DOP853.A_EXTRA
    nodes = np.concatenate([DOP853.C[:count], [1.0], DOP853.C_EXTRA])
    whole, first, last = np.zeros(16), np.zeros(16), np.zeros(16)
    whole[:count], first[0], last[count] = DOP853.B, 1.0, 1.0
    terms = np.vstack([whole, first - whole, 2.0 * whole - last - first, DOP853.D])
    powers, shape = np.zeros((16, 7)), np.polynomial.Polynomial([1.0])
    for i, term in enumerate(terms):
        shape *= np.polynomial.Polynomial([0.0, 1.0] if i % 2 == 0 else [1.0, -1.0])
        powers[:, : i + 1] += np.outer(term, shape.coef[1:])
    return Tableau(nodes, stages, np.array(DOP853.B), np.array([DOP853.E5, DOP853.E3]), powers, 8, 7)


def _dormand_prince_5() -> Tableau:
    table, nodes = _with_end_row(np.pad(RK45.A, ((0, 0), (0, 1))), RK45.B, RK45.C)
    return Tableau(nodes, table, np.array(RK45.B), np.array([RK45.E]), np.array(RK45.P), 5, 4)


COOPER_VERNER_8 = _cooper_verner_8()
DORMAND_PRINCE_8 = _dormand_prince_8()
DORMAND_PRINCE_5 = _dormand_prince_5()
