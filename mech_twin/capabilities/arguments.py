# SPDX-License-Identifier: Apache-2.0
"""Validation of arguments of the Python interface; a refusal is a StudyError with name, value and what is expected."""

import math
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any, TypeGuard

import numpy as np

from mech_twin.errors import StudyError

GREATEST_SEED = 2**63 - 1


def is_number(value: Any) -> TypeGuard[float]:
    """Return whether a value is a real number, also of numpy, but not a boolean."""
    return not isinstance(value, bool) and isinstance(value, Real)


def real_number(name: str, value: Any, expected: str, least: float = -math.inf, most: float = math.inf) -> float:
    """Return a finite number within bounds.

    Examples
    --------
    >>> real_number("duration_s", 3, "seconds", 0.0)
    3.0
    """
    if is_number(value) and least <= value <= most and math.isfinite(value):
        return float(value)
    raise StudyError(f"{name} {_shown(value)}: expected {expected}")


def whole_number(name: str, value: Any, least: int, most: int) -> int:
    """Return a whole number within bounds."""
    if not is_number(value) or not least <= value <= most or value != int(value):
        raise StudyError(f"{name}: expected a whole number from {least} to {most}, got {_shown(value)}")
    return int(value)


def bounds_by_name(name: str, value: Any, expected: str) -> dict[str, tuple[float, float]]:
    """Return a mapping to a lower and an upper number, which may be infinite; an empty one for None."""
    found = {}
    for key, pair in by_name(name, value, expected).items():
        both = sequence_items(f"{name} of {key}", pair, "a lower and an upper number")
        if len(both) != 2 or not all(map(is_number, both)):
            raise StudyError(f"{name} of {key} {_shown(pair)}: expected a lower and an upper number")
        found[key] = (float(both[0]), float(both[1]))
    return found


def by_name(name: str, value: Any, expected: str) -> dict[str, Any]:
    """Return a mapping as a dictionary; an empty one for None."""
    if value is None:
        return {}
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise StudyError(f"{name} {_shown(value)}: expected {expected}")
    return dict(value)


def sequence_items(name: str, value: Any, expected: str) -> tuple[Any, ...]:
    """Return the items of a sequence that is not a string; numpy scalars are converted to Python numbers."""
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        raise StudyError(f"{name} {_shown(value)}: expected {expected}")
    return tuple(item.item() if isinstance(item, np.generic) else item for item in value)


def _shown(value: Any) -> str:
    return " ".join(repr(value.item() if isinstance(value, np.generic) else value).split())[:80]
