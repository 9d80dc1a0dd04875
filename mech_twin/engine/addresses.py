# SPDX-License-Identifier: Apache-2.0
"""Pointers to values in compiled code: a call passes one address instead of all the numbers of a large tuple.

An address is valid while the kernel that took it runs; references to arrays of the value are not counted.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils
from numba.extending import intrinsic

types: Any = numba.types  # numba has type hints for its front only
build: Any = cgutils
interpreted = bool(numba.core.config.DISABLE_JIT)  # type: ignore[attr-defined]


def _keep(typing_context: Any, value: Any) -> Any:
    """Return a pointer to a copy of a value on the stack (numba intrinsic)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = build.alloca_once_value(builder, arguments[0])
        return builder.bitcast(place, context.get_value_type(signature.return_type))

    return types.CPointer(value)(value), generate


def _number(typing_context: Any, place: Any) -> Any:
    """Return a pointer as an integer (numba intrinsic)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ptrtoint(arguments[0], ir.IntType(64))

    return types.int64(place), generate


def _load(typing_context: Any, place: Any) -> Any:
    """Return the value that a pointer points to (numba intrinsic)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kept = context.get_value_type(place.dtype).as_pointer()
        return builder.load(builder.bitcast(arguments[0], kept))

    return place.dtype(place), generate


def _same(value: Any) -> Any:
    """Return the value itself: interpreted code has no pointers."""
    return value


place_of: Any = _same if interpreted else intrinsic(_keep)
number_of: Any = _same if interpreted else intrinsic(_number)
value_at: Any = _same if interpreted else intrinsic(_load)
