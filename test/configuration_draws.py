# SPDX-License-Identifier: Apache-2.0
"""Random legal configurations of any machine, drawn from what its parameter model declares.

A draw starts from an installed configuration, is scaled to another size of machine, and goes through the keys in random
order: each gets a value from its declared range (a bound, zero, its neighbourhood, decades off, anywhere) or an option.
A value that is refused is left out, or moved back towards the legal one until it just passes, so that the conditions
between keys are met at their edge.  A key that is added to a model is drawn without being named here.
"""

from __future__ import annotations

import copy
import math
import types
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

import annotated_types
import numpy as np
from pydantic.fields import FieldInfo

from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree, merged_tree
from mech_twin.declarations.quantity import RANGES, Parameters
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import configuration_directories, file_tree, machine_parameters, table, validated

Path = tuple[str, ...]

# exponents of mass, length and time: a machine scaled in all three is legal wherever the conditions are consistent
DIMENSIONS = {
    "1/min": (0, 0, -1),
    "1/s": (0, 0, -1),
    "Hz": (0, 0, -1),
    "N": (1, 1, -2),
    "N m": (1, 2, -2),
    "N m s": (1, 2, -1),
    "N m s/rad": (1, 2, -1),
    "N m/rad": (1, 2, -2),
    "N/m": (1, 0, -2),
    "Pa": (1, -1, -2),
    "W": (1, 2, -3),
    "kg": (1, 0, 0),
    "kg m2": (1, 2, 0),
    "kg/m3": (1, -3, 0),
    "m": (0, 1, 0),
    "m/s": (0, 1, -1),
    "m/s2": (0, 1, -2),
    "rad/s": (0, 0, -1),
    "rpm": (0, 0, -1),
    "s": (0, 0, 1),
}
# keys that came later: drawn last, from numbers of their own, so that the draws before them stay what they are
ADDED: dict[str, tuple[Path, ...]] = {
    "mb10_breaker": (("tool", "model"), ("tool", "wave")),
    "impact_mass": (("stop", "model"), ("stop", "wave")),
}
STEP = "step_s"  # what the coupling step is called: short ones cost the most
SHORTEST_USUAL_STEP_S = 2e-4
FLOOR_SHARE = 0.002  # of the draws at the shortest legal step
EDGE_ROUNDS = 40
MOST_EDGES = 4  # a draw
GROUP_TRIES = 30


