# SPDX-License-Identifier: Apache-2.0
"""Laws of recorded arithmetic: it gives what floats give, folds what is constant, and has exact tangents."""

from __future__ import annotations

import math

import pytest

from mech_twin.mechanics.recording import (
    Expression,
    Recording,
    cosine,
    generated,
    larger,
    power,
    sine,
    square_root,
    tangents,
)


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


def test_tangents_are_the_derivatives():
    recording = Recording()
    x, y = recording.leaf("state[0]"), recording.leaf("state[1]")
    outputs = [x * y - y / x, sine(x) * cosine(y) + square_root(x * x + y * y)]
    rates = tangents(outputs, {x.index: 1.0})
    assert all(isinstance(rate, Expression) for rate in rates)
    made = generated({"rates": rates})["rates"]
    out = [0.0, 0.0]
    made.function([], [], 0.0, [0.7, 2.3], out)
    root = math.hypot(0.7, 2.3)
    assert out == pytest.approx([2.3 + 2.3 / 0.49, math.cos(0.7) * math.cos(2.3) + 0.7 / root], rel=1e-14)
