# SPDX-License-Identifier: Apache-2.0
"""``mech-twin reproduce``."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from mech_twin.cli.console import busy, print_csv, print_json, print_table, progress, say, say_result
from mech_twin.cli.failure import CommandError
from mech_twin.cli.verbs import ReproduceVerb
from mech_twin.files.output_file import check_output_directory
from mech_twin.process.dependencies import require_extra

if TYPE_CHECKING:
    from mech_twin.capabilities.published import PublishedRow


def reproduce_machines(asked: ReproduceVerb) -> None:
    """Write the comparison with the sources and, if asked, their figures; exit code 1 where a gated row fails."""
    from mech_twin.studies import reproduce
    from mech_twin.studies.reproduction import all_hold, machines_with_published_values

    machine, figures, config, settings = asked.machine, asked.figures, asked.config, asked.settings
    if figures is not None:
        check_output_directory(figures, force=asked.force)
        require_extra("plots")
    parameters = None
    if config is not None or settings:
        if machine is None:
            raise CommandError("--config and --set change one machine: name it before them")
        parameters = asked.parameters
    with busy("computing published values"):
        rows = reproduce(machine, parameters)
    files: list[Path] = []
    if figures is not None:
        from mech_twin.studies import draw_figures

        machines = machines_with_published_values() if machine is None else (machine,)
        with progress(machines, len(machines), "drawing") as counted:
            for name in counted:
                files += draw_figures(name, figures, parameters)
    hold = all_hold(rows)
    if asked.as_json:
        document = {
            "machine": machine or "all",
            "all_gated_hold": hold,
            "verdicts": Counter(row.verdict for row in rows),
            "rows": [row.record() for row in rows],
            "figures": files,
        }
        print_json(document)
    else:
        WRITERS[asked.form](rows)
        for file in files:
            say(f"wrote {file}")
    if not hold:
        failing = sum(not row.holds for row in rows)
        say(f"mech-twin: {failing} of {sum(row.gated for row in rows)} gated rows do not hold")
        raise SystemExit(1)


WIDE_COLUMNS = (
    *("source", "figure or equation", "quantity", "inputs", "published", "computed", "error", "tolerance"),
    *("verdict", "reason"),
)
WIDE = 240
NARROW = 80
ROUNDING = 1e-12  # an error below is that of floating point and is written as zero


def show_rows(rows: Sequence[PublishedRow]) -> None:
    """Write quantity, numbers, error and verdict, a table for each source and its figures; why not, where not."""
    heads = ("quantity, inputs", "published", "computed", "error", "verdict")
    for (source, item), found in groupby(rows, key=lambda row: (row.source, row.figure_or_equation)):
        group = list(found)
        shared = _shared_inputs(group)
        own = [[words for words in row.inputs.split(", ") if words not in shared] for row in group]
        table = [
            (", ".join([row.quantity, *words]), _number(row.published, 5), _number(row.computed, 5), *_judged(row))
            for row, words in zip(group, own, strict=True)
        ]
        print_table(f"{source}: {item}", heads, table, None if sys.stdout.isatty() else NARROW)
        notes = [f"all with {', '.join(shared)}"] if shared else []
        notes += dict.fromkeys(row.reason for row in group if row.verdict != "reproduced" and row.reason)
        for note in notes:
            say_result(fill(note, NARROW, initial_indent="  ", subsequent_indent="    "))
        say_result("")
    show_counts(rows)


def show_wide_rows(rows: Sequence[PublishedRow]) -> None:
    """Write every column: as wide as it needs to be where no terminal sets the width."""
    width = None if sys.stdout.isatty() else WIDE
    print_table("published and computed", WIDE_COLUMNS, map(_cells, rows), width)
    show_counts(rows)


def write_csv(rows: Sequence[PublishedRow]) -> None:
    """Write every column as comma-separated values."""
    print_csv(WIDE_COLUMNS, map(_cells, rows))


WRITERS = {"narrow": show_rows, "wide": show_wide_rows, "csv": write_csv}


def show_counts(rows: Sequence[PublishedRow]) -> None:
    """Write how many rows have which verdict, and how many of those that gate keep their tolerance."""
    for verdict in dict.fromkeys(row.verdict for row in rows):
        say_result(f"{sum(row.verdict == verdict for row in rows):5d}  {verdict}")
    gated = [row for row in rows if row.gated]
    say_result(f"{sum(row.holds for row in gated)} of {len(gated)} checks within tolerance")


def _cells(row: PublishedRow) -> tuple[str, ...]:
    error, verdict = _judged(row)
    numbers = (_number(row.published, 7), _number(row.computed, 7), error, _tolerance(row))
    return (row.source, row.figure_or_equation, row.quantity, row.inputs, *numbers, verdict, row.reason)


def _shared_inputs(group: Sequence[PublishedRow]) -> list[str]:
    """Return the inputs that all rows of a table have, which are written once below it."""
    if len(group) == 1:
        return []
    return [words for words in group[0].inputs.split(", ") if all(words in row.inputs.split(", ") for row in group)]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}g}"


def _judged(row: PublishedRow) -> tuple[str, str]:
    """Return error and verdict; an error below that of rounding is zero."""
    if row.error is None:
        return "-", row.verdict
    shown = 0.0 if abs(row.error) < ROUNDING else row.error
    return f"{100.0 * shown:+.3g} %" if row.measure == "relative" else f"{shown:+.3g}", row.verdict


def _tolerance(row: PublishedRow) -> str:
    if row.tolerance is None:
        return "shown" if row.published is not None else "-"
    if row.measure in ("below", "above"):
        return row.measure
    return f"{100.0 * row.tolerance:.3g} %" if row.measure == "relative" else f"{row.tolerance:.3g}"
