# SPDX-License-Identifier: Apache-2.0
"""The question of a fit, and a configuration as a function of some keys: from values to parameters and machine.

By default the keys that the configuration calls assumed are free.

Its free keys act: what a machine fills in from one of them is left out.  A validated configuration holds every number,
those too that a machine fills in where they are absent: a load set fills the carts that name no load of their own.  A
key of the set changes nothing while the filled-in numbers stand beside it.
"""

from __future__ import annotations

import pickle
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel

from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
    value_in,
)
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.compiled_machine import compiled_machine
from mech_twin.measurements.blocks import Array
from mech_twin.parameters.load import catalogue_entry, configuration_file, validated
from mech_twin.parameters.written_configuration import leaves
from mech_twin.roles import Machine

MOVED = 1e-3  # of a key, or of the unit where it is 0: enough to be seen, too little to be refused
SEARCHED = 20.0  # factor of the search range about the configured value, where no bounds are given
SHARE_OF_LIKE = 0.1  # of the largest key in the same unit: scale of a key that is 0
ASSUMED = "assumed"
AUTO = "auto"  # in place of a key: every number that the motion of the machine depends on
_ORIGIN = re.compile(r"#.*?\b(assumed|published|derived|measured|catalogue|printed)\b")
# how a run is computed, started and ended, and not what the machine is
NOT_OF_THE_MACHINE = ("coupling", "supply", "integrator", "start", "stall", "run")
# the state a run begins in, which belongs to the run
START_STATES = ("linkage.initial_crank_deg", "initial_position_m", "initial_velocity_m_per_s", "package_radius_m")


def _without(tree: Mapping[str, Any], key: str) -> dict[str, Any]:
    first, _, rest = key.partition(".")
    return {
        name: (_without(value, rest) if rest else None) if name == first else value
        for name, value in tree.items()
        if rest or name != first
    }


def origins(path: Path) -> dict[str, str]:
    """Return the origin that the comment beside each key of a configuration names.

    A key without a word of its own has that of its group.
    """
    text = path.read_text(encoding="utf-8")
    named = [_ORIGIN.search(line) for line in text.splitlines()]
    found = ((key, [word.group(1) for line in lines if (word := named[line])]) for key, lines in scalar_lines(text))
    return {key: words[-1] if words else "" for key, words in found}


