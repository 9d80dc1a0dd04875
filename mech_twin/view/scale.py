# SPDX-License-Identifier: Apache-2.0
"""Round numbers for axes and scale bars, and formatting of values in a figure."""

from __future__ import annotations

import math

PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"))


def round_above(value: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is not below the value; 1 for zero."""
    if not (value > 0.0 and math.isfinite(value)):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0, 20.0) if step * power >= value)


def with_prefix(value: float, unit: str) -> str:
    """Return a value to three digits with an SI prefix: 1731 N is ``1.73 kN``; a value below 1e-6 is 0."""
    for factor, prefix in PREFIXES:
        if abs(value) >= factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    return f"0 {unit}" if abs(value) < PREFIXES[-1][0] else f"{value} {unit}"
