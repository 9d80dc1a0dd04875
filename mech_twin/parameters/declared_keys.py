# SPDX-License-Identifier: Apache-2.0
"""The keys of a configuration with their declarations."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator
from typing import Any, NamedTuple

from pydantic.fields import FieldInfo

from mech_twin.declarations.quantity import Parameters


class Key(NamedTuple):
    """One key of a configuration: dotted name, declaration, and value (None if the option is absent)."""

    name: str
    field: FieldInfo
    value: Any

    @property
    def live(self) -> bool:
        """Whether the key may change while the machine runs."""
        extra = self.field.json_schema_extra
        return bool(isinstance(extra, dict) and extra.get("live"))

    @property
    def unit(self) -> str:
        """Unit of a number, empty if none is declared."""
        extra = self.field.json_schema_extra
        return str(extra.get("unit") or "") if isinstance(extra, dict) else ""


def keys(parameters: Parameters, prefix: str = "") -> Iterator[Key]:
    """Yield every key of a configuration, nested groups included."""
    for name, field in type(parameters).model_fields.items():
        value = getattr(parameters, name)
        if isinstance(value, Parameters):
            yield from keys(value, f"{prefix}{name}.")
        elif isinstance(value, dict):  # elements under names chosen by the user
            for own, element in value.items():
                if isinstance(element, Parameters):
                    yield from keys(element, f"{prefix}{name}.{own}.")
                else:
                    yield Key(f"{prefix}{name}.{own}", field, list(element))
        elif not _is_group(field.annotation):
            yield Key(prefix + name, field, list(value) if isinstance(value, tuple) else value)


def _is_group(annotation: Any) -> bool:
    options = typing.get_args(annotation) if isinstance(annotation, types.UnionType) else (annotation,)
    return any(isinstance(option, type) and issubclass(option, Parameters) for option in options)
