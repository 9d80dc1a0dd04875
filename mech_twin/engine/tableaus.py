# SPDX-License-Identifier: Apache-2.0
"""The Runge and Kutta methods in use, as data: see `mech_twin.engine.integration` for the fields.

``DORMAND_PRINCE_8``: 12 stages, order 8 with errors of order 5 and 3, dense output of order 7 (DOP853).
``DORMAND_PRINCE_5``: 6 stages, order 5 with an error of order 4, dense output of order 4.
Their coefficients are those of `scipy.integrate.DOP853` and `RK45`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853, RK45

from mech_twin.engine.integration import Tableau

Array = NDArray[np.float64]


def _with_end_row(stages: Array, weights: Array, nodes: Array) -> tuple[Array, Array]:
    """Return stages and nodes with a further row for the end of the step."""
    count = len(weights)
    table = np.zeros((count + 1, count + 1))
    table[:count, :count] = stages
    table[count, :count] = weights
    return table, np.append(nodes, 1.0)


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


DORMAND_PRINCE_8 = _dormand_prince_8()
DORMAND_PRINCE_5 = _dormand_prince_5()
