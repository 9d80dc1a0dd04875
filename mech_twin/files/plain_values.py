# SPDX-License-Identifier: Apache-2.0
"""Converts dataclasses and named tuples to JSON values, and back by the types of their fields."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np


def plain(value: Any) -> Any:
    """Return a value as JSON values: dataclasses and named tuples as objects, NaN and infinity as None."""
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    elif hasattr(value, "_asdict"):
        value = value._asdict()
    elif hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def of_plain(kind: Any, value: Any) -> Any:
    """Return the value of a type from the JSON values that `plain` made; a missing field keeps its default.

    Raises
    ------
    TypeError
        A field without a default is missing.
    """
    origin, of = get_origin(kind), get_args(kind)
    if type(None) in of:
        return None if value is None else of_plain(of[0], value)
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        hints = get_type_hints(kind)
        return kind(**{name: of_plain(hints[name], each) for name, each in value.items()})
    if origin is np.ndarray:
        return np.array(value, dtype=np.float64)
    if origin is tuple:
        return tuple(of_plain(of[0], each) for each in value)
    if isinstance(value, Mapping):
        return {key: of_plain(of[1], each) for key, each in value.items()}
    return float(value) if kind is float else value
