# SPDX-License-Identifier: Apache-2.0
"""Random legal configurations of any machine, drawn from what its parameter model declares.

A draw starts from an installed configuration, is scaled to another size of machine, and goes through the keys
in random order: each gets a value from its declared range (a bound, zero, its neighbourhood, decades off, anywhere) or
an option.  A value that is refused is left out, or moved back towards the legal one until it just passes, so that the
conditions between keys are met at their edge.  A key that is added to a model is drawn without being named here.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from functools import cache
from typing import Any, Literal, NamedTuple, get_args, get_origin

import numpy as np
from draws.keys import Leaf, Path, Refused, installed_tree, leaves, nameless, value_at, with_value

from mech_twin.declarations.configuration_tree import ConfigurationError, merged_tree
from mech_twin.declarations.quantity import RANGES, Parameters
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import configuration_directories, file_tree, table, validated

# exponents of mass, length and time: a machine scaled in all three is legal wherever the conditions are consistent
DIMENSIONS = {
    "1/min": (0, 0, -1), "1/s": (0, 0, -1), "Hz": (0, 0, -1), "rad/s": (0, 0, -1), "rpm": (0, 0, -1), "s": (0, 0, 1),
    "kg": (1, 0, 0), "kg m2": (1, 2, 0), "kg/m3": (1, -3, 0), "m": (0, 1, 0), "m/s": (0, 1, -1), "m/s2": (0, 1, -2),
    "N": (1, 1, -2), "N/m": (1, 0, -2), "N m": (1, 2, -2), "N m/rad": (1, 2, -2), "Pa": (1, -1, -2), "W": (1, 2, -3),
    "N m s": (1, 2, -1), "N m s/rad": (1, 2, -1),
}  # fmt: skip
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
# how the value of a number is drawn, and how often
USUAL = {"near": 0.25, "decades": 0.2, "anywhere": 0.15, "even": 0.1, "low": 0.1, "high": 0.08, "zero": 0.12}
CORNERS = {"near": 0.2, "anywhere": 0.2, "even": 0.1, "low": 0.15, "high": 0.15, "zero": 0.1, "tiny": 0.1}
TINY = 1e-300


class Drawn(NamedTuple):
    """What is drawn: its name, its parameter model, and the configurations from which a draw starts."""

    name: str
    parameters: type[Parameters]
    bases: tuple[dict[str, Any], ...]


@cache
def machine_drawn(name: str) -> Drawn:
    """Return a machine of the catalogue with its installed configurations."""
    entry = CATALOGUE[name]
    found = {path.name: path for d in reversed(configuration_directories()) for path in d.glob(f"{name}*.yaml")}
    trees = (file_tree(path) for _, path in sorted(found.items()))
    return Drawn(name, entry.parameters, tuple(nameless(validated(entry, tree, name)) for tree in trees))


class Draw:
    """One random legal configuration, and the refusals on its way.

    Parameters
    ----------
    what : str or Drawn
        Machine of the catalogue, or another model with its configurations.
    seed : int
        With ``number`` the seed of all that is random.
    number : int
        Number of the draw.
    how : mapping
        Share of each way to draw a number.
    """

    def __init__(self, what: str | Drawn, seed: int, number: int, how: Mapping[str, float] = USUAL) -> None:
        self.what = machine_drawn(what) if isinstance(what, str) else what
        self.name, self.how = self.what.name, how
        self.random = np.random.default_rng([seed, number])
        self.refused: list[Refused] = []
        self.edges = 0
        self.floor = self.random.random() < FLOOR_SHARE
        self.tree = self._one_of(self.what.bases)
        self._leave_out()
        self._fill_groups()
        self._scale()
        share = float(self.random.choice([0.05, 0.2, 0.5, 1.0]))
        self._change(self.what.parameters, (), share)
        self.commands = self._commands()
        if self.name in ADDED:
            self.random = np.random.default_rng([seed, number, 1])
            self._change(self.what.parameters, (), share, added=True)

    @property
    def parameters(self) -> Parameters:
        """The validated parameters."""
        return validated(self.what, self.tree, "draw")

    def _adopt(self, tree: dict[str, Any], key: str, value: Any, keep: bool = True) -> bool:
        """Take a tree over if it is legal, and return whether it is; a refusal is kept to be judged."""
        try:
            validated(self.what, tree, "draw")
        except ConfigurationError as refusal:
            if keep:
                self.refused.append(Refused(key, value, str(refusal)))
            return False
        self.tree = tree
        return True

    def _one_of(self, values: Any) -> Any:
        return values[self.random.integers(len(values))]

    def _leave_out(self) -> None:
        """Leave most of what is optional out."""
        for leaf in leaves(self.what.parameters):
            if leaf.optional and value_at(self.tree, leaf.path) is not None and self.random.random() < 0.7:
                self._adopt(with_value(self.tree, leaf.path, None), leaf.key, None, keep=False)

    def _fill_groups(self) -> None:
        """Put half of the optional groups that are absent in."""
        for leaf in leaves(self.what.parameters):
            if leaf.is_group and value_at(self.tree, leaf.path) is None and self.random.random() < 0.5:
                self._change_group(leaf)

    def _scale(self) -> None:
        """Make the machine another size in mass, length and time, if the result is legal."""
        if self.random.random() < 0.4:
            return
        spread = np.array([3.0, 1.5, 1.0]) * self.random.uniform(-1.0, 1.0, 3)
        scaled = copy.deepcopy(self.tree)
        for leaf in leaves(self.what.parameters):
            value, exponents = value_at(self.tree, leaf.path), DIMENSIONS.get(leaf.unit)
            if exponents is None or value is None or leaf.path[-1] == STEP:
                continue
            low, high = leaf.bounds
            scaled = with_value(scaled, leaf.path, min(max(value * float(10.0 ** (spread @ exponents)), low), high))
        self._adopt(scaled, "scale", None, keep=False)

    def _change(self, model: type[Parameters], path: Path, share: float, added: bool = False) -> None:
        """Go through the keys in random order, and give a share of them another value."""
        keys = [leaf for leaf in leaves(model, path) if self._is_added(leaf) == added]
        for place in self.random.permutation(len(keys)):
            leaf = keys[place]
            if leaf.path[-1] == STEP or self.random.random() < (max(share, 0.5) if leaf.options else share):
                self._change_one(leaf)
        if not added and "motor" in self.tree and self.random.random() < 0.1:
            motor = self._one_of(list(table("motors_4a")))
            named = with_value(self.tree, ("motor",), {"catalogue_name": motor})
            self._adopt(named, "motor.catalogue_name", motor)

    def _is_added(self, leaf: Leaf) -> bool:
        return leaf.path[:2] in ADDED.get(self.name, ())

    def _change_one(self, leaf: Leaf) -> None:
        if leaf.is_group:
            self._change_group(leaf)
            return
        value = self._value(leaf)
        if value is None and not leaf.optional:
            return
        if leaf.path[0] == "motor" and "catalogue_name" in self.tree.get("motor", {}):
            self.tree = nameless(self.parameters)
        now = value_at(self.tree, leaf.path)
        if self._adopt(with_value(self.tree, leaf.path, value), leaf.key, value):
            return
        if isinstance(value, float) and isinstance(now, float) and math.isfinite(value) and math.isfinite(now):
            self._move_to_the_edge(leaf, now, value)

    def _move_to_the_edge(self, leaf: Leaf, legal: float, refused: float) -> None:
        """Adopt the value next to the edge of what is legal, between a legal and a refused one."""
        if self.edges >= MOST_EDGES or self.random.random() < 0.5:
            return
        self.edges += 1
        for _ in range(EDGE_ROUNDS):
            middle = math.copysign(math.sqrt(legal * refused), legal) if legal * refused > 0 else (legal + refused) / 2
            if self._adopt(with_value(self.tree, leaf.path, middle), leaf.key, middle, keep=False):
                legal = middle
            else:
                refused = middle
            if abs(legal - refused) <= 1e-12 * abs(legal):
                return

    def _change_group(self, leaf: Leaf) -> None:
        """Take an optional group out, or put one in: another machine's, or its numbers of the size of the others."""
        if value_at(self.tree, leaf.path) is not None:
            without = with_value(self.tree, leaf.path, None)
            if self.random.random() >= 0.3 or not self._adopt(without, leaf.key, None):
                self._change(leaf.kinds[0], leaf.path, 0.5)
            return
        examples = [group for group in (installed_tree(name).get(leaf.path[-1]) for name in CATALOGUE) if group]
        if examples:
            self._adopt(with_value(self.tree, leaf.path, self._one_of(examples)), leaf.key, "another machine's")
            return
        for _ in range(GROUP_TRIES):
            group: dict[str, Any] = {}
            for inner in leaves(leaf.kinds[0], leaf.path):
                value = self._value(inner, near=True)
                if value is not None:
                    group = with_value(group, inner.path, value)
            if self._adopt(merged_tree(self.tree, group), leaf.key, group):
                return

    def _value(self, leaf: Leaf, near: bool = False) -> Any:
        """Return a value for a key, None where it is to be absent."""
        if leaf.optional and self.random.random() < 0.4:
            return None
        kind, value = leaf.kinds[0], None  # a word stays absent: names are drawn where they are known
        if get_origin(kind) is list:
            value = self._list(leaf, get_args(kind)[0])
        elif leaf.options:
            value = self._one_of(leaf.options)
        elif kind is float:
            value = self._step(*leaf.bounds) if leaf.path[-1] == STEP else self._number(leaf, near)
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
        how = "near" if near else self.random.choice(list(self.how), p=list(self.how.values()))
        smallest = low if low > 0.0 else RANGES[leaf.unit][0] if leaf.unit else 1e-3
        largest = max(abs(low), abs(high))
        size = self._size(leaf)
        value = {
            "near": lambda: size * 10.0 ** self.random.normal(0.0, 0.3),
            "decades": lambda: size * 10.0 ** self.random.uniform(-3.0, 3.0),
            "anywhere": lambda: 10.0 ** self.random.uniform(math.log10(smallest), math.log10(largest)),
            "even": lambda: self.random.uniform(low, high),
            "low": lambda: low,
            "high": lambda: math.inf if leaf.may_be_infinite else high,
            "zero": lambda: 0.0,
            "tiny": lambda: TINY,
        }[how]()
        if low < 0.0 and how in {"near", "decades", "anywhere", "tiny"} and self.random.random() < 0.4:
            value = -value
        return float(value) if leaf.may_be_infinite else float(min(max(value, low), high))

    def _size(self, leaf: Leaf) -> float:
        """Return the size of a key's value, or of another number of its unit where it has none."""
        now = value_at(self.tree, leaf.path)
        if isinstance(now, float) and math.isfinite(now) and now != 0.0:
            return abs(now)
        alike = [other for other in leaves(self.what.parameters) if other.unit == leaf.unit]
        others = [value_at(self.tree, other.path) for other in alike if not self._is_added(other)]
        sizes = [abs(float(v)) for v in others if isinstance(v, int | float) and math.isfinite(v) and v != 0.0]
        return self._one_of(sizes) if sizes else 1.0

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
