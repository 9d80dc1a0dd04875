"""Output: tables, progress bars on a terminal, JSON."""

from __future__ import annotations

import csv
import json
import math
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

Item = TypeVar("Item")

FIRST_ESTIMATE_S = 2.0
WORTH_AN_ESTIMATE_S = 60.0


def print_json(document: Mapping[str, Any]) -> None:
    """Write a document as JSON; a number that is not finite becomes null."""
    json.dump(_finite(document), sys.stdout, indent=2, ensure_ascii=False, allow_nan=False)
    sys.stdout.write("\n")


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


def duration_words(seconds: float) -> str:
    """Return a time in the unit that suits it: ``45 s``, ``12 min``, ``3.5 h``, ``41 days``.

    Examples
    --------
    >>> duration_words(90.0), duration_words(5400.0), duration_words(1e7)
    ('90 s', '90 min', '116 days')
    """
    for size, unit, least in ((86400.0, "days", 2.0), (3600.0, "h", 2.0), (60.0, "min", 2.0)):
        if seconds >= least * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def estimate(done: int, total: int, elapsed_s: float) -> str:
    """Return how long the rest takes at the speed so far."""
    return f"about {duration_words(elapsed_s * (total - done) / max(done, 1))} left at this speed; Ctrl-C ends it"


def _estimated(items: Iterable[Item], total: int, title: str) -> Iterator[Item]:
    """Pass the items on; once `FIRST_ESTIMATE_S` have gone by, say how long it takes where that is a minute or more."""
    begun = time.monotonic()
    said = False
    for done, item in enumerate(items):
        elapsed_s = time.monotonic() - begun
        if not said and elapsed_s > FIRST_ESTIMATE_S:
            said = True
            if elapsed_s * (total - done) > WORTH_AN_ESTIMATE_S * max(done, 1):
                say(f"{title}: {estimate(done, total, elapsed_s)}")
        yield item


@contextmanager
def progress(items: Iterable[Item], total: int, title: str) -> Iterator[Iterable[Item]]:
    """Iterate over the items, with a progress bar on a terminal; elsewhere with an estimate if it takes long."""
    if not sys.stderr.isatty():
        yield _estimated(items, total, title)
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
