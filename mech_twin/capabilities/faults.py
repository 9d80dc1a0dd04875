# SPDX-License-Identifier: Apache-2.0
"""Faults of a machine as changes of its parameters, each with a size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters


class MachineFault(NamedTuple):
    """A fault of a machine.

    Attributes
    ----------
    name, meaning : str
        Name, and a description of one line for the operator.
    unit : str
        Unit of the size: ``1`` if it is a share of the healthy value.
    sizes : tuple of float
        Ascending sizes at which its effect is computed; between them it is interpolated, with 0 at size 0.
    changes : callable
        ``changes(parameters, size)``: configuration keys (dotted) and their values under the fault.
    command : callable
        ``command(size)``: requested fraction of rated supply frequency under the fault; 1 is healthy.
    key : str
        The key that changes, if it is a single one; empty otherwise.
    """

    name: str
    meaning: str
    unit: str
    sizes: tuple[float, ...]
    changes: Callable[[Any, float], Mapping[str, Any]]
    command: Callable[[float], float] = lambda size: 1.0
    key: str = ""


def value_at(parameters: Parameters, key: str) -> Any:
    """Return the value of a dotted key."""
    found: Any = configuration_tree(parameters)
    for name in key.split("."):
        found = found[name]
    return found


def share_of_key(name: str, meaning: str, key: str, sizes: Sequence[float]) -> MachineFault:
    """Return a fault that changes a key by a share of its healthy value."""

    def changes(parameters: Parameters, size: float) -> dict[str, Any]:
        return {key: float(value_at(parameters, key)) * (1.0 + size)}

    return MachineFault(name, meaning, "1", tuple(sizes), changes, key=key)


def added_to_key(name: str, meaning: str, key: str, unit: str, sizes: Sequence[float]) -> MachineFault:
    """Return a fault that adds its size to a key."""

    def changes(parameters: Parameters, size: float) -> dict[str, Any]:
        return {key: float(value_at(parameters, key)) + size}

    return MachineFault(name, meaning, unit, tuple(sizes), changes, key=key)


def supply_sag(sizes: Sequence[float] = (-0.2, -0.15, -0.1, -0.07)) -> MachineFault:
    """Return the fault of a supply frequency that is too low by a share; smaller deviations are operating points."""
    return MachineFault(
        "supply_sag",
        "the supply's frequency is too low",
        "1",
        tuple(sizes),
        lambda parameters, size: {},
        lambda size: 1.0 + size,
    )
