# SPDX-License-Identifier: Apache-2.0
"""Rows with named numbers: structured records that share the memory of an array, in compiled and plain code.

A record does not keep the array alive: create it only where the array is an argument or is still used later.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

from mech_twin.engine.addresses import interpreted


def record_of(fields: type[NamedTuple]) -> np.dtype[Any]:
    """Return the numpy dtype of a record with the fields of a `NamedTuple`, all of them float64."""
    return np.dtype((np.record, [(name, np.float64) for name in fields._fields]))


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
