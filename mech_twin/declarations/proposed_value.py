# SPDX-License-Identifier: Apache-2.0
"""Suggests values in error messages: short, and with a margin to the limit that was violated."""

from __future__ import annotations

import math
from collections.abc import Callable


def at_most(limit: float, reserve: float = 0.05) -> float:
    """Return a suggested value below an upper limit: two digits, with a relative margin ``reserve``.

    Examples
    --------
    >>> at_most(0.2563)
    0.24
    """
    return _two_digits((1.0 - reserve) * limit, math.floor)


def at_least(limit: float, reserve: float = 0.05) -> float:
    """Return a suggested value above a lower limit; see `at_most`.

    Examples
    --------
    >>> at_least(0.2563)
    0.27
    """
    return _two_digits((1.0 + reserve) * limit, math.ceil)


def _two_digits(value: float, rounding: Callable[[float], int]) -> float:
    places = 1 - math.floor(math.log10(value))
    return rounding(value * 10.0**places) / 10.0**places
