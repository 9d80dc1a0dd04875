# SPDX-License-Identifier: Apache-2.0
"""Kernels that kernels call: found by the type of the first argument, compiled for all values, linked once."""

from __future__ import annotations

from typing import NamedTuple

import pytest
from numba import config, int64
from numba.core.errors import TypingError

from mech_twin.kernels.dispatcher import generic, kernel_of, set_kernel
from mech_twin.kernels.kernel import kernel

compiled_only = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")


class Lever(NamedTuple):
    """A model with a kernel of its own."""

    arm_m: float


class Weight(NamedTuple):
    """A model without one."""

    mass_kg: float


@generic()
def moment_of(model: Lever, force_n: float) -> float:
    """Return a moment (N m)."""
    raise NotImplementedError


@generic(kernel)
def share_of(model: Lever | Weight, force_n: float) -> float:
    """Return the force (N) itself, for a type without a kernel."""
    return force_n


@kernel
def lever_moment(model: Lever, force_n: float) -> float:
    """Return force times arm (N m)."""
    return model.arm_m * force_n


@kernel
def half(model: Lever, force_n: float) -> float:
    """Return half the force (N)."""
    return 0.5 * force_n


set_kernel(moment_of, Lever, lever_moment)
set_kernel(share_of, Lever, half)


@kernel
def ask_moment(model: Lever, force_n: float) -> float:
    """Return the moment of a compiled call."""
    return moment_of(model, force_n)


@kernel
def ask_share(model: Lever | Weight, force_n: float) -> float:
    """Return the share of a compiled call."""
    return share_of(model, force_n)


@kernel
def shifted(number: int, by: int) -> int:
    """Return a sum."""
    return number + by


@kernel
def left(number: int) -> int:
    """Return a sum with a known and an unknown number."""
    return shifted(number, 1) + shifted(number, number)


@kernel
def right(number: int) -> int:
    """Return a sum with another known number."""
    return shifted(number, 2)


@kernel
def both(number: int) -> int:
    """Return a sum of two that call the same kernel."""
    return left(number) + right(number)


if not config.DISABLE_JIT:
    for each in (shifted, left, right, both):
        each._cache.disable()  # compiled anew in each process


def test_the_type_of_the_first_argument_chooses_the_kernel() -> None:
    lever, weight = Lever(0.25), Weight(3.0)
    assert ask_moment(lever, 8.0) == moment_of(lever, 8.0) == 2.0
    assert ask_share(lever, 8.0) == share_of(lever, 8.0) == 4.0
    assert ask_share(weight, 8.0) == share_of(weight, 8.0) == 8.0
    assert kernel_of(moment_of, Weight) is None


def test_a_type_without_a_kernel_is_refused() -> None:
    with pytest.raises(NotImplementedError):
        moment_of(Weight(3.0), 8.0)


@compiled_only
def test_the_compiler_refuses_a_type_without_a_kernel() -> None:
    with pytest.raises(TypingError, match="moment_of"):
        ask_moment(Weight(3.0), 8.0)


@compiled_only
def test_a_kernel_is_compiled_once_for_known_and_unknown_values() -> None:
    assert both(5) == 6 + 10 + 7
    assert list(shifted.overloads) == [(int64, int64)]


@compiled_only
def test_what_two_kernels_call_is_kept_and_linked_once() -> None:
    both(5)
    kept = [kernel.compile_for_kernel((int64,)).library.parts for kernel in (left, right)]
    own = shifted.overloads[int64, int64].library.parts
    assert set(own) == set(kept[0]) & set(kept[1])
    assert [len(parts) for parts in kept] == [len(own) + 1] * 2


@compiled_only
def test_a_library_of_numba_gets_a_kernel_with_what_it_calls() -> None:
    """The body of a parallel loop is compiled by numba, which links what it calls by itself."""
    module = left.compile_for_kernel((int64,)).library._get_module_for_linking()
    defined = [function.name for function in module.functions if not function.is_declaration]
    assert [sum(name in symbol for symbol in defined) for name in ("left", "shifted")] == [1, 1]
