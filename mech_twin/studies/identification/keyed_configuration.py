# SPDX-License-Identifier: Apache-2.0
"""A configuration as a function of some of its keys: values in, parameters and machine out, with scale and bounds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import BaseModel

from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.declarations.quantity import Parameters
from mech_twin.measurements.blocks import Array
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.studies.identification.acting_keys import acting_tree, number_in

SEARCHED = 20.0  # times larger and smaller than configured, where nothing else bounds a positive key
SHARE_OF_LIKE = 0.1  # of the largest key in the same unit: the scale of a key that is 0


@dataclass(frozen=True)
class KeyedConfiguration:
    """A machine whose configuration follows from the values of free keys.

    Parameters
    ----------
    name : str
        Machine of the catalogue.
    base : Parameters
        Every key that is not free.
    keys : tuple of str
        Free keys, dotted.
    """

    name: str
    base: Parameters
    keys: tuple[str, ...]

    @cached_property
    def tree(self) -> dict[str, Any]:
        """The base as a tree of values."""
        return configuration_tree(self.base)

    @cached_property
    def acting(self) -> dict[str, Any]:
        """The same without the values that follow from a free key.

        Raises
        ------
        ConfigurationError
            The machine accepts no other value of a key.
        """
        return acting_tree(self.name, self.base, self.keys)

    def check(self) -> None:
        """Raise a ConfigurationError where a key is unknown, or the machine accepts no other value of it."""
        self.values()
        self.acting  # noqa: B018

    def values(self) -> Array:
        """Return the free keys as configured, shape (keys,).

        Raises
        ------
        ConfigurationError
            A key is unknown or no number.
        """
        return np.array([number_at(self.tree, key, self.name) for key in self.keys])

    def parameters(self, values: Sequence[float] | Array) -> Parameters:
        """Return the configuration with these values of the free keys.

        Raises
        ------
        ConfigurationError
            The machine refuses them.
        """
        flat = dict(zip(self.keys, map(float, values), strict=True))
        tree = merged_tree(self.acting, tree_from_flat(flat, "--free"))
        return validated(catalogue_entry(self.name), tree, f"{self.name} with --free {', '.join(self.keys)}")

    def scales(self) -> Array:
        """Return the size of each key; of one that is 0, a share of the largest key in its unit, shape (keys,)."""
        return np.array([_scale(self.tree, self.base, key) for key in self.keys])

    def bounds(self, given: Mapping[str, tuple[float, float]] | None = None) -> Array:
        """Return the least and largest value of each key, shape (2, keys): as given, else as declared and searched."""
        found = []
        for key, value in zip(self.keys, self.values().tolist(), strict=True):
            low, high = declared_bounds(type(self.base), key)
            if given and key in given:
                low, high = max(low, given[key][0]), min(high, given[key][1])
            elif value > 0.0:
                low, high = max(low, value / SEARCHED), min(high, value * SEARCHED)
            elif value < 0.0:
                low, high = max(low, value * SEARCHED), min(high, value / SEARCHED)
            if not low <= value <= high:
                raise ConfigurationError(
                    f"--free {key}={low:g}:{high:g}: expected bounds on either side of the configured {value:g}"
                )
            found.append((low, high))
        return np.array(found).reshape(-1, 2).T


def number_at(tree: Mapping[str, Any], key: str, machine: str) -> float:
    """Return the number a dotted key has in a tree of values."""
    found = number_in(tree, key)
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise ConfigurationError(f"--free {key}: expected a key of {machine} that is a number")
    return float(found)


def numbers_of(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yield every dotted key of a tree that holds a number that is not whole by declaration, and the number."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from numbers_of(value, f"{prefix}{name}.")
        elif isinstance(value, float):
            yield prefix + name, value


def declared_bounds(model: type[BaseModel], key: str) -> tuple[float, float]:
    """Return the bounds a key is declared with; infinite where it has none."""
    field = declared_field(model, key)
    marks = [] if field is None else field.metadata
    low = max((v for mark in marks if (v := _bound(mark, "ge", "gt")) is not None), default=-np.inf)
    high = min((v for mark in marks if (v := _bound(mark, "le", "lt")) is not None), default=np.inf)
    return low, high


def _bound(mark: Any, *names: str) -> float | None:
    return next((float(found) for name in names if (found := getattr(mark, name, None)) is not None), None)


def declared_field(model: type[BaseModel], key: str) -> Any:
    """Return the declaration of a dotted key, None where it has none."""
    first, _, rest = key.partition(".")
    field = model.model_fields.get(first)
    if field is None or not rest:
        return field
    for kind in (field.annotation, *getattr(field.annotation, "__args__", ())):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found = declared_field(kind, rest)
            if found is not None:
                return found
    return None


def unit_at(model: type[BaseModel], key: str) -> str:
    """Return the unit a dotted key is declared in, an empty word where it has none."""
    field = declared_field(model, key)
    extra = None if field is None else field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def _scale(tree: Mapping[str, Any], base: Parameters, key: str) -> float:
    value = abs(number_at(tree, key, "the machine"))
    if value > 0.0:
        return value
    unit = unit_at(type(base), key)
    like = [abs(each) for name, each in numbers_of(tree) if unit_at(type(base), name) == unit and np.isfinite(each)]
    return SHARE_OF_LIKE * max(like, default=0.0) or 1.0