class Leaf(NamedTuple):
    """A key of a model: where it stands, and what it may be."""

    path: Path
    field: FieldInfo
    kinds: tuple[Any, ...]  # types, without None
    optional: bool

    @property
    def unit(self) -> str:
        """Unit, without the sign of a power; empty where it is no quantity."""
        extra = self.field.json_schema_extra
        return str(extra.get("unit", "")).replace("^", "") if isinstance(extra, dict) else ""

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest declared value, open bounds one rounding inside."""
        low, high = -math.inf, math.inf
        for limit in self.field.metadata:
            match limit:
                case annotated_types.Ge():
                    low = float(limit.ge)  # type: ignore[arg-type]
                case annotated_types.Gt():
                    low = math.nextafter(float(limit.gt), math.inf)  # type: ignore[arg-type]
                case annotated_types.Le():
                    high = float(limit.le)  # type: ignore[arg-type]
                case annotated_types.Lt():
                    high = math.nextafter(float(limit.lt), -math.inf)  # type: ignore[arg-type]
        largest = RANGES[self.unit][1] if self.unit else 1e3
        return max(low, -largest), high if math.isfinite(high) else largest

    @property
    def may_be_infinite(self) -> bool:
        """Whether an infinite value has a meaning."""
        return any(getattr(limit, "allow_inf_nan", False) for limit in self.field.metadata)


def _kinds(annotation: Any) -> tuple[tuple[Any, ...], bool]:
    if get_origin(annotation) in {Union, types.UnionType}:
        parts = get_args(annotation)
        return tuple(part for part in parts if part is not type(None)), type(None) in parts
    return (annotation,), False


def leaves(model: type[Parameters], path: Path = ()) -> Iterator[Leaf]:
    """Yield every key of a model; an optional group is one leaf, the keys of the others are their own."""
    for name, field in model.model_fields.items():
        kinds, optional = _kinds(field.annotation)
        if not optional and is_group(kinds):
            yield from leaves(kinds[0], (*path, name))
        else:
            yield Leaf((*path, name), field, kinds, optional)


def is_group(kinds: tuple[Any, ...]) -> bool:
    """Return whether a key is a group of keys."""
    return len(kinds) == 1 and isinstance(kinds[0], type) and issubclass(kinds[0], Parameters)


def value_at(tree: Mapping[str, Any], path: Path) -> Any:
    """Return the value at a path, None where there is none."""
    for key in path:
        if not isinstance(tree, Mapping) or key not in tree:
            return None
        tree = tree[key]
    return tree


def with_value(tree: dict[str, Any], path: Path, value: Any) -> dict[str, Any]:
    """Return the tree with another value at a path; None takes the key out."""
    changed = copy.deepcopy(tree)
    branch = changed
    for key in path[:-1]:
        branch = branch.setdefault(key, {})
    if value is None:
        branch.pop(path[-1], None)
    else:
        branch[path[-1]] = value
    return changed


@cache
def _installed_trees() -> tuple[dict[str, Any], ...]:
    """Return the installed configurations of all machines, without the names of motors."""
    trees = [configuration_tree(machine_parameters(name)) for name in CATALOGUE]
    for tree in trees:
        tree.get("motor", {}).pop("catalogue_name", None)
    return tuple(trees)


class Refused(NamedTuple):
    """A refusal, and what was asked."""

    key: str
    value: Any
    message: str


class Draw:
    """One random legal configuration of a machine, and the refusals on its way.

    Parameters
    ----------
    name : str
        Machine of the catalogue.
    seed : int
        With ``number`` the seed of all that is random.
    number : int
        Number of the draw.
    """

    def __init__(self, name: str, seed: int, number: int) -> None:
        self.random = np.random.default_rng([seed, number])
        self.entry = CATALOGUE[name]
        self.refused: list[Refused] = []
        self.edges = 0
        self.floor = self.random.random() < FLOOR_SHARE
        self.tree = self._base(name)
        self._fill_groups()
        self._scale()
        share = self.random.choice([0.05, 0.2, 0.5, 1.0])
        self._change(self.entry.parameters, (), float(share))
        self.commands = self._commands()
        if name in ADDED:
            self.random = np.random.default_rng([seed, number, 1])
            self._change(self.entry.parameters, (), float(share), added=True)

    @property
    def parameters(self) -> Parameters:
        """The validated parameters."""
        return validated(self.entry, self.tree, "draw")

    def legal(self, tree: dict[str, Any], key: str, value: Any, keep: bool = True) -> bool:
        """Return whether a tree is legal; a refusal is kept to be judged."""
        try:
            validated(self.entry, tree, "draw")
        except ConfigurationError as refusal:
            if keep:
                self.refused.append(Refused(key, value, str(refusal)))
            return False
        return True

    def _base(self, name: str) -> dict[str, Any]:
        """Return one of the machine's installed configurations, most often without what is optional."""
        found = sorted(
            {path.name: path for d in reversed(configuration_directories()) for path in d.glob(f"{name}*.yaml")}.items()
        )
        tree = file_tree(found[self.random.integers(len(found))][1])
        tree = configuration_tree(validated(self.entry, tree, name))
        if "catalogue_name" in tree.get("motor", {}):
            del tree["motor"]["catalogue_name"]
        for leaf in leaves(self.entry.parameters):
            if leaf.optional and value_at(tree, leaf.path) is not None and self.random.random() < 0.7:
                without = with_value(tree, leaf.path, None)
                if self.legal(without, leaf.path[-1], None, keep=False):
                    tree = without
        return tree

    def _fill_groups(self) -> None:
        """Put half of the optional groups that are absent in."""
        for leaf in leaves(self.entry.parameters):
            if is_group(leaf.kinds) and value_at(self.tree, leaf.path) is None and self.random.random() < 0.5:
                self._change_group(leaf)

    def _scale(self) -> None:
        """Make the machine another size in mass, length and time, if the result is legal."""
        if self.random.random() < 0.4:
            return
        spread = np.array([3.0, 1.5, 1.0]) * self.random.uniform(-1.0, 1.0, 3)
        scaled = copy.deepcopy(self.tree)
        for leaf in leaves(self.entry.parameters):
            value, exponents = value_at(self.tree, leaf.path), DIMENSIONS.get(leaf.unit)
            if exponents is None or value is None or leaf.path[-1] == STEP:
                continue
            low, high = leaf.bounds
            scaled = with_value(scaled, leaf.path, min(max(value * float(10.0 ** (spread @ exponents)), low), high))
        if self.legal(scaled, "scale", None, keep=False):
            self.tree = scaled

    def _change(self, model: type[Parameters], path: Path, share: float, added: bool = False) -> None:
        """Go through the keys in random order, and give a share of them another value."""
        keys = [leaf for leaf in leaves(model, path) if self._is_added(leaf) == added]
        for place in self.random.permutation(len(keys)):
            leaf = keys[place]
            options = get_origin(leaf.kinds[0]) is Literal or leaf.kinds[0] is bool
            if leaf.path[-1] == STEP or self.random.random() < (max(share, 0.5) if options else share):
                self._change_one(leaf)
        if not added and "motor" in self.tree and self.random.random() < 0.1:
            names = list(table("motors_4a"))
            named = {"catalogue_name": names[self.random.integers(len(names))]}
            changed = with_value(self.tree, ("motor",), named)
            if self.legal(changed, "motor.catalogue_name", named["catalogue_name"]):
                self.tree = changed

    def _is_added(self, leaf: Leaf) -> bool:
        return leaf.path[:2] in ADDED.get(self.entry.name, ())

    def _change_one(self, leaf: Leaf) -> None:
        if is_group(leaf.kinds):
            self._change_group(leaf)
            return
        value = self._value(leaf)
        key = ".".join(leaf.path)
        if value is None and not leaf.optional:
            return
        if leaf.path[:1] == ("motor",):
            self.tree = self._without_name()
        changed = with_value(self.tree, leaf.path, value)
        if self.legal(changed, key, value):
            self.tree = changed
            return
        now = value_at(self.tree, leaf.path)
        if isinstance(value, float) and isinstance(now, float) and math.isfinite(value) and math.isfinite(now):
            self._move_to_the_edge(leaf, now, value)

    def _without_name(self) -> dict[str, Any]:
        if "catalogue_name" not in self.tree.get("motor", {}):
            return self.tree
        whole = configuration_tree(self.parameters)
        del whole["motor"]["catalogue_name"]
        return whole

    def _move_to_the_edge(self, leaf: Leaf, legal: float, refused: float) -> None:
        """Adopt the value next to the edge of what is legal, between a legal and a refused one."""
        if self.edges >= MOST_EDGES or self.random.random() < 0.5:
            return
        self.edges += 1
        for _ in range(EDGE_ROUNDS):
            middle = math.copysign(math.sqrt(legal * refused), legal) if legal * refused > 0 else (legal + refused) / 2
            changed = with_value(self.tree, leaf.path, middle)
            if self.legal(changed, ".".join(leaf.path), middle, keep=False):
                legal, self.tree = middle, changed
            else:
                refused = middle
            if abs(legal - refused) <= 1e-12 * abs(legal):
                return

    def _change_group(self, leaf: Leaf) -> None:
        """Take an optional group out, or put one in: another machine's, or its numbers of the size of the others."""
        if value_at(self.tree, leaf.path) is not None:
            without = with_value(self.tree, leaf.path, None)
            if self.random.random() < 0.3 and self.legal(without, ".".join(leaf.path), None):
                self.tree = without
            else:
                self._change(leaf.kinds[0], leaf.path, 0.5)
            return
        examples = [tree[leaf.path[-1]] for tree in _installed_trees() if leaf.path[-1] in tree]
        if examples:
            changed = with_value(self.tree, leaf.path, examples[self.random.integers(len(examples))])
            if self.legal(changed, ".".join(leaf.path), "another machine's"):
                self.tree = changed
            return
        for _ in range(GROUP_TRIES):
            group: dict[str, Any] = {}
            for inner in leaves(leaf.kinds[0], leaf.path):
                value = self._value(inner, near=True)
                if value is not None:
                    group = with_value(group, inner.path, value)
            changed = merged_tree(self.tree, group)
            if self.legal(changed, ".".join(leaf.path), group):
                self.tree = changed
                return

    def _value(self, leaf: Leaf, near: bool = False) -> Any:
        """Return a value for a key, None where it is to be absent."""
        if leaf.optional and self.random.random() < 0.4:
            return None
        kind, value = leaf.kinds[0], None  # a word stays absent: names are drawn where they are known
        if get_origin(kind) is list:
            value = self._list(leaf, get_args(kind)[0])
        elif get_origin(kind) is Literal or kind is bool:
            options = get_args(kind) or (False, True)
            value = options[self.random.integers(len(options))]
        elif kind is float:
            value = self._number(leaf, near)
        elif kind is int:
            low, high = leaf.bounds
            value = int(self.random.choice([low, high, self.random.integers(int(low), int(high) + 1)]))
        return value

    def _list(self, leaf: Leaf, kind: Any) -> list[Any]:
        beside = value_at(self.tree, (*leaf.path[:-1], "count"))
        count = int(beside) if beside is not None else int(self.random.integers(1, 5))
        if get_origin(kind) is Literal:
            return [str(option) for option in self.random.choice(get_args(kind), count)]
        if self.random.random() < 0.3:
            return [0.0] * count
        return [float(value) for value in 10.0 ** self.random.uniform(-3.0, 3.6, count)]

    def _number(self, leaf: Leaf, near: bool) -> float:
        low, high = leaf.bounds
        if leaf.path[-1] == STEP:
            return self._step(low, high)
        how = "near" if near else self.random.choice(list(HOW), p=list(HOW.values()))
        largest = max(abs(low), abs(high))
        size = self._size(leaf)
        value = {
            "near": lambda: size * 10.0 ** self.random.normal(0.0, 0.3),
            "decades": lambda: size * 10.0 ** self.random.uniform(-3.0, 3.0),
            "anywhere": lambda: 10.0 ** self.random.uniform(math.log10(self._smallest(leaf)), math.log10(largest)),
            "even": lambda: self.random.uniform(low, high),
            "low": lambda: low,
            "high": lambda: math.inf if leaf.may_be_infinite else high,
            "zero": lambda: 0.0,
        }[how]()
        if low < 0.0 and how in {"near", "decades", "anywhere"} and self.random.random() < 0.4:
            value = -value
        return float(value) if leaf.may_be_infinite else float(min(max(value, low), high))

    def _smallest(self, leaf: Leaf) -> float:
        low, _ = leaf.bounds
        return low if low > 0.0 else RANGES[leaf.unit][0] if leaf.unit else 1e-3

    def _size(self, leaf: Leaf) -> float:
        """Return the size of a key's value, or of another number of its unit where it has none."""
        now = value_at(self.tree, leaf.path)
        if isinstance(now, float) and math.isfinite(now) and now != 0.0:
            return abs(now)
        alike = [other for other in leaves(self.entry.parameters) if other.unit == leaf.unit]
        others = [value_at(self.tree, other.path) for other in alike if not self._is_added(other)]
        sizes = [abs(float(v)) for v in others if isinstance(v, int | float) and math.isfinite(v) and v != 0.0]
        return sizes[self.random.integers(len(sizes))] if sizes else 1.0

    def _step(self, low: float, high: float) -> float:
        if self.floor:
            return low
        if self.random.random() < 0.3:
            return high
        return float(10.0 ** self.random.uniform(math.log10(SHORTEST_USUAL_STEP_S), math.log10(high)))

    def _commands(self) -> tuple[float, ...]:
        """Return what is asked of the drive in equal parts of the run: always on, or off and on again."""
        if self.random.random() < 0.5:
            return (1.0,)
        return (1.0, float(self.random.uniform()), 0.0, 1.0)


HOW = {"near": 0.25, "decades": 0.2, "anywhere": 0.15, "even": 0.1, "low": 0.1, "high": 0.08, "zero": 0.12}
