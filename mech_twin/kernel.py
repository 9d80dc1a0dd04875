# SPDX-License-Identifier: Apache-2.0
"""The decorator of every compiled kernel: one set of compiler options, one cache, typed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit
from numba.core.dispatcher import Dispatcher

from mech_twin.kernel_cache import KernelCache, compiled_count, on_compile

__all__ = ["compiled_count", "kernel", "on_compile", "parallel_kernel", "released_kernel"]

Function = TypeVar("Function", bound=Callable[..., object])


def kernel(function: Function) -> Function:
    """Return the function compiled on first call and cached on disk; strict arithmetic, so runs repeat to the bit."""
    return cast(Function, _cached(njit(fastmath=False)(function), "serial"))


def released_kernel(function: Function) -> Function:
    """Return the function compiled like `kernel`, running without the interpreter's lock: for calls from threads."""
    return cast(Function, _cached(njit(fastmath=False, nogil=True)(function), "released"))


def parallel_kernel(function: Function) -> Function:
    """Return the function compiled for all cores: for batches whose iterations are independent of each other.

    The same strict arithmetic; each result depends on its own iteration only, so the number of cores changes nothing.
    """
    return cast(Function, _cached(njit(fastmath=False, parallel=True)(function), "parallel"))


def _cached(compiled: object, options: str) -> object:
    """Give a dispatcher of numba the cache whose key is content; with NUMBA_DISABLE_JIT there is no dispatcher."""
    if isinstance(compiled, Dispatcher):
        dispatcher: Any = compiled
        dispatcher._cache = KernelCache(dispatcher.py_func, options)
    return compiled
