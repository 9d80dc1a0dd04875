# SPDX-License-Identifier: Apache-2.0
"""Laws of recorded arithmetic: it gives what floats give, and folds what is constant."""

from __future__ import annotations

import pytest

from mech_twin.mechanics.code_generation import Recording, cosine, generated, larger, power, sine, square_root


def formula(x, y):
    """Return a few numbers of two."""
    return [x * y - y / x, sine(x) * cosine(y) + square_root(x * x + y * y), larger(x, y) * power(x, 1.5), -(x - y)]


def test_a_recorded_formula_gives_what_floats_give():
    recording = Recording()
    made = generated({"formula": formula(recording.leaf("state[0]"), recording.leaf("state[1]"))})["formula"]
    out = [0.0] * 4
    made.function([], [], 0.0, [0.7, 2.3], out)
    assert out == pytest.approx(formula(0.7, 2.3), rel=1e-15)


def test_zeros_and_ones_leave_no_operation():
    recording = Recording()
    x = recording.leaf("state[0]")
    assert 0.0 * x == 0.0
    assert (1.0 * x).index == x.index
    assert (x + 0.0).index == x.index
    assert x - x == 0.0
    assert len(recording.nodes) == 1


def test_equal_expressions_are_kept_once_and_a_constant_is_no_index():
    recording = Recording()
    x, y = recording.leaf("state[0]"), recording.leaf("state[1]")
    assert (x * y + 1.0).index == (y * x + 1.0).index
    assert (x + 1.0).index != (x + y).index  # y is node 1
