# SPDX-License-Identifier: Apache-2.0
"""Points of a sweep: their configurations, and the summary numbers of a point."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel

from mech_twin.capabilities.arguments import by_name, real_number, several
from mech_twin.capabilities.errors import StudyError
from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.errors import MotionError
from mech_twin.engine.run import frames
from mech_twin.parameters.key_hints import declared_key, did_you_mean, key_units
from mech_twin.parameters.load import catalogue_entry, validated

Value = float | int | str | bool
MOST_POINTS = 10_000_000


@dataclass(frozen=True)
class Question:
    """A sweep: machine, configuration, axes (dotted key and values), requested outputs, simulated time (s, 0: none).

    Points are numbered row by row, the last axis fastest.
    """

    machine: str
    tree: dict[str, Any]
    axes: tuple[tuple[str, tuple[Value, ...]], ...]
    outputs: tuple[str, ...]
    duration_s: float

    @property
    def keys(self) -> tuple[str, ...]:
        """The swept keys."""
        return tuple(key for key, _ in self.axes)

    @property
    def count(self) -> int:
        """Number of points."""
        return math.prod(len(values) for _, values in self.axes)

    def changes(self, index: int) -> dict[str, Value]:
        """Return the swept keys and their values at a point."""
        found: dict[str, Value] = {}
        for key, values in reversed(self.axes):
            index, place = divmod(index, len(values))
            found[key] = values[place]
        return dict(reversed(found.items()))


@dataclass(frozen=True)
class Point:
    """Summary numbers of one point by name, or why its configuration was rejected or its simulation failed."""

    index: int
    numbers: dict[str, float]
    refused: str


def question(
    machine: str,
    parameters: Parameters,
    axes: Mapping[str, Sequence[Value]],
    outputs: Sequence[str] = (),
    duration_s: float = 0.0,
) -> Question:
    """Return a sweep of these keys.

    Raises
    ------
    StudyError
        If there is no such key, an axis has no values, or there are too many points.
    """
    if not axes:
        raise StudyError("a sweep needs at least one key")
    fixed = []
    for key, values in by_name("axes", axes, "keys with their values, such as {'coupling.step_s': [0.001]}").items():
        require_key(type(parameters), key)
        fixed.append((key, several(f"key '{key}', value", values, "a list of values")))
        if not fixed[-1][1]:
            raise StudyError(f"key '{key}': no values to sweep")
    wanted = several("outputs", outputs, "a list of names")
    seconds = real_number("duration", duration_s, "a finite number of seconds, 0 or more", 0.0)
    asked = Question(machine, configuration_tree(parameters), tuple(fixed), wanted, seconds)
    if asked.count > MOST_POINTS:
        raise StudyError(f"{asked.count} points; at most {MOST_POINTS} in one sweep")
    return asked


def require_key(model: type[BaseModel], key: str) -> None:
    """Raise a `StudyError` if a configuration has no such key."""
    units = key_units(model)
    if declared_key(key, units) not in units:
        raise StudyError(f"no configuration key '{key}'{did_you_mean(key, units)}")


def summary(asked: Question, changes: Mapping[str, Value]) -> dict[str, float]:
    """Return the machine's report with these changes and, if a duration is given, the metrics of a run."""
    entry = catalogue_entry(asked.machine)
    machine = entry.build(validated(entry, merged_tree(asked.tree, tree_from_flat(changes)), "this point"))
    numbers = dict(machine.report())
    if asked.duration_s > 0.0:
        observer = machine.observer()
        for frame in frames(machine, asked.duration_s):
            observer.observe(frame)
        numbers.update(observer.numbers())
    return numbers


def require_outputs(asked: Question) -> None:
    """Raise a `StudyError` if an output is not a summary number of the unchanged machine."""
    if asked.outputs:
        known = summary(asked, {})
        for name in asked.outputs:
            if name not in known:
                near = get_close_matches(name, known, 1)
                hint = f"; did you mean '{near[0]}'?" if near else f"; there are {', '.join(known)}"
                raise StudyError(f"no summary number '{name}'{hint}")


def point(asked: Question, index: int) -> Point:
    """Return the summary numbers of one point, nan for a requested one that is missing."""
    try:
        numbers = summary(asked, asked.changes(index))
    except (ConfigurationError, MotionError) as error:
        return Point(index, {}, " ".join(str(error).split()))
    wanted = asked.outputs or tuple(numbers)
    return Point(index, {name: float(numbers.get(name, math.nan)) for name in wanted}, "")


def points(asked: Question, indices: Sequence[int]) -> list[Point]:
    """Return the summary numbers of several points: the unit of work for other processes."""
    return [point(asked, index) for index in indices]
