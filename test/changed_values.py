# SPDX-License-Identifier: Apache-2.0
"""An installed configuration with one key changed, or two: options, counts, zeros, what is optional left out, scales.

Random draws change many keys at once, and what two values do together on a machine as it is delivered seldom comes up
in them: a crank that starts on a dead centre under a load that does not hold is one pair in thousands.
benchmarks/reliability/value_pairs.py makes all of them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from itertools import combinations
from typing import Any, Literal, NamedTuple, get_args, get_origin

from configuration_draws import Leaf, Path, is_group, leaves, value_at, with_value
from random_configurations import BROKEN, UNBUILT, Outcome, end_of_run, judged

from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import description_text, machine_parameters, validated

COMMANDS = (1.0, 0.0, 1.0)  # the drive is switched off and on again
SCALES = (0.1, 0.5, 2.0, 10.0, -1.0)
FROM_ZERO = (1e-3, 0.1, 1.0, 30.0)  # values of a key that is 0 as installed
HIGHEST_COUNT = 6


class Change(NamedTuple):
    """A key and its value; None leaves out what is optional."""

    path: Path
    value: Any


@cache
def installed_tree(name: str) -> dict[str, Any]:
    """Return the installed configuration of a machine, without the name of its motor."""
    tree = configuration_tree(machine_parameters(name))
    tree.get("motor", {}).pop("catalogue_name", None)
    return tree


def telling_values(leaf: Leaf, now: Any) -> Iterator[Any]:
    """Yield the values of a key that make another machine of it: options, small counts, none, zero, a whole share."""
    kind, (low, high) = leaf.kinds[0], leaf.bounds
    if leaf.optional and now is not None:
        yield None
    if get_origin(kind) is Literal:
        yield from get_args(kind)
    elif kind is bool:
        yield from (False, True)
    elif kind is int:
        yield from (each for each in (int(low), int(low) + 1, HIGHEST_COUNT) if low <= each <= high)
    elif kind is float:
        yield from (each for each in (0.0, 1.0) if low <= each <= high and (each == 0.0 or high == 1.0))


def scaled_values(leaf: Leaf, now: Any) -> Iterator[float]:
    """Yield other sizes of a number."""
    if leaf.kinds[0] is float and now is not None:
        low, high = leaf.bounds
        sizes = [now * scale for scale in SCALES] if now else list(FROM_ZERO)
        yield from (size for size in sizes if low <= size <= high)


def changes(name: str) -> tuple[list[Change], list[Change]]:
    """Return the telling changes of a machine's installed configuration, and the scaled ones."""
    telling, scaled, tree = [], [], installed_tree(name)
    for leaf in leaves(CATALOGUE[name].parameters):
        now = value_at(tree, leaf.path)
        if is_group(leaf.kinds):
            telling += [Change(leaf.path, None)] if now is not None else []
            continue
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


def told(made: tuple[Change, ...]) -> str:
    """Return the changes as settings."""
    return ", ".join(f"{'.'.join(change.path)} = {change.value}" for change in made)


def outcome_of(name: str, number: int, made: tuple[Change, ...]) -> Outcome:
    """Return what became of an installed configuration with some changes."""
    begun, margin, text, tree = time.process_time(), 0.0, "", installed_tree(name)
    try:
        for change in made:
            tree = with_value(tree, change.path, change.value)
        try:
            parameters = validated(CATALOGUE[name], tree, told(made))
        except ConfigurationError as refusal:
            end, what, _ = judged(name, UNBUILT, refusal)
        else:
            text = description_text(name, parameters)
            end, what, margin = end_of_run(name, parameters, COMMANDS)
    except Exception as error:  # noqa: BLE001 - what a legal input must never end in
        end, what = BROKEN, f"{type(error).__name__}: {error}"
    return Outcome(number, end, f"{told(made)}: {what}", margin, int(end == UNBUILT), time.process_time() - begun, text)
