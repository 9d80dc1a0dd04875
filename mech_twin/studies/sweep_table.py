# SPDX-License-Identifier: Apache-2.0
"""A sweep as a table (Parquet or CSV) and as a plot."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mech_twin.files.output_file import written_file
from mech_twin.studies.sweep_points import Point, Question, Value

REFUSED = "refused"
PANELS = 6
CURVES = 8


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
            _write_parquet(asked, table, unfinished)


def _write_csv(table: dict[str, list[Any]], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))


def _write_parquet(asked: Question, table: dict[str, list[Any]], path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    notes = {"machine": asked.machine, "configuration": json.dumps(asked.tree), "duration_s": repr(asked.duration_s)}
    parquet.write_table(pa.table(table).replace_schema_metadata(notes), path, compression="zstd")


def write_picture(asked: Question, found: Sequence[Point], path: Path) -> bool:
    """Plot the first six numbers that vary; return whether there was anything to plot.

    One key gives a line, two a map; more keys give lines over the first key, with the others at their first values.
    """
    table = columns(asked, found)
    names = [name for name in table if name not in (*asked.keys, REFUSED) and varies(table[name])][:PANELS]
    if not names:
        return False
    from mech_twin.capabilities.plots import house_style

    with house_style():
        _draw(asked, table, names, path)
    return True


def _draw(asked: Question, table: dict[str, list[Any]], names: Sequence[str], path: Path) -> None:
    from mech_twin.capabilities.plots import DPI, sheet

    wide = min(len(names), 3 if len(asked.axes) == 2 else 2)
    tall = math.ceil(len(names) / wide)
    figure, panels = sheet(tall, wide, 4.0 * wide, 3.2 * tall)
    for axes, name in zip(panels, names, strict=False):
        if len(asked.axes) == 2 and min(len(values) for _, values in asked.axes) > 1:
            _map(figure, axes, asked, table[name], name)
        else:
            _lines(axes, asked, table[name], name)
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    figure.suptitle(f"{asked.machine}: {asked.count} points", x=0.01, ha="left", fontweight="bold")
    with written_file(path, force=True) as unfinished:
        figure.savefig(unfinished, dpi=DPI)


def varies(values: Sequence[float]) -> bool:
    """Return whether the finite values differ by more than rounding error."""
    finite = [value for value in values if math.isfinite(value)]
    return len(finite) > 1 and max(finite) - min(finite) > 1e-12 * max(map(abs, finite))


def _places(values: Sequence[Value]) -> list[Any]:
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
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
    axes.set_xlabel(key)
    axes.set_ylabel(name)
    if shown:
        axes.legend()


def _map(figure: Any, axes: Any, asked: Question, values: Sequence[float], name: str) -> None:
    (down, rows), (across, entries) = asked.axes
    grid = [list(values[i * len(entries) : (i + 1) * len(entries)]) for i in range(len(rows))]
    mesh = axes.pcolormesh(_spots(entries), _spots(rows), grid, shading="nearest", cmap="viridis")
    for axis, spots in ((axes.xaxis, entries), (axes.yaxis, rows)):
        if _spots(spots) != list(spots):
            axis.set_ticks(_spots(spots), [str(value) for value in spots])
    figure.colorbar(mesh, ax=axes)
    axes.grid(visible=False)
    axes.set_title(name, fontsize=9)
    axes.set_xlabel(across)
    axes.set_ylabel(down)


def _spots(values: Sequence[Value]) -> list[Any]:
    places = _places(values)
    return places if places == list(values) else list(range(len(values)))
