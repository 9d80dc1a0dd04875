# SPDX-License-Identifier: Apache-2.0
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays

from mech_twin.view.sending import extreme_rows

CURVES = arrays(
    np.float64,
    st.tuples(st.integers(0, 60), st.integers(1, 4)),
    elements=st.floats(-1e9, 1e9, allow_nan=False),
)


@given(values=CURVES, window=st.integers(1, 20))
def test_every_window_keeps_its_smallest_and_largest_value(values, window):
    kept = extreme_rows(values, window)
    for start in range(0, len(values), window):
        full = values[start : start + window]
        thin = values[kept[(kept >= start) & (kept < start + window)]]
        assert np.array_equal(thin.min(axis=0), full.min(axis=0))
        assert np.array_equal(thin.max(axis=0), full.max(axis=0))


@given(values=CURVES, window=st.integers(3, 20))
def test_rows_ascend_and_are_at_most_two_a_curve_and_window(values, window):
    kept = extreme_rows(values, window)
    assert (np.diff(kept) > 0).all()
    windows = -(-len(values) // window)
    assert len(kept) <= min(len(values), 2 * values.shape[1] * windows)


def test_a_spike_of_one_sample_survives_at_its_own_row():
    values = np.sin(np.linspace(0.0, 6.0, 1000))
    values[377] = 50.0
    assert 377 in extreme_rows(values, 25)
    assert len(extreme_rows(values, 25)) <= 80


def test_a_value_that_is_not_a_number_is_not_hidden():
    values = np.zeros(100)
    values[42] = np.nan
    assert 42 in extreme_rows(values, 10)


def test_a_window_without_rows_is_refused():
    with pytest.raises(ValueError, match="at least 1 row, got 0"):
        extreme_rows(np.zeros(3), 0)
