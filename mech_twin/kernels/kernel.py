# SPDX-License-Identifier: Apache-2.0
"""The decorator of every compiled kernel: one set of compiler options, one cache, typed."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba.core import config

from mech_twin.kernels.cache import KernelCache, compiled_count, on_compile
from mech_twin.kernels.dispatcher import KernelDispatcher

__all__ = [
    "borrowing_kernel",
    "compiled_count",
    "embedded_kernel",
    "inline_kernel",
    "kernel",
    "on_compile",
    "parallel_kernel",
    "released_kernel",
    "straight_line_kernel",
]

Function = TypeVar("Function", bound=Callable[..., object])

_settings: Any = config

# strict arithmetic, so that runs repeat to the bit; whether references to arrays are counted is always said, since a
# function that does not say so does as its first caller
_STRICT: dict[str, Any] = {"nopython": True, "fastmath": False, "_nrt": True}
_BORROWING: dict[str, Any] = {**_STRICT, "_nrt": False}


def kernel(function: Function) -> Function:
    """Return the function compiled on first call and cached on disk; strict arithmetic, so runs repeat to the bit."""
    return cast(Function, _compiled(function, "serial", _STRICT))


def borrowing_kernel(function: Function) -> Function:
    """Return the function compiled like `kernel`, without counting references to the arrays that it reads or fills.

    For the inner loops of an integration, where counting took more time than the equation: the caller keeps the arrays
    alive.  Such a function makes no array, returns none and copies none as a whole (``a[:] = b``); one that does is
    refused when it is compiled.
    """
    return cast(Function, _compiled(function, "borrowing", _BORROWING, _BorrowingCache))


def straight_line_kernel(function: Function) -> Function:
    """Return the function compiled like `borrowing_kernel`, with division as IEEE 754 has it: no branch, no error."""
    return cast(Function, _compiled(function, "straight line", {**_BORROWING, "error_model": "numpy"}, _BorrowingCache))


def embedded_kernel(function: Function) -> Function:
    """Return the function compiled like `borrowing_kernel`, and merged into its callers by the optimiser.

    For what an equation of motion is made of: a call would copy all numbers of its constants.
    """
    return cast(Function, _compiled(function, "embedded", {**_BORROWING, "forceinline": True}, _BorrowingCache))


def inline_kernel(function: Function) -> Function:
    """Return the function compiled like `borrowing_kernel`, and put in line in its callers before they are typed.

    For views and addresses of what the caller has.  Each caller is typed with it, which takes longer than merging; but
    of the breaker's equations merging made ten times the code.
    """
    return cast(Function, _compiled(function, "inline", {**_BORROWING, "inline": "always"}, _BorrowingCache))


def released_kernel(function: Function) -> Function:
    """Return the function compiled like `kernel`, running without the interpreter's lock: for calls from threads."""
    return cast(Function, _compiled(function, "released", {**_STRICT, "nogil": True}))


def parallel_kernel(function: Function) -> Function:
    """Return the function compiled for all cores: for batches whose iterations are independent of each other.

    The same strict arithmetic; each result depends on its own iteration only, so the number of cores changes nothing.
    """
    return cast(Function, _compiled(function, "parallel", {**_STRICT, "parallel": True}))


class _BorrowingCache(KernelCache):
    """Keeps no kernel that returns an array.

    The compiler notices one that the kernel made, but not one that was handed to it: its caller, which counts, would
    give up a reference that nobody took.
    """

    def save_overload(self, signature: Any, result: Any) -> None:
        """Store compiled code; see `KernelCache.save_overload`.

        Raises
        ------
        TypeError
            The kernel returns an array.
        """
        model = result.target_context.data_model_manager[result.signature.return_type]
        if model.contains_nrt_meminfo():
            raise TypeError(f"{self.kernel_name}: a kernel that counts no references must not return an array")
        super().save_overload(signature, result)


def _compiled(function: Any, name: str, options: dict[str, Any], cache: type[KernelCache] = KernelCache) -> object:
    """Return numba's dispatcher of a function, with the content-keyed cache; with NUMBA_DISABLE_JIT the function."""
    if _settings.DISABLE_JIT:
        return function
    dispatcher = KernelDispatcher(function, targetoptions=options)
    dispatcher._cache = cache(function, name)
    return dispatcher
