# SPDX-License-Identifier: Apache-2.0
"""Kernels that count no references to arrays: they keep none and lose none, and what they call counts as ever."""

import json
import math
import os
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from rollout_cases import CASES

from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel, kernel

ALLOCATIONS = """
import gc, json, sys
from numba.core.runtime import rtsys
from mech_twin.engine.rollout import roll_out
from mech_twin.parameters.load import machine

def left(built):
    roll_out(built, 0.3, columns=["time_s"])
    gc.collect()
    now = rtsys.get_allocation_stats()
    return now.mi_alloc - now.mi_free, now.mi_alloc

for name, overrides in json.loads(sys.argv[1]):
    built = machine(name, None, overrides)
    left(built)
    first, before = left(built)
    second, after = left(built)
    assert after > before, "a roll-out makes arrays"
    if second != first:
        print(name, overrides, second - first)
"""


compiled_only = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0",
    reason="looks at the compiler, which NUMBA_DISABLE_JIT has turned off",
)


class Pair(NamedTuple):
    """Two arrays and a number."""

    first: np.ndarray
    second: np.ndarray
    factor: float


@kernel
def _mean_of_copy(values):
    return np.mean(values + 0.0)


@kernel
def _doubled(values):
    return 2.0 * values


@inline_kernel
def _root_or_none(value):
    if value < 0.0:
        return math.nan
    return math.sqrt(value)


@borrowing_kernel
def _product(pair):
    total = 0.0
    for i in range(len(pair.first)):
        total += pair.factor * pair.first[i] * _root_or_none(pair.second[i])
    return total


@borrowing_kernel
def _mean(pair):
    return _mean_of_copy(pair.first)


@borrowing_kernel
def _new_array(values):
    return _doubled(values)


@borrowing_kernel
def _given(values):
    return values


@borrowing_kernel
def _inner(pair):
    return pair, 1.0


@kernel
def _calls_inner(pair):
    return _inner(pair)[1]


def _pair(second=4.0):
    return Pair(np.arange(3.0), np.full(3, second), 10.0)


def test_arrays_of_a_borrowing_kernel_are_held_as_often_as_before():
    pair = _pair()
    _product(pair)
    before = [sys.getrefcount(array) for array in pair[:2]]
    assert [_product(pair) for _ in range(100)] == [60.0] * 100
    assert [sys.getrefcount(array) for array in pair[:2]] == before


def test_every_return_of_a_kernel_in_line_is_taken():
    assert math.isnan(_product(_pair(-4.0)))
    assert _root_or_none(9.0) == 3.0


def test_a_kernel_that_makes_arrays_does_so_when_a_borrowing_one_calls_it_first():
    assert _mean(_pair()) == 1.0
    assert _mean_of_copy(np.arange(5.0)) == 2.0


@compiled_only
def test_a_borrowing_kernel_that_returns_a_new_array_is_refused():
    with pytest.raises(Exception, match="Only accept returning of array passed into the function"):
        _new_array(np.arange(3.0))


@compiled_only
def test_a_borrowing_kernel_that_returns_an_array_given_to_it_is_refused():
    with pytest.raises(TypeError, match=r"_given: .* must not return an array"):
        _given(np.arange(3.0))
    with pytest.raises(Exception, match=r"_inner: .* must not return an array"):
        _calls_inner(_pair())


@pytest.mark.slow
def test_a_roll_out_frees_every_array_it_made():
    environment = {**os.environ, "NUMBA_NRT_STATS": "1"}
    command = [sys.executable, "-c", ALLOCATIONS, json.dumps(CASES)]
    ran = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert ran.returncode == 0, ran.stderr
    assert not ran.stdout
