# SPDX-License-Identifier: Apache-2.0
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

from mech_twin.process.terminal_output import printable, printable_json

Item = TypeVar("Item")

UNFOLDED = 10_000  # characters
PIPED = 140  # characters, where no terminal says how wide it is
LONGEST_WORD = 48  # beyond it a cell is folded rather than given room
WORDS = frozenset(
    {"unit", "kind", "contact", "state", "regime", "description", "figure or equation", "quantity", "inputs", "verdict"}
    | {"reason"}
)  # columns that hold words
VERDICT_STYLES = {
    **dict.fromkeys(("holds", "reproduced", "reproduced with a stated change"), "green"),
    **dict.fromkeys(("not met", "broken", "not reproduced"), "bold red"),
    "binds": "yellow",
}
FIRST_ESTIMATE_S = 2.0
BEYOND_REASON_S = 1e7  # a hundred days


def print_json(document: Mapping[str, Any]) -> None:
    """Write a document as JSON; a number that is not finite becomes null."""
    text = json.dumps(_finite(document), indent=2, ensure_ascii=False, allow_nan=False)
    sys.stdout.write(f"{printable_json(text)}\n")


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


def print_table(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    width: int | None = None,
    *,
    wide: bool = False,
    marked: int | None = None,
    more: str = "",
) -> None:
    """Write a table, as wide as the terminal unless a width is given.

    Parameters
    ----------
    title : str
        What stands above it.
    columns, rows : sequence
        Heads, and cells; numbers are shown with six digits, words that are a verdict in its colour.
    width : int, optional
        Width to fold cells at; that of the terminal if absent.
    wide : bool
        Every column in one line, however long.
    marked : int, optional
        Row to mark, the best.
    more : str
        Option that shows every column: those that do not fit are left out then, else their cells are folded.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    given = UNFOLDED if wide else width
    console = Console(width=given or (None if sys.stdout.isatty() else PIPED), highlight=False)
    cells = [[_shown(cell) for cell in row] for row in rows]
    count = _fitting(columns, cells, console.width) if more and not given else len(columns)
    table = Table(title=Text(printable(title)), title_justify="left", header_style="bold", box=None, pad_edge=False)
    for i, column in enumerate(columns[:count]):
        table.add_column(
            Text(printable(column)),
            justify="left" if i == 0 or column in WORDS else "right",
            overflow="fold",
            no_wrap=wide,
        )
    for i, row in enumerate(cells):
        texts = [Text(cell, VERDICT_STYLES.get(cell, "")) for cell in row[:count]]
        table.add_row(*texts, style="bold green" if i == marked else "")
    console.print(table)
    if count < len(columns):
        console.print(f"{len(columns) - count} more columns with {more}: {', '.join(columns[count:])}", style="dim")


def _fitting(columns: Sequence[str], cells: Sequence[Sequence[str]], width: int) -> int:
    """Return how many columns fit side by side, two at least; long words may be folded."""
    taken = 0
    for i, column in enumerate(columns):
        taken += 2 + min(LONGEST_WORD, max([len(column), *(len(row[i]) for row in cells)]))
        if taken > width + 2 and i >= 2:
            return i
    return len(columns)


def _shown(cell: Any) -> str:
    if isinstance(cell, list | tuple):
        return " ".join(_shown(item) for item in cell)
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return f"{cell:.6g}" if isinstance(cell, float) else printable(str(cell))


def print_numbers(title: str, numbers: Mapping[str, Any]) -> None:
    """Write named numbers with their units, one a line."""
    print_table(title, ("quantity", "value", "unit"), numbered(numbers))


def numbered(numbers: Mapping[str, Any]) -> list[tuple[str, Any, str]]:
    """Return a row of each number: name, value, unit."""
    from mech_twin.declarations.captions import unit_of

    return [(name, value, unit_of(name)) for name, value in numbers.items()]


def say_result(line: str) -> None:
    """Write a line of the output proper."""
    sys.stdout.write(printable(line) + "\n")


def say(line: str) -> None:
    """Write a line to standard error, separate from the output proper."""
    sys.stderr.write(printable(line) + "\n")
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
    """Pass the items on; once `FIRST_ESTIMATE_S` have gone by, say how long it takes where nobody can mean it."""
    begun, said = None, False
    for done, item in enumerate(items):
        begun = begun or time.monotonic()  # the first item is not counted: it loads and compiles
        elapsed_s = time.monotonic() - begun
        if not said and elapsed_s > FIRST_ESTIMATE_S:
            said = True
            if elapsed_s * (total - done) > BEYOND_REASON_S * max(done, 1):
                say(f"{title}: {estimate(done, total, elapsed_s)}")
        yield item


@contextmanager
def busy(title: str) -> Iterator[None]:
    """Show on a terminal that something is computed whose length is not known, and for how long already."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    parts = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*parts, console=Console(stderr=True), transient=True) as bar:
        bar.add_task(title, total=None)
        yield


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
