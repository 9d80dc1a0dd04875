# SPDX-License-Identifier: Apache-2.0
"""Root of a function of one variable, for what every run needs: `scipy.optimize` takes 0.2 s to import."""

from __future__ import annotations

from collections.abc import Callable


def root_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a root of a function between ``low`` and ``high`` by bisection, to the nearest double.

    Raises
    ------
    ValueError
        If the function has the same sign at both ends.
    """
    at_low, at_high = function(low), function(high)
    if at_low == 0.0 or at_high == 0.0:
        return low if at_low == 0.0 else high
    if (at_low > 0.0) == (at_high > 0.0):
        raise ValueError(f"same sign at {low:.17g} and {high:.17g}: {at_low:g}, {at_high:g}")
    while True:
        middle = 0.5 * (low + high)
        value = function(middle)
        if value == 0.0 or not low < middle < high:
            return middle
        if (value > 0.0) == (at_low > 0.0):
            low = middle
        else:
            high = middle
