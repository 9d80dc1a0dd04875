# SPDX-License-Identifier: Apache-2.0
"""Times of tasks that take turns, their ratios, and the tables of docs/proof/performance.md, which a run writes itself.

Each round runs every task once, so that a slow minute of the machine falls on all of them alike; the ratio of two is
taken round by round, and its spread is from the smallest to the greatest of these.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import NamedTuple

PAGE = Path(__file__).resolve().parents[1] / "docs" / "proof" / "performance.md"
Task = Callable[[], object]
Times = Mapping[str, Sequence[float]]


class Ratio(NamedTuple):
    """Ratio of two times: median, smallest and greatest of the rounds."""

    median: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.low:.3g} - {self.high:.3g})"


class Table(NamedTuple):
    """A table with the line above it that says how it was measured."""

    how: str
    columns: Sequence[str]
    rows: Sequence[Sequence[object]]

    def lines(self) -> list[str]:
        """Return the table as lines of Markdown."""
        rows = [self.columns, ["---"] * len(self.columns), *self.rows]
        return [self.how, "", *(f"| {' | '.join(map(str, row))} |" for row in rows)]


def in_turn(tasks: Mapping[str, Task], rounds: int, clock: Callable[[], float] = time.process_time) -> Times:
    """Return the times (s) of each task in each round; a round before them is not counted.

    ``clock`` is processor time, which other programs do not lengthen, unless a task waits for files or others.
    """
    return told_in_turn({name: partial(_timed, task, clock) for name, task in tasks.items()}, rounds)


def told_in_turn(tasks: Mapping[str, Callable[[], float]], rounds: int) -> Times:
    """Return what each task says it took (s) in each round; a round before them is not counted."""
    for task in tasks.values():
        task()
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(rounds):
        for name, task in tasks.items():
            times[name].append(task())
    return times


def ratio(times: Times, slow: str, quick: str) -> Ratio:
    """Return how many times longer one task takes than another."""
    each = [a / b for a, b in zip(times[slow], times[quick], strict=True)]
    return Ratio(statistics.median(each), min(each), max(each))


def this_machine() -> str:
    """Return what the numbers were measured on."""
    cores = len(os.sched_getaffinity(0))
    return f"{cores} cores of {_processor()}, Python {platform.python_version()}"


def measure(group: str, measured: Callable[[], Sequence[Table]], *, write: bool | None = None) -> None:
    """Measure a group, print its tables, and write them between its marks in the page if asked for with ``--write``.

    Raises
    ------
    ValueError
        If the page has no such marks.
    """
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("--write", action="store_true", help="put the tables into docs/proof/performance.md")
    asked = parser.parse_args() if write is None else argparse.Namespace(write=write)
    load = os.getloadavg()[0]
    lines = [f"Measured {datetime.now(UTC):%Y-%m-%d} on {this_machine()}; load before it {load:.1f}."]
    for table in measured():
        lines += ["", *table.lines()]
    print("\n".join(lines), flush=True)
    if asked.write:
        put_between(PAGE, group, lines)


def put_between(page: Path, group: str, lines: Sequence[str]) -> None:
    """Replace what stands between the marks of a group."""
    begin, end = f"<!-- {group}: begin -->", f"<!-- {group}: end -->"
    text = page.read_text(encoding="utf-8")
    head, found, rest = text.partition(begin)
    if not found or end not in rest:
        raise ValueError(f"{page.name} has no marks {begin} ... {end}")
    tail = rest.partition(end)[2]
    page.write_text("\n".join([f"{head}{begin}", *lines, f"{end}{tail}"]), encoding="utf-8")


def _timed(task: Task, clock: Callable[[], float]) -> float:
    begun = clock()
    task()
    return clock() - begun


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
