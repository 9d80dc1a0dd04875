# SPDX-License-Identifier: Apache-2.0
"""Pointers to values, and rows with named numbers, in compiled code.

A call passes one address instead of all the numbers of a large tuple.

An address is valid while the kernel that took it runs; references to arrays of the value are not counted.

A record names the numbers of a row and shares the memory of its array, in compiled and plain code.  It does not keep
the array alive: create it only where the array is an argument or is still used later.
"""

from collections.abc import Iterable
from math import prod
from typing import Any

import numba
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

types: Any = numba.types  # numba has type hints for its front only
build: Any = cgutils
fill: Any = populate_array
borrowed: Any = impl_ret_borrowed
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


def _view(typing_context: Any, array: Any, *lengths: Any) -> Any:
    """Return the start of a contiguous array as an array of the given lengths (numba intrinsic)."""
    kind = types.Array(array.dtype, len(lengths), "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        given = context.make_array(array)(context, builder, arguments[0])
        size = context.get_abi_sizeof(context.get_data_type(array.dtype))
        view, stride = context.make_array(kind)(context, builder), context.get_constant(types.intp, size)
        shape = [builder.extract_value(arguments[1], i) for i in range(len(lengths))]
        strides = [stride]
        for length in shape[:0:-1]:
            strides.insert(0, builder.mul(strides[0], length))
        item = context.get_constant(types.intp, size)
        parts = {"data": given.data, "meminfo": given.meminfo, "parent": given.parent, "itemsize": item}
        fill(view, shape=shape, strides=strides, **parts)
        return borrowed(context, builder, kind, view._getvalue())

    return kind(array, types.StarArgTuple(lengths)), generate


def _seen_as(array: Any, *lengths: int) -> Any:
    """Return the start of a contiguous array as an array of the given lengths."""
    return array.reshape(-1)[: prod(lengths)].reshape(lengths)


def _same(value: Any) -> Any:
    """Return the value itself: interpreted code has no pointers."""
    return value


place_of: Any = _same if interpreted else intrinsic(_keep)
number_of: Any = _same if interpreted else intrinsic(_number)
# in compiled code loops over constant lengths are unrolled
view_as: Any = _seen_as if interpreted else intrinsic(_view)
value_at: Any = _same if interpreted else intrinsic(_load)


def record_of(names: Iterable[str]) -> np.dtype[Any]:
    """Return the numpy dtype of a record with fields of these names, all of them float64."""
    return np.dtype((np.record, [(name, np.float64) for name in names]))


def _sliced(row: NDArray[np.float64], place: int, kind: np.dtype[Any]) -> Any:
    """Return the record at a place of a row."""
    return row[place : place + kind.itemsize // row.itemsize].view(kind)[0]


def _pointed(typing_context: Any, row: Any, place: Any, kind: Any) -> Any:
    """Return the record at a place of a row, without counting a reference to it (numba intrinsic)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        numbers = context.make_array(row)(context, builder, arguments[0]).data
        return builder.bitcast(builder.gep(numbers, [arguments[1]]), context.get_value_type(kind.dtype))

    return kind.dtype(row, place, kind), generate


record_at: Any = _sliced if interpreted else intrinsic(_pointed)
