# SPDX-License-Identifier: Apache-2.0
"""The methods' numbers are those of scipy, to the bit, which has the same ones from their authors."""

import numpy as np
from scipy.integrate import DOP853, RK45

from mech_twin.engine.integration import DORMAND_PRINCE_5, DORMAND_PRINCE_8


def test_order_8_has_the_numbers_of_scipy() -> None:
    method, count = DORMAND_PRINCE_8, DOP853.n_stages
    stages = np.vstack([np.pad(DOP853.A[:count, :count], ((0, 0), (0, 4))), np.zeros(16), DOP853.A_EXTRA])
    stages[count, :count] = DOP853.B
    assert method.stages.tolist() == stages.tolist()
    assert method.nodes.tolist() == [*DOP853.C[:count], 1.0, *DOP853.C_EXTRA]
    assert method.weights.tolist() == DOP853.B.tolist()
    assert method.errors.tolist() == [DOP853.E5.tolist(), DOP853.E3.tolist()]


def test_order_8_interpolates_as_scipy_does() -> None:
    random = np.random.default_rng(8)
    slopes, y, h = random.standard_normal((16, 3)), random.standard_normal(3), 0.3
    end = y + h * DORMAND_PRINCE_8.weights @ slopes[:12]
    rest = np.vstack([end - y, h * slopes[0] - (end - y), 2.0 * (end - y) - h * (slopes[12] + slopes[0])])
    dense = np.vstack([rest, h * DOP853.D @ slopes])
    for share in (0.0, 0.1, 0.5, 0.9, 1.0):
        expected = np.zeros(3)  # DOP853's dense output is evaluated from its last term on
        for i, term in enumerate(dense[::-1]):
            expected = (expected + term) * (share if i % 2 == 0 else 1.0 - share)
        powers = share ** np.arange(1, 8)
        found = h * (DORMAND_PRINCE_8.interpolant @ powers) @ slopes
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)


def test_order_5_has_the_numbers_of_scipy() -> None:
    method = DORMAND_PRINCE_5
    assert method.stages[:6, :5].tolist() == RK45.A.tolist()
    assert method.stages[6].tolist() == [*RK45.B, 0.0]
    assert method.nodes.tolist() == [*RK45.C, 1.0]
    assert method.weights.tolist() == RK45.B.tolist()
    assert method.errors.tolist() == [RK45.E.tolist()]
    assert method.interpolant.tolist() == RK45.P.tolist()
