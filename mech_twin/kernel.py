"""The decorator of every compiled kernel: one set of compiler options, typed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., object])


def kernel(function: Function) -> Function:
    """Return the function compiled on first call and cached on disk; strict arithmetic, so runs repeat to the bit."""
    return cast(Function, njit(cache=True, fastmath=False)(function))


def parallel_kernel(function: Function) -> Function:
    """Return the function compiled for all cores: for batches whose iterations are independent of each other.

    The same strict arithmetic; each result depends on its own iteration only, so the number of cores changes nothing.
    """
    return cast(Function, njit(cache=True, fastmath=False, parallel=True)(function))
