# SPDX-License-Identifier: Apache-2.0
"""Values by their place in memory: in a call one number goes over instead of all those of a large tuple.

A value is kept as long as the kernel runs in which its place was asked for; no references to its arrays are counted.
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
    """Return where a value is kept."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = build.alloca_once_value(builder, arguments[0])
        return builder.bitcast(place, context.get_value_type(signature.return_type))

    return types.CPointer(value)(value), generate


def _number(typing_context: Any, place: Any) -> Any:
    """Return a place as a number."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ptrtoint(arguments[0], ir.IntType(64))

    return types.int64(place), generate


def _load(typing_context: Any, place: Any) -> Any:
    """Return the value that is kept at a place."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kept = context.get_value_type(place.dtype).as_pointer()
        return builder.load(builder.bitcast(arguments[0], kept))

    return place.dtype(place), generate


def _same(value: Any) -> Any:
    """Return the value: uncompiled code has no places."""
    return value


place_of: Any = _same if interpreted else intrinsic(_keep)
number_of: Any = _same if interpreted else intrinsic(_number)
value_at: Any = _same if interpreted else intrinsic(_load)
