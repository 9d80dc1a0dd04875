# SPDX-License-Identifier: Apache-2.0
"""Writes what a script measured into its page of the documentation, between the marks that bear its name."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = DOCS / "proof" / "reliability.md"
MADE_ON = re.compile(r"^Made on (.+), where a row names no other\.$", re.MULTILINE)
OTHER_PAGES = dict.fromkeys(("random_draws", "value_pairs"), DOCS / "proof" / "random-configurations.md")


def page_of(script: str) -> Path:
    """Return the page that a script, named by its file without ending, writes into."""
    return OTHER_PAGES.get(script, PAGE)


def today() -> str:
    """Return the date, as the tables have it."""
    return f"{datetime.now(UTC):%Y-%m-%d}"


def here() -> str:
    """Return date and machine, as a row has them."""
    return f"{today()}, {this_machine()}"


def this_machine() -> str:
    """Return what the numbers were measured on."""
    cores = len(os.sched_getaffinity(0))
    return f"{cores} cores of {_processor()}, Python {platform.python_version()}"


def marks(script: str) -> tuple[str, str]:
    """Return the lines around the table of a script, named by its file without ending."""
    return f"<!-- written by benchmarks/reliability/{script}.py -->", f"<!-- end of {script} -->"


def write_table(script: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Put a table between the marks of a script; the line above it says when and on what it was made.

    Raises
    ------
    ValueError
        If the page has no such marks.
    """
    _replace(script, [f"Made on {today()} on {this_machine()}.", "", *_head(columns), *_lines(rows)])


def add_rows(script: str, columns: Sequence[str], rows: Iterable[Sequence[object]], naming: int = 1) -> None:
    """Add rows to the table between the marks of a script, in place of those with the same first cells.

    Each row names its date, and its machine where that is another than the table's.  The first ``naming`` cells tell a
    row from the others.

    Raises
    ------
    ValueError
        If the page has no such marks.
    """
    head, fresh, table = _head(columns), _lines(rows), _between(script)[1]
    old = [line for line in table.splitlines() if line.startswith("|") and line not in head]
    named = {_first_cells(line, naming) for line in fresh}
    kept = [line for line in old if _first_cells(line, naming) not in named]
    _replace(script, machine_once(table, [*head, *kept, *fresh]))


def machine_once(old: str, lines: Iterable[str]) -> list[str]:
    """Return the line that names the machine of a table, and its lines; a row of another machine names its own."""
    found = MADE_ON.search(old)
    machine = found[1] if found else this_machine()
    shorter = (line.replace(f", {machine} |", " |") for line in lines)
    return [f"Made on {machine}, where a row names no other.", "", *shorter]


def _first_cells(line: str, count: int) -> tuple[str, ...]:
    return tuple(cell.strip() for cell in line.split("|")[1 : 1 + count])


def _head(columns: Sequence[str]) -> list[str]:
    return [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]


def _lines(rows: Iterable[Sequence[object]]) -> list[str]:
    return [f"| {' | '.join(str(cell) for cell in row)} |" for row in rows]


def _between(script: str) -> tuple[str, str, str]:
    begin, end = marks(script)
    page = page_of(script)
    head, found, rest = page.read_text(encoding="utf-8").partition(begin)
    if not found or end not in rest:
        raise ValueError(f"{page.name} has no marks {begin} ... {end}")
    old, _, tail = rest.partition(end)
    return head + begin, old, end + tail


def _replace(script: str, lines: list[str]) -> None:
    head, _, tail = _between(script)
    page_of(script).write_text("\n".join([head, *lines, tail]), encoding="utf-8")


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
