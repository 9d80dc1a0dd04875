# SPDX-License-Identifier: Apache-2.0
"""A sweep: configurations and summary numbers of its points, as a table (Parquet or CSV) and as a plot."""

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from mech_twin.capabilities.arguments import by_name, real_number, sequence_items
from mech_twin.capabilities.plots import DPI, house_style, sheet
from mech_twin.declarations.captions import unknown_name
from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.run import frames
from mech_twin.errors import MotionError, StudyError
from mech_twin.files.output_file import written_file
from mech_twin.parameters.errors import declared_key, did_you_mean, key_units
from mech_twin.parameters.load import catalogue_entry, validated

Value = float | int | str | bool
MOST_POINTS = 10_000_000
REFUSED = "refused"
PANELS = 6
CURVES = 8
TICKS = 5  # intervals on a linear axis: more labels touch


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
    fixed = []
    for key, values in by_name("axes", axes, "keys with their values, such as {'coupling.step_s': [0.001]}").items():
        require_key(type(parameters), key)
        fixed.append((key, sequence_items(f"key '{key}', value", values, "a list of values")))
        if not fixed[-1][1]:
            raise StudyError(f"key '{key}': no values to sweep")
        _require_one_kind(key, fixed[-1][1])
    if not fixed:
        raise StudyError("a sweep needs at least one key")
    wanted = sequence_items("outputs", outputs, "a list of names")
    seconds = real_number("duration", duration_s, "a finite number of seconds, 0 or more", 0.0)
    asked = Question(str(machine), configuration_tree(parameters), tuple(fixed), wanted, seconds)
    if asked.count > MOST_POINTS:
        raise StudyError(f"{asked.count} points; at most {MOST_POINTS} in one sweep")
    return asked


def _require_one_kind(key: str, values: Sequence[Any]) -> None:
    """Raise a `StudyError` if values are not all numbers, all names, or all true or false; None is an absent key."""
    known = [(value, _kind(value)) for value in values if value is not None]
    for value, kind in known:
        if kind is None:
            raise StudyError(f"key '{key}', value {value!r:.80}: expected numbers or names")
        if kind != known[0][1]:
            both = f"values {known[0][0]!r:.80} and {value!r:.80}"
            raise StudyError(f"key '{key}', {both}: expected numbers or names, not both")


def _kind(value: Any) -> Any:
    if isinstance(value, float) and math.isnan(value):
        return None
    return next((kind for kind in (bool, float | int, str) if isinstance(value, kind)), None)


def require_key(model: type[BaseModel], key: str) -> None:
    """Raise a `StudyError` if a configuration has no such key."""
    if not isinstance(key, str):
        raise StudyError(f"key {key!r:.80}: expected a dotted configuration key")
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
            require_number(asked, name, known, "summary number")


def require_number(asked: Question, name: str, known: Mapping[str, float], what: str) -> None:
    """Raise a `StudyError` if a name is not one of the known numbers."""
    if name not in known:
        where = f"in a run of {asked.duration_s:g} s" if asked.duration_s > 0.0 else "without a run"
        raise StudyError(f"{where}: {unknown_name(name, known, f'{what} ')}")


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


def columns(asked: Question, found: Sequence[Point]) -> dict[str, list[Any]]:
    """Return swept keys, numbers (nan if missing) and reasons of rejection, one list each."""
    changes = [asked.changes(point.index) for point in found]
    names = dict.fromkeys(name for point in found for name in point.numbers)
    table: dict[str, list[Any]] = {key: [change[key] for change in changes] for key in asked.keys}
    table.update({name: [point.numbers.get(name, math.nan) for point in found] for name in names})
    table[REFUSED] = [point.refused for point in found]
    return table


def write_table(asked: Question, found: Sequence[Point], path: Path) -> None:
    """Write the table, replacing an existing file; Parquet metadata include machine and configuration."""
    table = columns(asked, found)
    with written_file(path, force=True) as unfinished:
        if path.suffix == ".csv":
            _write_csv(table, unfinished)
        else:
            notes = {"machine": asked.machine, "configuration": json.dumps(asked.tree)}
            write_parquet(table, {**notes, "duration_s": repr(asked.duration_s)}, unfinished)


def _write_csv(table: dict[str, list[Any]], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))


def write_parquet(table: Mapping[str, Any], notes: Mapping[str, str], path: Path) -> None:
    """Write columns to a Parquet file, with notes in its metadata."""
    import pyarrow as pa
    from pyarrow import parquet

    parquet.write_table(pa.table(dict(table)).replace_schema_metadata(dict(notes)), path, compression="zstd")


