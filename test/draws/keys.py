# SPDX-License-Identifier: Apache-2.0
"""The keys that a parameter model declares, and an installed configuration with one key changed, or two.

Random draws change many keys at once, and what two values do together on a machine as it is delivered seldom comes up
in them: a crank that starts on a dead centre under a load that does not hold is one pair in thousands.
"""

from __future__ import annotations

import copy
import math
import types
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import chain, combinations
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

import annotated_types
from pydantic.fields import FieldInfo

from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.declarations.quantity import RANGES, Parameters
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine_parameters, validated

Path = tuple[str, ...]

COMMANDS = (1.0, 0.0, 1.0)  # the drive is switched off and on again
SCALES = (0.1, 0.5, 2.0, 10.0, -1.0)
FROM_ZERO = (1e-3, 0.1, 1.0, 30.0)  # values of a key that is 0 as installed
HIGHEST_COUNT = 6
MAGNITUDES = (5e-324, 1e-300, 1e-30, 1e-9, 1e9, 1e21, 1e30, 1e300)
FACTORS = (1e-6, 1e-3, 1e3, 1e6)


class Leaf(NamedTuple):
    """A key of a model: where it stands, and what it may be."""

    path: Path
    field: FieldInfo
    kinds: tuple[Any, ...]  # types, without None
    optional: bool

    @property
    def key(self) -> str:
        """The key as a setting names it."""
        return ".".join(self.path)

    @property
    def is_group(self) -> bool:
        """Whether it is a group of keys."""
        kind = self.kinds[0]
        return len(self.kinds) == 1 and isinstance(kind, type) and issubclass(kind, Parameters)

    @property
    def is_number(self) -> bool:
        """Whether it is one number, and no list of them."""
        inner = chain(self.kinds, *map(get_args, self.kinds))
        return not self.is_group and get_origin(self.kinds[0]) is None and float in inner

    @property
    def options(self) -> tuple[Any, ...]:
        """What a choice may be; empty where it is none."""
        kind = self.kinds[0]
        return get_args(kind) if get_origin(kind) is Literal else (False, True) if kind is bool else ()

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


def leaves(model: type[Parameters], path: Path = (), tree: Mapping[str, Any] | None = None) -> Iterator[Leaf]:
    """Yield every key of a model.

    An optional group is one leaf; where it is present in the tree, its keys take its place.
    """
    for name, field in model.model_fields.items():
        union = get_origin(field.annotation) in {Union, types.UnionType}
        parts = get_args(field.annotation) if union else (field.annotation,)
        kinds = tuple(part for part in parts if part is not type(None))
        leaf = Leaf((*path, name), field, kinds, len(kinds) < len(parts))
        present = tree is not None and value_at(tree, leaf.path) is not None
        if leaf.is_group and (present or not leaf.optional):
            yield from leaves(kinds[0], leaf.path, tree)
        else:
            yield leaf


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


def nameless(parameters: Parameters) -> dict[str, Any]:
    """Return the tree of a configuration without the name of its motor, whose numbers may then be changed."""
    tree = configuration_tree(parameters)
    tree.get("motor", {}).pop("catalogue_name", None)
    return tree


@cache
def installed_tree(name: str) -> dict[str, Any]:
    """Return the installed configuration of a machine, without the name of its motor."""
    return nameless(machine_parameters(name))


class Refused(NamedTuple):
    """A refusal, and what was asked."""

    key: str
    value: Any
    message: str


class Change(NamedTuple):
    """A key and its value; None leaves out what is optional."""

    path: Path
    value: Any

    @property
    def key(self) -> str:
        """The key as a setting names it."""
        return ".".join(self.path)


class Changed:
    """An installed configuration with some changes, and its refusal if it is not legal.

    Parameters
    ----------
    name : str
        Machine of the catalogue.
    made : tuple of Change
        What is changed.
    """

    def __init__(self, name: str, made: tuple[Change, ...]) -> None:
        self.name, self.commands = name, COMMANDS
        self.parameters: Parameters | None = None
        self.refused: list[Refused] = []
        tree = installed_tree(name)
        for change in made:
            tree = with_value(tree, change.path, change.value)
        try:
            self.parameters = validated(CATALOGUE[name], tree, "draw")
        except ConfigurationError as refusal:
            self.refused.append(Refused(made[-1].key, made[-1].value, str(refusal)))


def told(made: tuple[Change, ...]) -> str:
    """Return the changes as settings."""
    return ", ".join(f"{change.key} = {change.value}" for change in made)


def telling_values(leaf: Leaf, now: Any) -> Iterator[Any]:
    """Yield the values of a key that make another machine of it: options, small counts, none, zero, a whole share."""
    kind, (low, high) = leaf.kinds[0], leaf.bounds
    if leaf.optional and now is not None:
        yield None
    if leaf.is_group:
        return
    yield from leaf.options
    if kind is int:
        yield from (each for each in (int(low), int(low) + 1, HIGHEST_COUNT) if low <= each <= high)
    elif kind is float:
        yield from (each for each in (0.0, 1.0) if low <= each <= high and (each == 0.0 or high == 1.0))


def scaled_values(leaf: Leaf, now: Any) -> Iterator[float]:
    """Yield other sizes of a number."""
    if leaf.kinds[0] is float and now is not None:
        low, high = leaf.bounds
        sizes = [now * scale for scale in SCALES] if now else list(FROM_ZERO)
        yield from (size for size in sizes if low <= size <= high)


def extreme_values(leaf: Leaf, now: Any) -> Iterator[float]:
    """Yield the extremes of a number: magnitudes of either sign, zero, decades off, its bounds and just beyond them."""
    low, high = leaf.bounds
    yield from (0.0, low, high, math.nextafter(low, -math.inf), math.nextafter(high, math.inf))
    for size in MAGNITUDES:
        yield from (size, -size)
    if isinstance(now, float | int) and now and math.isfinite(now):
        yield from (-now, *(factor * now for factor in FACTORS))


def changes(name: str) -> tuple[list[Change], list[Change]]:
    """Return the telling changes of a machine's installed configuration, and the scaled ones."""
    telling, scaled, tree = [], [], installed_tree(name)
    for leaf in leaves(CATALOGUE[name].parameters):
        now = value_at(tree, leaf.path)
        telling += [Change(leaf.path, value) for value in telling_values(leaf, now) if value != now]
        scaled += [Change(leaf.path, value) for value in scaled_values(leaf, now)]
    return telling, scaled


def single_changes(name: str) -> list[tuple[Change, ...]]:
    """Return every change by itself."""
    telling, scaled = changes(name)
    return [(each,) for each in telling + scaled]


def paired_changes(name: str) -> list[tuple[Change, ...]]:
    """Return every telling change with every other change of another key."""
    telling, scaled = changes(name)
    pairs = [*combinations(telling, 2), *((one, other) for one in telling for other in scaled)]
    return [pair for pair in pairs if pair[0].path != pair[1].path]


def extreme_changes(name: str) -> list[Change]:
    """Return every number of a machine's installed configuration at each of its extremes, once."""
    tree, found = installed_tree(name), []
    for leaf in leaves(CATALOGUE[name].parameters, (), tree):
        if leaf.is_number:
            values = dict.fromkeys(extreme_values(leaf, value_at(tree, leaf.path)))
            found += [Change(leaf.path, value) for value in values]
    return found
