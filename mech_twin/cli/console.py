# SPDX-License-Identifier: Apache-2.0
"""Output: tables, JSON, progress bars on a terminal, how the compiling of kernels goes, and errors.

An error is one line on standard error; the exit code is 2 for errors in the input, 3 for a recording with losses.
"""

from __future__ import annotations

import csv
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from mech_twin.errors import OneLineError
from mech_twin.files.output_file import json_text, written_file
from mech_twin.process.dependencies import lacking, missing_extra
from mech_twin.process.interruption import (
    EXIT_CODE_BASE,
    INTERRUPTED_LINE,
    interruptible,
    raised_signal,
    tell_interrupted,
)
from mech_twin.process.terminal_output import StandardOutputError, give_up_output, printable, printable_json

if TYPE_CHECKING:
    from sys import UnraisableHookArgs


Item = TypeVar("Item")

UNFOLDED = 10_000  # characters
PIPED = 140  # characters, where no terminal says how wide it is
LONGEST_WORD = 48  # beyond it a cell is folded rather than given room
WORDS = frozenset({"unit", "kind", "contact", "state", "regime", "description", "quantity", "verdict"})  # of a column
VERDICT_STYLES = {
    **dict.fromkeys(("holds", "reproduced", "reproduced with a stated change"), "green"),
    **dict.fromkeys(("not met", "broken", "not reproduced"), "bold red"),
    "binds": "yellow",
}
FIRST_ESTIMATE_S = 2.0
BEYOND_REASON_S = 1e7  # a hundred days


def print_json(document: Any) -> None:
    """Write a result as JSON: an object of the fields of a dataclass or named tuple; null for a number not finite."""
    sys.stdout.write(printable_json(json_text(document)))


