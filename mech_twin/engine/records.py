# SPDX-License-Identifier: Apache-2.0
"""Rows with named numbers: structured records that share the memory of an array, in compiled and plain code.

``array.view(dtype)[0]`` is such a record.  In compiled code it does not keep the array alive: create it only where
the array is an argument or is still used later.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


def record_of(fields: type[NamedTuple]) -> np.dtype[Any]:
    """Return the numpy dtype of a record with the fields of a `NamedTuple`, all of them float64."""
    return np.dtype((np.record, [(name, np.float64) for name in fields._fields]))
