# SPDX-License-Identifier: Apache-2.0
"""Rows behind a change of the order of events tell no derivative; rounding and keys without effect hide none."""

from __future__ import annotations

import numpy as np

from mech_twin.studies.identification.residuals import contradicting

ROWS = 400
FIRST = np.column_stack([np.linspace(50.0, 80.0, ROWS), np.linspace(-20.0, 30.0, ROWS)])


def test_a_stretch_in_which_the_slopes_disagree_is_left_out() -> None:
    other = FIRST.copy()
    other[380:, 0] *= -2.0
    assert np.flatnonzero(contradicting(FIRST, other)).tolist() == list(range(380, 400))


def test_smooth_derivatives_with_rounding_lose_no_row() -> None:
    random = np.random.default_rng(3)
    assert not contradicting(FIRST, FIRST + 1e-3 * random.standard_normal(FIRST.shape)).any()


def test_a_key_without_an_effect_has_no_say() -> None:
    noise = 1e-3 * np.random.default_rng(4).standard_normal((ROWS, 2))
    first = np.column_stack([FIRST, noise[:, 0]])
    assert not contradicting(first, np.column_stack([FIRST, noise[:, 1]])).any()


def test_where_most_rows_disagree_none_is_left_out() -> None:
    assert not contradicting(FIRST, -FIRST).any()
