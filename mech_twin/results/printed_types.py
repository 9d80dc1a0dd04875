# SPDX-License-Identifier: Apache-2.0
"""A type of named and typed fields, read from what `print_json` made of it.

There null is a number that was not finite, and a row may tell more than its fields: what follows from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from itertools import repeat
from math import nan
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter

Read = TypeVar("Read")
STRICT = "__pydantic_config__"  # of a type that says itself which further keys it takes


def read_as(kind: type[Read], document: Any) -> Read:
    """Return a document as a dataclass or a named tuple, and what is in it likewise.

    Raises
    ------
    ValidationError
        Naming every key that is not as the type says.
    """
    return TypeAdapter(kind).validate_python(_filled(kind, document))


def _filled(kind: Any, value: Any, absent: float = nan) -> Any:
    """Return a value with ``absent`` for a null that is no number, without what a type does not have."""
    inside = get_args(kind)
    if kind is float:
        return absent if value is None else value
    if get_origin(kind) in (Union, UnionType):
        return value if value is None else _filled(inside[0], value)
    if isinstance(value, list) and inside:
        kinds = inside if len(inside) == len(value) and ... not in inside else repeat(inside[0])
        return [_filled(each, one) for each, one in zip(kinds, value, strict=False)]
    if isinstance(value, Mapping) and inside:
        return {key: _filled(inside[1], one) for key, one in value.items()}
    if not isinstance(value, Mapping) or not (is_dataclass(kind) or hasattr(kind, "_fields")):
        return value
    hints, defaults = get_type_hints(kind), getattr(kind, "_field_defaults", {})
    rest = {key: one for key, one in value.items() if key not in hints and hasattr(kind, STRICT)}
    own = {key: _filled(hints[key], one, defaults.get(key, nan)) for key, one in value.items() if key in hints}
    return own | rest