def scalar_lines(text: str) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield each dotted key with a scalar value in a parameter file, and the lines of its groups and its own."""

    def below(node: yaml.Node | None, prefix: str, groups: tuple[int, ...]) -> Iterator[tuple[str, tuple[int, ...]]]:
        for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
            name, lines = str(key.value), (*groups, key.start_mark.line)
            if isinstance(value, yaml.MappingNode):
                yield from below(value, "" if name in ("/**", "ros__parameters") else f"{prefix}{name}.", lines)
            elif isinstance(value, yaml.ScalarNode):
                yield prefix + name, lines
            elif isinstance(value, yaml.SequenceNode):
                for place, each in enumerate(value.value):
                    if isinstance(each, yaml.ScalarNode) and each.start_mark.line > lines[-1]:  # a line of its own
                        yield f"{prefix}{name}.{place}", (*lines, each.start_mark.line)

    yield from below(yaml.compose(text, Loader=yaml.SafeLoader), "", ())


def assumed_keys(name: str, parameters: Parameters, path: Path | None = None) -> tuple[str, ...]:
    """Return the keys of `machine_keys` that the configuration calls assumed.

    Parameters
    ----------
    parameters : Parameters
        Its configuration; keys that it does not hold are left out.
    path : Path, optional
        File whose comments tell the origins; that of the installed configuration if absent.
    """
    known = origins(configuration_file(name)) if path is None else origins(path) or origins(configuration_file(name))
    return _of_motion(name, parameters, [key for key in _numbers(parameters) if known.get(key) == ASSUMED])


def machine_keys(name: str, parameters: Parameters) -> tuple[str, ...]:
    """Return the numbers of the machine itself of which it accepts another value, and that its motion depends on."""
    return _of_motion(name, parameters, _numbers(parameters))


def _of_motion(name: str, parameters: Parameters, keys: Iterable[str]) -> tuple[str, ...]:
    """Return those of the keys of which the machine accepts another value, and that its equations of motion contain.

    The others change no constant of its kernels: keys of a tool in which no waves run, of an excitation of another
    kind.
    """
    whole, build, found = KeyedConfiguration(name, parameters, ()), catalogue_entry(name).build, []
    own = _constants(build(parameters))
    for key in keys:
        try:
            step = {key: whole.other_value(key)}
        except ConfigurationError:
            continue
        if own is None or _constants(build(whole.configured(whole.acting_in([step]), step))) != own:
            found.append(key)
    return tuple(found)


def _constants(machine: Machine) -> bytes | None:
    """Return the constants of the kernels of a machine, None where it has none."""
    compiled = compiled_machine(machine)
    return None if compiled is None else pickle.dumps(compiled.models)


def _numbers(parameters: Parameters) -> Iterator[str]:
    for key, value in numbers_of(configuration_tree(parameters)).items():
        of_machine = key.split(".")[0] not in NOT_OF_THE_MACHINE and key not in START_STATES
        if of_machine and isfinite(value):
            yield key


@dataclass(frozen=True)
class KeyedConfiguration:
    """A machine whose configuration is a function of the values of its free keys.

    Parameters
    ----------
    base : Parameters
        Configuration with the values of all keys that are not free.
    keys : tuple of str
        Free keys, dotted.
    bounds : mapping
        Lower and upper bounds of some keys.
    """

    machine: str
    base: Parameters
    keys: tuple[str, ...]
    bounds: Mapping[str, tuple[Annotated[float, -np.inf], Annotated[float, np.inf]]] = field(default_factory=dict)

    @cached_property
    def tree(self) -> dict[str, Any]:
        """The base configuration as a tree of values."""
        return configuration_tree(self.base)

    @cached_property
    def acting(self) -> dict[str, Any]:
        """The tree without the values that are derived from a free key.

        Raises
        ------
        ConfigurationError
            The machine accepts no other value of a key.
        """
        moved = {key: self.other_value(key) for key in self.keys}
        try:
            self.configured(self.tree, moved)
        except ConfigurationError:  # together they are rejected, each alone is accepted
            return self.acting_in([{key: value} for key, value in moved.items()])
        return self.acting_in([moved])

    def acting_in(self, steps: Sequence[Mapping[str, float]]) -> dict[str, Any]:
        """Return the tree without the derived numbers that change with one of the steps of keys."""
        left = dict(self.tree)
        for leaf in self._filled_in:
            if all(leaf not in step for step in steps) and any(self._follows(leaf, step) for step in steps):
                left = _without(left, leaf)
        return left

    @cached_property
    def _filled_in(self) -> tuple[str, ...]:
        """Dotted keys of the numbers that the machine derives if the configuration leaves them out."""

        def is_derived(leaf: str) -> bool:
            try:
                return self.configured(_without(self.tree, leaf), {}) == self.base
            except ConfigurationError:
                return False

        return tuple(filter(is_derived, numbers_of(self.tree)))

    def _follows(self, leaf: str, moved: Mapping[str, float]) -> bool:
        """Return whether a derived number changes when keys are changed."""
        try:
            found = self.configured(_without(self.tree, leaf), moved)
        except ConfigurationError:
            return False
        return bool(value_in(configuration_tree(found), leaf) != value_in(self.tree, leaf))

    def other_value(self, key: str) -> float:
        """Return a slightly different value of a key that the machine accepts."""
        value = float(value_in(self.tree, key))
        step, refused = MOVED * (abs(value) or 1.0), None
        for other in (value + step, value - step):
            try:
                self.configured(self.tree, {key: other})
            except ConfigurationError as error:
                refused = error
            else:
                return other
        raise ConfigurationError(f"--free {key}: the machine accepts no other value: {refused}")

    def configured(self, tree: Mapping[str, Any], changed: Mapping[str, float]) -> Parameters:
        """Return the parameters of a tree with some keys changed."""
        return validated(catalogue_entry(self.machine), merged_tree(tree, tree_from_flat(changed)), self.machine)

    def check(self) -> None:
        """Raise a ConfigurationError if a key is unknown, or cannot be changed."""
        self.values()
        self.acting  # noqa: B018

    def values(self) -> Array:
        """Return the configured values of the free keys, shape (keys,).

        Raises
        ------
        ConfigurationError
            A key is unknown or not a number.
        """
        return np.array([number_at(self.tree, key, self.machine) for key in self.keys])

    def parameters(self, values: Sequence[float] | Array) -> Parameters:
        """Return the configuration with these values of the free keys.

        Raises
        ------
        ConfigurationError
            The values are rejected.
        """
        flat = dict(zip(self.keys, map(float, values), strict=True))
        tree = merged_tree(self.acting, tree_from_flat(flat, "--free"))
        return validated(catalogue_entry(self.machine), tree, f"{self.machine} with --free {', '.join(self.keys)}")

    def scales(self) -> Array:
        """Return the scale of each key, shape (keys,): its magnitude; for 0, a share of the largest in its unit."""
        return np.array([_scale(self.tree, self.base, key) for key in self.keys])

    def search_range(self) -> Array:
        """Return where keys are searched, shape (2, keys): their bounds, else a wide range, within the declared."""
        found = []
        for key, value in zip(self.keys, self.values().tolist(), strict=True):
            low, high = declared_bounds(type(self.base), key)
            if key in self.bounds:
                low, high = max(low, self.bounds[key][0]), min(high, self.bounds[key][1])
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


@dataclass(frozen=True)
class IdentificationQuestion(KeyedConfiguration):
    """Specification of a fit: machine, free keys, and what is known of them.

    Keys that are not estimated keep the values of ``base``.

    Attributes
    ----------
    priors : mapping
        Mean and standard deviation of some keys.
    longest_begin_s : float
        Latest start of a run whose start is unknown, as time since the machine's start.
    seed : int
        Seed of the random further starts.
    cores : int, optional
        Threads; all cores if absent.
    scheduler : str, optional
        Address of a Dask scheduler that distributes starts and profiles.
    """

    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    longest_begin_s: float = 0.0
    seed: int = 0
    cores: int | None = None
    scheduler: str | None = None

    def of(self, keys: Iterable[str]) -> IdentificationQuestion:
        """Return the same question about some of the keys, the others fixed as configured."""
        return replace(self, keys=tuple(keys))


def number_at(tree: Mapping[str, Any], key: str, machine: str) -> float:
    """Return the number at a dotted key in a tree of values."""
    found = value_in(tree, key)
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise ConfigurationError(f"--free {key}: expected a key of {machine} that is a number")
    return float(found)


def numbers_of(tree: Mapping[str, Any]) -> dict[str, float]:
    """Return every floating-point number of a tree by its dotted key."""
    return {key: value for key, value in leaves(tree) if isinstance(value, float)}


def declared_bounds(model: type[BaseModel], key: str) -> tuple[float, float]:
    """Return the declared bounds of a key; infinite without any."""
    field = declared_field(model, key)
    marks = [] if field is None else field.metadata
    low = max((v for mark in marks if (v := _bound(mark, "ge", "gt")) is not None), default=-np.inf)
    high = min((v for mark in marks if (v := _bound(mark, "le", "lt")) is not None), default=np.inf)
    return low, high


def _bound(mark: Any, *names: str) -> float | None:
    return next((float(found) for name in names if (found := getattr(mark, name, None)) is not None), None)


def declared_field(model: type[BaseModel], key: str) -> Any:
    """Return the field declaration of a dotted key; None without one."""
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
    """Return the declared unit of a dotted key; empty without one."""
    field = declared_field(model, key)
    extra = None if field is None else field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def _scale(tree: Mapping[str, Any], base: Parameters, key: str) -> float:
    value = abs(number_at(tree, key, "the machine"))
    if value > 0.0:
        return value
    unit = unit_at(type(base), key)
    like = [
        abs(each) for name, each in numbers_of(tree).items() if unit_at(type(base), name) == unit and np.isfinite(each)
    ]
    return SHARE_OF_LIKE * max(like, default=0.0) or 1.0
