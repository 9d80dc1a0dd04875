# SPDX-License-Identifier: Apache-2.0
"""A configuration in which its free keys act: what a machine fills in from one of them is left out.

A validated configuration holds every number, those too that a machine fills in where they are absent: a load set fills
the carts that name no load of their own.  A key of the set changes nothing while the filled-in numbers stand beside it.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.compiled_machine import compiled_machine
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.roles import Machine

MOVED = 1e-3  # of a key, or of the unit where it is 0: enough to be seen, too little to be refused


def acting_tree(name: str, base: Parameters, keys: Sequence[str]) -> dict[str, Any]:
    """Return the configuration as nested plain values, without those derived from one of the keys.

    Parameters
    ----------
    name : str
        Machine of the catalogue.
    base : Parameters
        Its configuration.
    keys : sequence of str
        Dotted keys that will be changed.

    Raises
    ------
    ConfigurationError
        The machine accepts no other value of a key, such as the inertia of a motor that is named from a catalogue.
    """
    whole = configuration_tree(base)
    moved = {key: other_value(name, whole, key) for key in keys}
    try:
        _configured(name, whole, moved)
        steps = [moved]
    except ConfigurationError:  # together they are rejected, each alone is accepted
        steps = [{key: value} for key, value in moved.items()]
    return _acting(name, whole, tuple(_filled_in(name, base, whole)), steps)


def keys_of_motion(name: str, base: Parameters, keys: Sequence[str]) -> tuple[str, ...]:
    """Return those of the keys of which the machine accepts another value, and that its equations of motion contain.

    The others change no constant of its kernels: keys of a tool in which no waves run, of an excitation of another
    kind.
    """
    whole, build = configuration_tree(base), catalogue_entry(name).build
    filled, own, found = tuple(_filled_in(name, base, whole)), _constants(build(base)), []
    for key in keys:
        try:
            step = {key: other_value(name, whole, key)}
        except ConfigurationError:
            continue
        tree = _acting(name, whole, filled, [step])
        if own is None or _constants(build(_configured(name, tree, step))) != own:
            found.append(key)
    return tuple(found)


def _constants(machine: Machine) -> bytes | None:
    """Return the constants of the kernels of a machine, None where it has none."""
    compiled = compiled_machine(machine)
    return None if compiled is None else pickle.dumps(compiled.models)


def _acting(
    name: str, tree: Mapping[str, Any], filled: Sequence[str], steps: Sequence[Mapping[str, float]]
) -> dict[str, Any]:
    """Return a tree without the derived numbers that change with one of the steps of keys."""
    left = dict(tree)
    for leaf in filled:
        if all(leaf not in step for step in steps) and any(_follows(name, tree, leaf, step) for step in steps):
            left = _without(left, leaf)
    return left


def other_value(name: str, tree: Mapping[str, Any], key: str) -> float:
    """Return a slightly different value of a key that the machine accepts."""
    value = float(number_in(tree, key))
    step, refused = MOVED * (abs(value) or 1.0), None
    for other in (value + step, value - step):
        try:
            _configured(name, tree, {key: other})
        except ConfigurationError as error:
            refused = error
        else:
            return other
    raise ConfigurationError(f"--free {key}: the machine accepts no other value: {refused}")


def _filled_in(name: str, base: Parameters, tree: Mapping[str, Any]) -> Iterator[str]:
    """Yield the dotted keys of numbers that the machine derives if the configuration leaves them out."""
    for leaf in _numbers(tree):
        try:
            found = _configured(name, _without(tree, leaf), {})
        except ConfigurationError:
            continue
        if found == base:
            yield leaf


def _follows(name: str, tree: Mapping[str, Any], leaf: str, moved: Mapping[str, float]) -> bool:
    """Return whether a derived number changes when keys are changed."""
    try:
        found = _configured(name, _without(tree, leaf), moved)
    except ConfigurationError:
        return False
    return bool(number_in(configuration_tree(found), leaf) != number_in(tree, leaf))


def _configured(name: str, tree: Mapping[str, Any], changed: Mapping[str, float]) -> Parameters:
    return validated(catalogue_entry(name), merged_tree(tree, tree_from_flat(changed)), name)


def number_in(tree: Mapping[str, Any], key: str) -> Any:
    """Return the value at a dotted key; None without one."""
    branch: Any = tree
    for word in key.split("."):
        branch = branch.get(word) if isinstance(branch, Mapping) else None
    return branch


def _numbers(tree: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _numbers(value, f"{prefix}{name}.")
        elif isinstance(value, float):
            yield prefix + name


def _without(tree: Mapping[str, Any], key: str) -> dict[str, Any]:
    first, _, rest = key.partition(".")
    return {
        name: (_without(value, rest) if rest else None) if name == first else value
        for name, value in tree.items()
        if rest or name != first
    }
