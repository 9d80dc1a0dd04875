# SPDX-License-Identifier: Apache-2.0
"""Search by runs on a problem with edges: the peak of a torque over a turn, its smallest value limited."""

import numpy as np
import pytest
from scipy.optimize import linprog

from mech_twin.studies.run_search import JudgedPoint, refined_from

TURN = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
TORQUE = 1.0 + 2.0 * np.sin(2.0 * TURN) - 0.5 * np.cos(3.0 * TURN)  # N m, without a counterweight
WEIGHT = 4.0 * np.column_stack((np.cos(TURN), -np.sin(TURN)))  # N m, of each share of a counterweight


class Torque:
    """A counterweight, its place between -1/2 and 1/2 along and across the crank, as a search judges it."""

    def __init__(self, least_nm):
        self.least_nm, self.judgements = least_nm, 0

    def judged(self, place):
        """Return the peak, and the margin of the smallest torque."""
        self.judgements += 1
        point = np.clip(place, 0.0, 1.0)
        torque = TORQUE + WEIGHT @ (point - 0.5)
        return JudgedPoint(tuple(point), float(torque.max()), (float(torque.min()) - self.least_nm, 0.0))

    def best(self):
        """Return the least peak, by linear programming."""
        ones = np.ones((len(TURN), 1))
        upper = np.vstack((np.hstack((WEIGHT, -ones)), np.hstack((-WEIGHT, 0.0 * ones))))
        bound = np.concatenate((-TORQUE, TORQUE - self.least_nm))
        return linprog([0.0, 0.0, 1.0], upper, bound, bounds=[(-0.5, 0.5), (-0.5, 0.5), (None, None)]).fun


@pytest.mark.parametrize("start", [(0.2, 0.3), (0.8, 0.4), (0.6, 0.9), (0.5, 0.5)])
@pytest.mark.parametrize("least_nm", [-5.0, -1.9, -1.6, -1.45])
def test_edges_of_peak_and_limit_do_not_end_a_refinement(start, least_nm):
    asked = Torque(least_nm)
    found = refined_from(asked, start)
    assert found.rank[0] == 0.0
    assert found.objective == pytest.approx(asked.best(), rel=0.005)
    assert asked.judgements <= 80
