# SPDX-License-Identifier: Apache-2.0
"""A configuration as nested groups of plain values: values merged into it, and values suggested in error messages."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import OneLineError


def at_most(limit: float) -> float:
    """Return a suggested value 5 % below an upper limit, to two digits.

    Examples
    --------
    >>> at_most(0.2563)
    0.24
    """
    return _two_digits(0.95 * limit, math.floor)


def at_least(limit: float) -> float:
    """Return a suggested value above a lower limit; see `at_most`.

    Examples
    --------
    >>> at_least(0.2563)
    0.27
    """
    return _two_digits(1.05 * limit, math.ceil)


def _two_digits(value: float, rounding: Callable[[float], int]) -> float:
    places = 1 - math.floor(math.log10(value))
    return rounding(value * 10.0**places) / 10.0**places


def configuration_tree(parameters: Parameters) -> dict[str, Any]:
    """Return the parameters as nested plain values, absent options left out."""
    return parameters.model_dump(mode="json", exclude_none=True)


def tree_from_json(tree: Any, absent: float = math.inf) -> Any:
    """Return the tree of a configuration from JSON, where null stands for ``absent``."""
    if isinstance(tree, Mapping):
        return {key: tree_from_json(value, absent) for key, value in tree.items()}
    if isinstance(tree, list):
        return [tree_from_json(value, absent) for value in tree]
    return absent if tree is None else tree


def merged_tree(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` updated with ``over``, group by group; ``key.0`` is the first item of a list."""
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        if isinstance(below, list | tuple) and isinstance(value, dict):
            row = {str(place): item for place, item in enumerate(below)}
            merged[key] = list(merged_tree(row, value).values()) if value.keys() <= row.keys() else value
            continue
        merged[key] = merged_tree(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged


def tree_from_flat(flat: Mapping[str, Any], source: str = "--set") -> dict[str, Any]:
    """Return a nested dictionary from dotted keys, whose values may be nested too.

    Raises
    ------
    ConfigurationError
        If a key is both a value and a group, or stands twice.
    """
    tree: dict[str, Any] = {}
    for dotted, value in _leaves(flat):
        *groups, last = dotted.split(".")
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
            if not isinstance(branch, dict):
                raise ConfigurationError(f"{source}: key '{dotted}': '{group}' is a value, not a group")
        if last in branch:
            raise ConfigurationError(f"{source}: key '{dotted}' stands twice, or as a value and a group")
        branch[last] = value
    return tree


def value_in(tree: Any, key: str) -> Any:
    """Return the value at a dotted key, where ``.0`` is the first of a list; None without one."""
    for name in key.split("."):
        if isinstance(tree, list | tuple):
            tree = tree[int(name)] if name.isdecimal() and int(name) < len(tree) else None
        else:
            tree = tree.get(name) if isinstance(tree, Mapping) else None
    return tree


def _leaves(tree: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        if isinstance(value, Mapping) and value:
            yield from ((f"{key}.{inner}", leaf) for inner, leaf in _leaves(value))
        else:
            yield key, value


class ConfigurationError(OneLineError, ValueError):
    """An unusable configuration; the message is one line for the user."""