def write_picture(asked: Question, found: Sequence[Point], path: Path) -> bool:
    """Plot the first six numbers that vary; return whether there was anything to plot.

    One key gives a line, two a map; more keys give lines over the first key, with the others at their first values.
    A key of one value stands in the title.
    """
    table = columns(asked, found)
    names = [name for name in table if name not in (*asked.keys, REFUSED) and varies(table[name])][:PANELS]
    if not names:
        return False
    held = [f"{key} = {values[0]}" for key, values in asked.axes if len(values) == 1]
    title = ", ".join([f"{asked.tree.get('name', asked.machine)}: {asked.count} points", *held])
    with house_style():
        _draw(replace(asked, axes=tuple(axis for axis in asked.axes if len(axis[1]) > 1)), title, table, names, path)
    return True


def _draw(asked: Question, title: str, table: dict[str, list[Any]], names: Sequence[str], path: Path) -> None:
    wide = min(len(names), 3 if len(asked.axes) == 2 else 2)
    tall = math.ceil(len(names) / wide)
    figure, panels = sheet(tall, wide, 4.0 * wide, 3.2 * tall)
    for axes, name in zip(panels, names, strict=False):
        if len(asked.axes) == 2:
            _map(figure, axes, asked, table[name], name)
        else:
            _lines(axes, asked, table[name], name)
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    with written_file(path, force=True) as unfinished:
        figure.savefig(unfinished, dpi=DPI)


def varies(values: Sequence[float]) -> bool:
    """Return whether the finite values differ by more than rounding error."""
    finite = [value for value in values if math.isfinite(value)]
    return len(finite) > 1 and max(finite) - min(finite) > 1e-12 * max(map(abs, finite))


def _places(values: Sequence[Value]) -> list[Any]:
    numbers = all(_kind(value) == float | int and math.isfinite(float(value)) for value in values)
    return list(values) if numbers else [str(value) for value in values]


def _lines(axes: Any, asked: Question, values: Sequence[float], name: str) -> None:
    (key, first), rest = asked.axes[0], asked.axes[1:]
    stride = math.prod(len(entries) for _, entries in rest)
    shown = rest[0] if rest else None
    inner = math.prod(len(entries) for _, entries in rest[1:])
    for place in range(min(CURVES, len(shown[1])) if shown else 1):
        curve = [values[i * stride + place * inner] for i in range(len(first))]
        label = f"{shown[0]} = {shown[1][place]}" if shown else None
        axes.plot(_places(first), curve, ".-", label=label)
    if not isinstance(_places(first)[0], str):
        _scaled(axes, "x", first)
    axes.set_xlabel(key)
    axes.set_ylabel(name)
    if shown:
        axes.legend(title="\n".join(f"{other} = {entries[0]}" for other, entries in rest[1:]))


def _map(figure: Any, axes: Any, asked: Question, values: Sequence[float], name: str) -> None:
    (down, rows), (across, entries) = asked.axes
    grid = [list(values[i * len(entries) : (i + 1) * len(entries)]) for i in range(len(rows))]
    cells = [_scaled(axes, axis, _spots(spots)) for axis, spots in (("x", entries), ("y", rows))]
    mesh = axes.pcolormesh(*cells, grid, cmap="viridis")
    for axis, spots in ((axes.xaxis, entries), (axes.yaxis, rows)):
        if _spots(spots) != list(spots):
            axis.set_ticks(_spots(spots), [str(value) for value in spots])
    figure.colorbar(mesh, ax=axes)
    axes.grid(visible=False)
    axes.set_title(name, fontsize=9)
    axes.set_xlabel(across)
    axes.set_ylabel(down)


def _scaled(axes: Any, axis: str, spots: Sequence[Any]) -> Any:
    """Make an axis logarithmic if its spots span a decade and are more even so; return the edges of their cells."""
    at = np.asarray(spots, dtype=np.float64)
    logarithmic = 0.0 < 10.0 * at.min() <= at.max() and _unevenness(np.log(at)) < _unevenness(at)
    if logarithmic:
        axes.set(**{f"{axis}scale": "log"})
        at = np.log(at)
    else:
        axes.locator_params(axis=axis, nbins=TICKS)
    between = (at[1:] + at[:-1]) / 2.0
    edges = np.concatenate((2.0 * at[:1] - between[:1], between, 2.0 * at[-1:] - between[-1:]))
    return np.exp(edges) if logarithmic else edges


def _unevenness(at: Any) -> float:
    """Return the largest gap over the least."""
    gaps = np.diff(np.unique(at))
    return float(gaps.max() / gaps.min())


def _spots(values: Sequence[Value]) -> list[Any]:
    places = _places(values)
    ordered = places in (sorted(places), sorted(places, reverse=True))
    return places if ordered and not isinstance(places[0], str) else list(range(len(values)))
