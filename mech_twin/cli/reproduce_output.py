# SPDX-License-Identifier: Apache-2.0
"""How ``mech-twin reproduce`` writes its rows: a table that fits 80 columns, every column of it, or CSV."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from mech_twin.cli.console import print_csv, say_result

if TYPE_CHECKING:
    from mech_twin.capabilities.published import PublishedRow

WIDE_COLUMNS = (
    "source",
    "figure or equation",
    "quantity",
    "inputs",
    "published",
    "computed",
    "error",
    "tolerance",
    "verdict",
    "reason",
)
WIDE = 240
NARROW = 80
ROUNDING = 1e-12  # an error below is that of floating point and is written as zero
STYLES = {"reproduced": "green", "reproduced with a stated change": "green", "not reproduced": "bold red"}


def show_rows(rows: Sequence[PublishedRow]) -> None:
    """Write quantity, numbers, error and verdict, a table for each source and its figures; why not, where not."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else NARROW, highlight=False)
    for (source, item), found in groupby(rows, key=lambda row: (row.source, row.figure_or_equation)):
        group = list(found)
        shared = _shared_inputs(group)
        table = Table(
            title=escape(f"{source}: {item}"), title_justify="left", header_style="bold", box=None, pad_edge=False
        )
        table.add_column("quantity, inputs", overflow="fold", ratio=1)
        for column in ("published", "computed", "error"):
            table.add_column(column, justify="right", no_wrap=True, min_width=9)
        table.add_column("verdict", overflow="fold", width=16)
        for row in group:
            numbers = (_short(row.published), _short(row.computed), _error(row))
            own = [words for words in row.inputs.split(", ") if words not in shared]
            table.add_row(
                ", ".join([escape(row.quantity), *(f"[dim]{escape(words)}[/]" for words in own)]),
                *numbers,
                _verdict(row),
            )
        console.print(table)
        if shared:
            console.print(f"  [dim]all with {escape(', '.join(shared))}[/]")
        for reason in dict.fromkeys(row.reason for row in group if row.verdict != "reproduced" and row.reason):
            console.print(f"  [dim]{escape(reason)}[/]")
        console.print()
    show_counts(rows)


def show_wide_rows(rows: Sequence[PublishedRow]) -> None:
    """Write every column: as wide as it needs to be where no terminal sets the width."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="published and computed", title_justify="left", header_style="bold", row_styles=("", "dim"))
    for column in WIDE_COLUMNS:
        right = column in ("published", "computed", "error", "tolerance")
        table.add_column(column, justify="right" if right else "left", overflow="fold", no_wrap=right)
    for row in rows:
        table.add_row(*_cells(row)[:-2], _verdict(row), row.reason)
    Console(width=None if sys.stdout.isatty() else WIDE).print(table)
    show_counts(rows)


def write_csv(rows: Sequence[PublishedRow]) -> None:
    """Write every column as comma-separated values."""
    print_csv(WIDE_COLUMNS, [_cells(row) for row in rows])


def show_counts(rows: Sequence[PublishedRow]) -> None:
    """Write how many rows have which verdict, and how many of those that gate keep their tolerance."""
    for verdict in dict.fromkeys(row.verdict for row in rows):
        say_result(f"{sum(row.verdict == verdict for row in rows):5d}  {verdict}")
    gated = [row for row in rows if row.gated]
    say_result(f"{sum(row.holds for row in gated)} of {len(gated)} checks within tolerance")


def _cells(row: PublishedRow) -> tuple[str, ...]:
    return (
        row.source,
        row.figure_or_equation,
        row.quantity,
        row.inputs,
        _number(row.published),
        _number(row.computed),
        _error(row),
        _tolerance(row),
        row.verdict,
        row.reason,
    )


def _shared_inputs(group: Sequence[PublishedRow]) -> list[str]:
    """Return the inputs that all rows of a table have, which are written once below it."""
    if len(group) == 1:
        return []
    return [words for words in group[0].inputs.split(", ") if all(words in row.inputs.split(", ") for row in group)]


def _verdict(row: PublishedRow) -> str:
    style = STYLES.get(row.verdict, "yellow")
    return f"[{style}]{row.verdict}[/]"


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.5g}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.7g}"


def _error(row: PublishedRow) -> str:
    if row.error is None:
        return "-"
    shown = 0.0 if abs(row.error) < ROUNDING else row.error
    return f"{100.0 * shown:+.3g} %" if row.measure == "relative" else f"{shown:+.3g}"


def _tolerance(row: PublishedRow) -> str:
    if row.tolerance is None:
        return "shown" if row.published is not None else "-"
    if row.measure in ("below", "above"):
        return row.measure
    return f"{100.0 * row.tolerance:.3g} %" if row.measure == "relative" else f"{row.tolerance:.3g}"
