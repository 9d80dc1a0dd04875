"""Writes what a script measured into docs/reliability.md, between the marks that bear its name."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reliability.md"


def today() -> str:
    """Return the date, as the tables have it."""
    return f"{datetime.now(UTC):%Y-%m-%d}"


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
    begin, end = marks(script)
    page = PAGE.read_text(encoding="utf-8")
    head, found, rest = page.partition(begin)
    if not found or end not in rest:
        raise ValueError(f"{PAGE.name} has no marks {begin} ... {end}")
    lines = [
        f"Made on {today()} on {this_machine()}.",
        "",
        f"| {' | '.join(columns)} |",
        f"|{'---|' * len(columns)}",
        *(f"| {' | '.join(str(cell) for cell in row)} |" for row in rows),
    ]
    text = "\n".join([head + begin, *lines, end]) + rest.partition(end)[2]
    PAGE.write_text(text, encoding="utf-8")


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
