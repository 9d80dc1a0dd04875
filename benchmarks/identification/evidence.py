# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/proof/identification.md that scripts of this room write, each row with its date and machine."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "reliability"))
from measured import here, machine_once

PAGE = Path(__file__).resolve().parents[2] / "docs" / "proof" / "identification.md"


def marks(script: str) -> tuple[str, str]:
    """Return the lines around the table of a script, named by its file without ending."""
    return f"<!-- written by benchmarks/identification/{script}.py -->", f"<!-- end of {script} -->"


def write_rows(script: str, columns: Sequence[str], rows: Iterable[Sequence[object]], page: Path = PAGE) -> None:
    """Put rows into the table of a script, in place of all those with the same first cell.

    Raises
    ------
    ValueError
        If the page has no marks of the script.
    """
    begin, end = marks(script)
    head, found, rest = page.read_text(encoding="utf-8").partition(begin)
    if not found or end not in rest:
        raise ValueError(f"{page.name} has no marks {begin} ... {end}")
    old, _, tail = rest.partition(end)
    title = [_line([*columns, "made"]), f"|{'---|' * (len(columns) + 1)}"]
    fresh = [_line([*row, here()]) for row in rows]
    named = {line.split("|")[1] for line in fresh}
    kept = [line for line in old.splitlines()[1:] if line.startswith("|") and line not in title]
    kept = [line for line in kept if line.split("|")[1] not in named]
    table = machine_once(old, [*title, *kept, *fresh])
    page.write_text("\n".join([head + begin, "", *table, "", end + tail]), encoding="utf-8")


def share_interval(held: int, asked: int) -> tuple[float, float]:
    """Return the 95 % interval of a share by Clopper and Pearson, percent."""
    found = stats.binomtest(held, asked).proportion_ci(0.95, "exact")
    return 100.0 * float(found.low), 100.0 * float(found.high)


def _line(cells: Sequence[object]) -> str:
    return f"| {' | '.join(map(str, cells))} |"