def print_csv(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write rows as comma-separated values with a header."""
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)


def print_table(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    *,
    piped: int | None = None,
    wide: bool = False,
    marked: int | None = None,
    more: str = "",
) -> None:
    """Write a table, as wide as the terminal.

    Parameters
    ----------
    title : str
        What stands above it.
    columns, rows : sequence
        Heads, and cells; numbers are shown with six digits, words that are a verdict in its colour.
    piped : int, optional
        Width where no terminal says how wide it is.
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

    width = UNFOLDED if wide else None if sys.stdout.isatty() else piped or PIPED
    console = Console(width=width, highlight=False)
    cells = [[_shown(cell) for cell in row] for row in rows]
    count = _fitting(columns, cells, console.width) if more and not wide else len(columns)
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


class ShownTable(NamedTuple):
    """A table for the terminal and for a report: title, heads, cells, and the row that is marked, the best."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[Any]]
    marked: int | None = None


def numbers_table(title: str, numbers: Mapping[str, Any]) -> ShownTable:
    """Return named numbers with their units, one a row."""
    return ShownTable(title, ("quantity", "value", "unit"), numbered(numbers))


def records_table(title: str, rows: Sequence[Mapping[str, Any]], marked: int | None = None) -> ShownTable:
    """Return rows that have the same names as a table, one of them marked."""
    return ShownTable(title, tuple(rows[0]) if rows else (), [tuple(row.values()) for row in rows], marked)


def print_tables(*tables: ShownTable) -> None:
    """Write tables that have a row."""
    for table in tables:
        if table.rows:
            print_table(table.title, table.heads, table.rows, marked=table.marked)


def _fitting(columns: Sequence[str], cells: Sequence[Sequence[str]], width: int) -> int:
    """Return the number of columns that fit side by side, at least two; long words may be folded."""
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


def rounded(value: float) -> str:
    """Return a number as a table of many columns has it, in four digits."""
    return f"{value:.4g}"


def numbered(numbers: Mapping[str, Any]) -> list[tuple[str, Any, str]]:
    """Return a row of each number, or of a limit such as ``run_power_mean_w <= 200``: name, value, unit."""
    from mech_twin.declarations.captions import unit_of

    return [(name, value, unit_of(name.partition(" ")[0])) for name, value in numbers.items()]


def say_result(*lines: str) -> None:
    """Write lines of the output proper."""
    sys.stdout.write("".join(printable(line) + "\n" for line in lines))


def say(*lines: str) -> None:
    """Write lines to standard error, separate from the output proper."""
    for line in lines:
        sys.stderr.write(printable(line) + "\n")
    sys.stderr.flush()


def write_text(file: Path, text: str, *, force: bool) -> None:
    """Write a file as a whole or not at all."""
    with written_file(file, force=force) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def time_left_notice(title: str, least_s: float = 0.0) -> Callable[[int, int], None]:
    """Return what takes how much is done of how much; it says once how long the rest takes, if so long at least."""
    first: tuple[float, int] | None = None  # when, and how much was done: the first step loads and compiles
    said = False

    def taken(done: int, total: int) -> None:
        nonlocal first, said
        now = time.monotonic()
        first = first or (now, done)
        elapsed_s, since = now - first[0], done - first[1]
        if said or since <= 0 or elapsed_s <= FIRST_ESTIMATE_S:
            return
        left_s = elapsed_s * (total - done) / since
        if said := left_s >= least_s:
            left = timedelta(seconds=round(left_s))
            say(f"{title}: {done} of about {total} steps, about {left} left at this speed; Ctrl-C ends it")

    return taken


@contextmanager
def bar(title: str, *columns: str, total: float | None = None) -> Iterator[Callable[..., None] | None]:
    """Yield the function that updates a progress bar; None without a terminal.

    Parameters
    ----------
    title : str
        What is going on.
    *columns : str
        Names of columns of rich, or text with fields of the task in braces.
    total : float, optional
        How much there is, if that is known.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich import progress as rich_progress
    from rich.console import Console

    parts = [getattr(rich_progress, each)() if each.endswith("Column") else each for each in columns]
    with rich_progress.Progress(*parts, console=Console(stderr=True), transient=True) as shown:
        yield partial(shown.update, shown.add_task(title, total=total))


@contextmanager
def busy_bar(title: str) -> Iterator[None]:
    """Show on a terminal that something is computed whose length is not known, and for how long already."""
    with bar(title, "SpinnerColumn", "{task.description}", "TimeElapsedColumn"):
        yield


@contextmanager
def count_bar(title: str, total: float | None = None) -> Iterator[Callable[[int, int], None] | None]:
    """Give ``progress(done, all)``, which moves a bar, when a terminal listens."""
    columns = ("{task.description}", "BarColumn", "MofNCompleteColumn", "TimeElapsedColumn", "TimeRemainingColumn")
    with bar(title, *columns, total=total) as update:
        yield None if update is None else lambda done, total: update(completed=done, total=total)


@contextmanager
def progress(items: Iterable[Item], total: int, title: str) -> Iterator[Iterable[Item]]:
    """Iterate over the items, with a progress bar on a terminal; elsewhere with an estimate if it takes long."""
    with count_bar(title, total) as update:
        show = update or time_left_notice(title, BEYOND_REASON_S)

        def followed() -> Iterator[Item]:
            for done, item in enumerate(items):
                show(done, total)
                yield item

        yield followed()


LOGGER = "mech_twin.kernels"
FIRST_TOLD_S = 5.0
GROWTH = 2.0  # of the time until the next line


class CompileProgress(logging.Handler):
    """Handler of the compiler's logger; ``write`` takes a line with its end, ``clock`` gives the time in seconds."""

    def __init__(self, write: Callable[[str], object], clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(logging.INFO)
        self._write, self._clock = write, clock
        self._begun_s, self._due_s = clock(), FIRST_TOLD_S
        self._end: Callable[[], None] | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a line of the compiler on; the one with which it begins starts the counting."""
        self._write(f"{record.getMessage()}\n")
        if record.levelno == logging.INFO and self._end is None:
            from mech_twin.kernels.cache import on_compile

            self._begun_s = self._clock()
            self._end = on_compile(self.compiling)

    def compiling(self, kernel: str, count: int) -> None:
        """Print the number of the kernel being compiled, if a line is due."""
        spent_s = self._clock() - self._begun_s
        if spent_s >= self._due_s:
            self._due_s = GROWTH * spent_s
            self._write(f"  kernels compiled, once: {count - 1} in {spent_s:.0f} s, going on\n")

    def close(self) -> None:
        """Observe no longer."""
        if self._end is not None:
            self._end()
            self._end = None
        super().close()


@contextmanager
def compiling_shown() -> Iterator[None]:
    """Show on a terminal how compiling goes; elsewhere do nothing."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield
        return
    logger = logging.getLogger(LOGGER)
    handler = CompileProgress(lambda line: sys.stderr.write(line))  # noqa: PLW0108 # as a progress bar replaces it
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        handler.close()


EXIT_CODE = 2
LOSS_EXIT_CODE = 3
FOUND = 1  # exit code of a verb that found what it looks for: a difference, a fault, a broken residual
STANDARD_ERROR = 2
_NO_MEMORY_LINE = b"mech-twin: not enough memory to clean up\n"
INTERRUPTED = EXIT_CODE_BASE + signal.SIGINT
UNREAD = EXIT_CODE_BASE + signal.SIGPIPE  # of a command whose output nobody reads to its end, as of other tools


class CommandError(OneLineError):
    """A command that cannot be carried out as given; the message is one line."""


def report_losses(*recordings: Path | None, known: Sequence[str] = ()) -> None:
    """Print the losses of new recordings, and exit with a code of its own if there are any."""
    made = [recording for recording in recordings if recording is not None]
    losses = list(known)
    if made:
        from mech_twin.recording.bag_reader import lost_messages

        losses += filter(None, map(lost_messages, made))
    for lost in losses:
        sys.stderr.write(f"mech-twin: {lost}\n")
    if losses:
        raise SystemExit(LOSS_EXIT_CODE)


def _without_memory(unraisable: UnraisableHookArgs) -> None:
    """Tell of a finalizer or a callback that found no memory in one line, made before; of all others as Python does."""
    if unraisable.exc_type is MemoryError:
        os.write(STANDARD_ERROR, _NO_MEMORY_LINE)
        return
    sys.__unraisablehook__(unraisable)


@contextmanager
def report_cli_errors() -> Iterator[None]:
    """Report errors in the input and signals in one line; internal errors keep their traceback."""
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _without_memory  # to the end of the process: finalizers run at its exit too
    try:
        with interruptible():
            yield
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not disturb the clean-up at exit
        sys.stderr.write(INTERRUPTED_LINE)
        raise SystemExit(INTERRUPTED) from None
    except (BrokenPipeError, SystemExit) as end:  # who reads has had enough, or so the libraries say by an exit
        if isinstance(end, SystemExit) and not isinstance(end.__context__, BrokenPipeError):
            raise
        give_up_output()
        raise SystemExit(UNREAD) from None
    except Exception as error:
        if isinstance(error, StandardOutputError):
            give_up_output()
        message = lacking(error) or _line_of(error)
        if message is None:
            if number := raised_signal():
                if number == signal.SIGINT:
                    tell_interrupted()
                raise SystemExit(EXIT_CODE_BASE + number) from error
            raise
        sys.stderr.write(f"mech-twin: {printable(' '.join(message.split()))}\n")
        raise SystemExit(EXIT_CODE) from error


def _line_of(error: Exception) -> str | None:
    """Return the message of an input error; None for an internal one."""
    if isinstance(error, ImportError):
        return missing_extra(error)
    if isinstance(error, FileNotFoundError):
        try:
            Path.cwd()  # which libraries look for while they are loaded
        except FileNotFoundError:
            return "the working directory does not exist any more: change to another one"
    return str(error) if isinstance(error, (OneLineError, StandardOutputError)) else None
