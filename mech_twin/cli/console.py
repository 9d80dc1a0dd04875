"""Output: tables, progress bars on a terminal, JSON."""

from __future__ import annotations

import csv
import json
import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

Item = TypeVar("Item")


def print_json(document: Mapping[str, Any]) -> None:
    """Write a document as JSON; a number that is not finite becomes null."""
    sys.stdout.write(json_text(document))


def json_text(document: Mapping[str, Any]) -> str:
    """Return a document as JSON; a number that is not finite becomes null."""
    return json.dumps(_finite(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    return value


def print_csv(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write rows as comma-separated values with a header."""
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]], width: int | None = None) -> None:
    """Write a table, as wide as the terminal unless a width is given."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left", header_style="bold")
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 or column == "unit" else "right", overflow="fold")
    for row in rows:
        table.add_row(*(_shown(cell) for cell in row))
    Console(width=width or (None if sys.stdout.isatty() else 140)).print(table)


def _shown(cell: Any) -> str:
    if isinstance(cell, list | tuple):
        return " ".join(_shown(item) for item in cell)
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


def print_numbers(title: str, numbers: Mapping[str, Any]) -> None:
    """Write named numbers with their units, one a line."""
    from mech_twin.captions import unit_of

    print_table(title, ("quantity", "value", "unit"), [(name, value, unit_of(name)) for name, value in numbers.items()])


def say_result(line: str) -> None:
    """Write a line of the output proper."""
    sys.stdout.write(line + "\n")


def say(line: str) -> None:
    """Write a line to standard error, separate from the output proper."""
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


@contextmanager
def progress(items: Iterable[Item], total: int, title: str) -> Iterator[Iterable[Item]]:
    """Iterate over the items, with a progress bar if standard error is a terminal."""
    if not sys.stderr.isatty():
        yield items
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    parts = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*parts, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=total)

        def counted() -> Iterator[Item]:
            for item in items:
                yield item
                bar.advance(task)

        yield counted()
