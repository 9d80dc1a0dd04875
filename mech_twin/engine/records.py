# SPDX-License-Identifier: Apache-2.0
"""Rows of numbers by name: records that share the numbers of an array, in compiled code and out of it.

``array.view(dtype)[0]`` is such a record.  In compiled code it does not keep the array alive: make it where the array
is an argument, or is used later still.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


def record_of(fields: type[NamedTuple]) -> np.dtype[Any]:
    """Return the type of a record with the fields of a `NamedTuple`, all of them float64."""
    return np.dtype((np.record, [(name, np.float64) for name in fields._fields]))
