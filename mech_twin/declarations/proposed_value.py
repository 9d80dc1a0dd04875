# SPDX-License-Identifier: Apache-2.0
"""Values to propose where one was refused: short to type, and clear of the limit that the refused one broke."""

from __future__ import annotations

import math
from collections.abc import Callable


def at_most(limit: float, reserve: float = 0.05) -> float:
    """Return a value to propose below an upper limit: two digits, and a reserve that keeps clear of the limit.

    Examples
    --------
    >>> at_most(0.2563)
    0.24
    """
    return _two_digits((1.0 - reserve) * limit, math.floor)


def at_least(limit: float, reserve: float = 0.05) -> float:
    """Return a value to propose above a lower limit; see `at_most`.

    Examples
    --------
    >>> at_least(0.2563)
    0.27
    """
    return _two_digits((1.0 + reserve) * limit, math.ceil)


def _two_digits(value: float, rounding: Callable[[float], int]) -> float:
    places = 1 - math.floor(math.log10(value))
    return rounding(value * 10.0**places) / 10.0**places
